/** How the sticks of a drone are pushed, each from -1 to 1; ahead, left, up and turning left count up. */
export interface Sticks {
  readonly forward: number;
  readonly left: number;
  readonly up: number;
  readonly turn: number;
}

export const NEUTRAL: Sticks = { forward: 0, left: 0, up: 0, turn: 0 };

/** One direction that a key or a button pushes to. */
export type Push = "forward" | "back" | "left" | "right" | "up" | "down" | "turnLeft" | "turnRight";

const STICK: Readonly<Record<Push, readonly [keyof Sticks, 1 | -1]>> = {
  forward: ["forward", 1],
  back: ["forward", -1],
  left: ["left", 1],
  right: ["left", -1],
  up: ["up", 1],
  down: ["up", -1],
  turnLeft: ["turn", 1],
  turnRight: ["turn", -1],
};

/** Keys by their place on the board, whatever letter a layout has there. */
const PUSH_OF_KEY: Readonly<Record<string, Push>> = {
  KeyW: "forward",
  KeyS: "back",
  KeyA: "left",
  KeyD: "right",
  KeyR: "up",
  KeyF: "down",
  KeyQ: "turnLeft",
  KeyE: "turnRight",
};

/** The letter a key has on an English keyboard, for the words beside a button. */
export const LETTER: Readonly<Record<Push, string>> = {
  forward: "W",
  back: "S",
  left: "A",
  right: "D",
  up: "R",
  down: "F",
  turnLeft: "Q",
  turnRight: "E",
};

/** Return what a key pushes, null when it is none of the flying keys. */
export function pushOfKey(code: string): Push | null {
  return Object.hasOwn(PUSH_OF_KEY, code) ? (PUSH_OF_KEY[code] ?? null) : null;
}

/** Return the sticks that keys and buttons hold together; opposite ones cancel out. */
export function sticksOfPushes(pushes: Iterable<Push>): Sticks {
  const sticks = { ...NEUTRAL };
  for (const push of pushes) {
    const [stick, way] = STICK[push];
    sticks[stick] += way;
  }
  return sticks;
}

/** The part of a gamepad that flies. */
export interface Pad {
  readonly axes: readonly number[];
  readonly buttons: readonly { readonly pressed: boolean }[];
}

/** The two upper shoulder buttons of a standard gamepad. */
const SHOULDERS = [4, 5] as const;
/** Sticks that are let go rest somewhere near their middle. */
const REST = 0.12;

/**
 * Return how a gamepad's sticks are pushed, null while no shoulder button is held.
 *
 * The left stick climbs and turns, the right one goes. Whoever lets go of the shoulder button, or
 * drops the gamepad, lets the drone hover.
 */
export function sticksOfPad(pad: Pad): Sticks | null {
  if (!SHOULDERS.some((button) => pad.buttons[button]?.pressed === true)) return null;
  const axis = (index: number) => -beyondRest(pad.axes[index] ?? 0);
  return { turn: axis(0), up: axis(1), left: axis(2), forward: axis(3) };
}

function beyondRest(value: number): number {
  const size = Math.min(1, Math.abs(value));
  return size <= REST ? 0 : (Math.sign(value) * (size - REST)) / (1 - REST);
}

/** Return whether nothing is pushed. */
export function isNeutral(sticks: Sticks): boolean {
  return Object.values(sticks).every((value) => value === 0);
}
