import { isNeutral, NEUTRAL, sticksOfPad, sticksOfPushes, type Pad, type Push, type Sticks } from "./sticks";

/** Ten times a second; the server lets the drone hover after four tenths without. */
const EVERY_MS = 100;

/**
 * The hand on the sticks of one drone.
 *
 * While something is pushed the sticks are sent again and again; let go, they are sent once more as
 * neutral, and then nothing is. A page that is hidden, closed or has lost its line is silent too, and
 * a silent hand lets the drone hover.
 */
export class Hand {
  readonly #send: (sticks: Sticks) => void;
  readonly #pads: () => Iterable<Pad | null>;
  readonly #pushes = new Set<Push>();
  #pushed = false;
  #timer: ReturnType<typeof setInterval> | undefined;

  constructor(send: (sticks: Sticks) => void, pads: () => Iterable<Pad | null>) {
    this.#send = send;
    this.#pads = pads;
  }

  start(): void {
    this.#timer ??= setInterval(() => {
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

  /** Let go of all keys and buttons. */
  letGo(): void {
    this.#pushes.clear();
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
    if (this.#pushes.size > 0) return sticksOfPushes(this.#pushes);
    for (const pad of this.#pads()) {
      const sticks = pad === null ? null : sticksOfPad(pad);
      if (sticks !== null) return sticks;
    }
    return NEUTRAL;
  }
}
