import { describe, expect, it } from "vitest";
import { isNeutral, NEUTRAL, pushOfKey, sticksOfPad, sticksOfPushes } from "./sticks";

function pad(axes: readonly number[], held: readonly number[] = [5]) {
  const buttons = Array.from({ length: 16 }, (_, index) => ({ pressed: held.includes(index) }));
  return { axes, buttons };
}

describe("keys", () => {
  it("push together, and opposite ones cancel out", () => {
    expect(sticksOfPushes(["forward", "left", "down", "turnRight"])).toEqual({
      forward: 1,
      left: 1,
      up: -1,
      turn: -1,
    });
    expect(isNeutral(sticksOfPushes(["left", "right"]))).toBe(true);
    expect(sticksOfPushes([])).toEqual(NEUTRAL);
  });

  it("are those of their places, and no others", () => {
    expect(pushOfKey("KeyW")).toBe("forward");
    expect(pushOfKey("Space")).toBeNull();
    expect(pushOfKey("toString")).toBeNull();
  });
});

describe("a gamepad", () => {
  it("flies only while a shoulder button is held", () => {
    expect(sticksOfPad(pad([0, 0, 0, -1], []))).toBeNull();
    expect(sticksOfPad(pad([0, 0, 0, -1], [0, 1, 6, 7]))).toBeNull();
    expect(sticksOfPad(pad([0, 0, 0, -1], [4]))).toMatchObject({ forward: 1 });
  });

  it("climbs and turns with the left stick and goes with the right one", () => {
    expect(sticksOfPad(pad([-1, 1, 1, 1]))).toEqual({ turn: 1, up: -1, left: -1, forward: -1 });
  });

  it("rests although its sticks never rest quite in the middle", () => {
    const rested = sticksOfPad(pad([0.1, -0.08, 0.12, -0.03]));
    expect(rested !== null && isNeutral(rested)).toBe(true);
    const little = sticksOfPad(pad([0, 0, 0, -0.2]))?.forward ?? 0;
    expect(little).toBeGreaterThan(0);
    expect(little).toBeLessThan(0.1);
  });

  it("that has fewer sticks does not push what it lacks", () => {
    expect(sticksOfPad(pad([0, -2]))).toEqual({ turn: -0, up: 1, left: -0, forward: -0 });
  });
});
