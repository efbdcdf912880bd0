import { describe, expect, it } from "vitest";
import type { DroneReport } from "../protocol/messages.gen";
import { droneReport } from "./fixtures";
import { columns, drainPerS, LONGEST_HISTORY_S, withPast, withReport, type History } from "./history";

const START = Date.parse("2026-01-01T10:00:00Z");

function report(droneId: string, afterS: number, changes: Partial<DroneReport> = {}): DroneReport {
  const at = new Date(START + 1000 * afterS).toISOString();
  return droneReport({ drone_id: droneId, at, ...changes });
}

const after = (reports: readonly DroneReport[]): History => reports.reduce(withReport, []);

describe("history", () => {
  it("takes in what was reported before, and fills what was missed", () => {
    const seen = after([report("a", 10, { height_m: 1 }), report("a", 30, { height_m: 3 })]);
    const whole = withPast(seen, [
      report("a", 0, { height_m: 0 }),
      report("b", 0, { height_m: 5 }),
      report("a", 10, { height_m: 9 }),
      report("a", 20, { height_m: 2 }),
    ]);
    expect(columns(whole, ["a", "b"], "height_m")).toEqual({
      agoS: [-30, -20, -10, 0],
      values: [
        [0, 1, 2, 3],
        [5, null, null, null],
      ],
    });
  });

  it("keeps one moment per second with the newest report of each drone", () => {
    const history = after([
      report("a", 0.1, { height_m: 1 }),
      report("b", 0.3, { height_m: 2 }),
      report("a", 0.9, { height_m: 1.5 }),
      report("a", 2.1, { height_m: null }),
    ]);
    expect(columns(history, ["a", "b", "c"], "height_m")).toEqual({
      agoS: [-2, 0],
      values: [
        [1.5, null],
        [2, null],
        [null, null],
      ],
    });
  });

  it("forgets what is older than a flight", () => {
    let history: History = [];
    for (let s = 0; s < LONGEST_HISTORY_S + 50; s++) history = withReport(history, report("a", s));
    expect(history).toHaveLength(LONGEST_HISTORY_S);
    expect(history[0]?.second).toBe(START / 1000 + 50);
  });

  it("does not go back in time", () => {
    const history = after([report("a", 5), report("b", 3)]);
    expect(history).toHaveLength(1);
    expect(history[0]?.reports.has("b")).toBe(false);
  });

  it("tells a drain once a minute has shown one", () => {
    expect(drainPerS(after([report("a", 0), report("a", 30, { battery_pct: 77 })]), "a")).toBeNull();
    const flown = after([
      report("a", 0, { battery_pct: 80 }),
      report("a", 100, { battery_pct: 70 }),
    ]);
    expect(drainPerS(flown, "a")).toBeCloseTo(0.1);
    expect(drainPerS(flown, "b")).toBeNull();
  });

  it("tells no drain where a fresh battery was put in", () => {
    const history = after([report("a", 0, { battery_pct: 20 }), report("a", 100)]);
    expect(drainPerS(history, "a")).toBeNull();
  });
});
