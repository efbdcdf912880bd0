import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { Hand } from "./hand";
import { NEUTRAL, type Pad, type Sticks } from "./sticks";

const HELD = Array.from({ length: 8 }, (_, index) => ({ pressed: index === 5 }));

describe("a hand on the sticks", () => {
  let sent: Sticks[];
  let pads: (Pad | null)[];
  let seen: boolean;
  let hand: Hand;

  beforeEach(() => {
    vi.useFakeTimers();
    sent = [];
    pads = [];
    seen = true;
    hand = new Hand((sticks) => sent.push(sticks), { pads: () => pads, seen: () => seen });
    hand.start();
    expect(sent).toEqual([NEUTRAL]);
    sent = [];
  });

  afterEach(() => {
    hand.stop();
    vi.useRealTimers();
  });

  it("says nothing while nothing is pushed", () => {
    vi.advanceTimersByTime(1000);
    expect(sent).toEqual([]);
  });

  it("says at once what is pushed, again and again, and once that it is let go", () => {
    hand.push("forward");
    expect(sent).toEqual([{ ...NEUTRAL, forward: 1 }]);
    vi.advanceTimersByTime(300);
    expect(sent).toHaveLength(4);
    hand.push("forward"); // A key that is held repeats.
    expect(sent).toHaveLength(4);
    hand.release("forward");
    expect(sent.at(-1)).toEqual(NEUTRAL);
    vi.advanceTimersByTime(500);
    expect(sent).toHaveLength(5);
  });

  it("lets go of everything at once, and when it is taken away", () => {
    hand.push("up");
    hand.push("left");
    hand.letGo();
    expect(sent.at(-1)).toEqual(NEUTRAL);
    hand.push("up");
    hand.stop();
    expect(sent.at(-1)).toEqual(NEUTRAL);
    const said = sent.length;
    hand.push("up");
    vi.advanceTimersByTime(500);
    expect(sent).toHaveLength(said);
  });

  it("flies nothing that nobody sees", () => {
    pads = [{ axes: [0, 0, 0, -1], buttons: [] }];
    vi.advanceTimersByTime(100);
    pads = [{ axes: [0, 0, 0, -1], buttons: HELD }];
    vi.advanceTimersByTime(100);
    expect(sent.at(-1)).toMatchObject({ forward: 1 });
    seen = false;
    vi.advanceTimersByTime(100);
    expect(sent.at(-1)).toEqual(NEUTRAL);
    const said = sent.length;
    vi.advanceTimersByTime(1000);
    expect(sent).toHaveLength(said);
  });

  it("does not take over a gamepad that is held already", () => {
    pads = [{ axes: [0, 0, 0, -1], buttons: HELD }];
    vi.advanceTimersByTime(500);
    expect(sent).toEqual([]);
    pads = [{ axes: [0, 0, 0, -1], buttons: [] }];
    vi.advanceTimersByTime(100);
    pads = [{ axes: [0, 0, 0, -1], buttons: HELD }];
    vi.advanceTimersByTime(100);
    expect(sent.at(-1)).toMatchObject({ forward: 1 });
    // Let go from outside, it has to be let go itself.
    hand.letGo();
    const said = sent.length;
    vi.advanceTimersByTime(500);
    expect(sent).toHaveLength(said);
  });

  it("follows a gamepad while its shoulder button is held, but keys have the word", () => {
    vi.advanceTimersByTime(100);
    pads = [null, { axes: [0, 0, 0, -1], buttons: HELD }];
    vi.advanceTimersByTime(100);
    expect(sent.at(-1)).toMatchObject({ forward: 1 });
    hand.push("back");
    expect(sent.at(-1)).toMatchObject({ forward: -1 });
    hand.release("back");
    pads = [null];
    vi.advanceTimersByTime(100);
    expect(sent.at(-1)).toEqual(NEUTRAL);
  });
});
