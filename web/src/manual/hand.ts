import { isNeutral, NEUTRAL, sticksOfPad, sticksOfPushes, type Pad, type Push, type Sticks } from "./sticks";

/** Ten times a second; the server lets the drone hover after four tenths without. */
const EVERY_MS = 100;

/** What a hand feels: the gamepads, and whether anybody sees the drone it flies. */
interface Senses {
  readonly pads: () => Iterable<Pad | null>;
  readonly seen: () => boolean;
}

/**
 * The hand on the sticks of one drone.
 *
 * While something is pushed the sticks are sent again and again; let go, they are sent once more as
 * neutral, and then nothing is. A page that is hidden, closed or has lost its line is silent too, and
 * a silent hand lets the drone hover. A gamepad that is held already when the hand comes does not
 * count before it was let go.
 */
export class Hand {
  readonly #send: (sticks: Sticks) => void;
  readonly #senses: Senses;
  readonly #pushes = new Set<Push>();
  #pushed = false;
  #padsFree = false;
  #timer: ReturnType<typeof setInterval> | undefined;

  constructor(send: (sticks: Sticks) => void, senses: Senses) {
    this.#send = send;
    this.#senses = senses;
  }

  /** Begin, at rest: the server wants to have seen that first. */
  start(): void {
    if (this.#timer !== undefined) return;
    this.#send(NEUTRAL);
    this.#timer = setInterval(() => {
      this.#beat();
    }, EVERY_MS);
  }

  /** Let go of everything and say so. */
  stop(): void {
    clearInterval(this.#timer);
    this.#timer = undefined;
    this.letGo();
  }

  push(push: Push): void {
    if (this.#timer === undefined || this.#pushes.has(push)) return;
    this.#pushes.add(push);
    this.#beat();
  }

  release(push: Push): void {
    if (this.#pushes.delete(push)) this.#beat();
  }

  /** Let go of all keys, buttons and gamepads. */
  letGo(): void {
    this.#pushes.clear();
    this.#padsFree = false;
    if (this.#pushed) {
      this.#pushed = false;
      this.#send(NEUTRAL);
    }
  }

  #beat(): void {
    const sticks = this.#sticks();
    const pushed = !isNeutral(sticks);
    if (pushed || this.#pushed) this.#send(sticks);
    this.#pushed = pushed;
  }

  /** Keys and buttons have the word over a gamepad. */
  #sticks(): Sticks {
    if (!this.#senses.seen()) return NEUTRAL;
    if (this.#pushes.size > 0) return sticksOfPushes(this.#pushes);
    const held = [...this.#senses.pads()].map((pad) => (pad === null ? null : sticksOfPad(pad)));
    const sticks = held.find((each) => each !== null) ?? null;
    if (sticks === null) this.#padsFree = true;
    return sticks !== null && this.#padsFree ? sticks : NEUTRAL;
  }
}
