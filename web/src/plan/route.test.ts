import { describe, expect, it } from "vitest";
import type { PlannedViewpoint } from "../api/plans";
import type { CaptureReport } from "../protocol/messages.gen";
import { flightLeftS, nearestM, rounds, routes, usualFlightS } from "./route";

function view(drone: string, round: number, x: number, y = 0, z = 0): PlannedViewpoint {
  return { drone_id: drone, round_index: round, position_world: [x, y, z], yaw_rad: 0 };
}

const PLAN = [view("a", 1, 3, 4), view("b", 0, 5), view("a", 0, 0), view("b", 1, 5, 0, 2), view("a", 2, 3, 4, 12)];

describe("a plan", () => {
  it("is as long as its straight lines, in the order of flying", () => {
    expect(routes(PLAN)).toEqual([
      { droneId: "a", ordered: [PLAN[2], PLAN[0], PLAN[4]], lengthM: 17 },
      { droneId: "b", ordered: [PLAN[1], PLAN[3]], lengthM: 2 },
    ]);
  });

  it("keeps drones apart that are there at the same time", () => {
    expect(nearestM(PLAN)).toBeCloseTo(Math.sqrt(4 + 16 + 4));
    expect(nearestM([view("a", 0, 0), view("a", 1, 0)])).toBeNull();
  });

  it("takes as long as the longest way of each round", () => {
    const whole = usualFlightS(PLAN, 0);
    expect(whole).toBeCloseTo(3 * 8 + (5 + 12) / 0.15);
    expect(usualFlightS(PLAN, 2)).toBeCloseTo(8 + 12 / 0.15);
    expect(usualFlightS(PLAN, 3)).toBe(0);
  });

  it("has rounds in order", () => {
    expect(rounds(PLAN).map((round) => [round.index, round.views.length])).toEqual([
      [0, 2],
      [1, 2],
      [2, 1],
    ]);
  });
});

describe("flightLeftS", () => {
  const capture = { at: "2026-01-01T10:01:00Z", images: 8, images_total: 24 } as CaptureReport;

  it("goes on at the pace so far", () => {
    expect(flightLeftS(capture, "2026-01-01T10:00:00Z")).toBe(120);
  });

  it("is unknown at first", () => {
    expect(flightLeftS(capture, undefined)).toBeNull();
    expect(flightLeftS({ ...capture, images: 3 }, "2026-01-01T10:00:00Z")).toBeNull();
  });
});
