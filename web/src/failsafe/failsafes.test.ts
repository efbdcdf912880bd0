import { describe, expect, it } from "vitest";
import type { FailsafeRow } from "../api/safety";
import type { DroneReport, FailsafeReport } from "../protocol/messages.gen";
import { droneReport } from "../state/fixtures";
import type { DroneState } from "../state/state";
import { countdown, firesNow, newestByRow, tileNews } from "./failsafes";

const NOW = 1_000_000;

function drone(changes: Partial<DroneReport> = {}, since = "2026-01-01T10:00:00Z"): DroneState {
  const report = droneReport({ at: "2026-01-01T10:00:10Z", ...changes });
  return { report, receivedMs: NOW, activitySince: since };
}

function fired(changes: Partial<FailsafeReport> = {}): FailsafeReport {
  return {
    type: "failsafe_fired",
    at: "2026-01-01T10:00:05Z",
    drone_id: "a",
    event: "video_age_s",
    threshold: 4,
    action: "hold",
    value: 4.2,
    text: "no picture for 4.2 s",
    ...changes,
  };
}

const BATTERY = fired({ event: "battery_pct", threshold: 15, action: "land", value: 14 });
const SEPARATION = fired({ event: "separation_m", threshold: 0.6, value: 0.5 });

describe("firesNow", () => {
  it("follows what the drone reports", () => {
    expect(firesNow(fired(), drone({ video_age_s: 4.5 }), NOW)).toBe(true);
    expect(firesNow(fired(), drone({ video_age_s: 0.2 }), NOW)).toBe(false);
    expect(firesNow(BATTERY, drone({ battery_pct: 15 }), NOW)).toBe(true);
    expect(firesNow(BATTERY, drone({ battery_pct: 16 }), NOW)).toBe(false);
  });

  it("lets ages grow while no report comes", () => {
    expect(firesNow(fired(), drone({ video_age_s: 3 }), NOW + 500)).toBe(false);
    expect(firesNow(fired(), drone({ video_age_s: 3 }), NOW + 1500)).toBe(true);
  });

  it("is over when the drone is down", () => {
    expect(firesNow(BATTERY, drone({ battery_pct: 10, activity: "ground" }), NOW)).toBe(false);
    expect(firesNow(BATTERY, undefined, NOW)).toBe(false);
  });

  it("goes by what the drone does where no report tells the value", () => {
    expect(firesNow(SEPARATION, drone({ activity: "holding" }), NOW)).toBe(true);
    expect(firesNow(SEPARATION, drone({ activity: "flying" }), NOW)).toBe(false);
    expect(firesNow({ ...SEPARATION, action: "land" }, drone({ activity: "landing" }), NOW)).toBe(true);
  });

  it("does not blame an earlier cause, nor take the operator's hold for a failsafe", () => {
    expect(firesNow(SEPARATION, drone({ activity: "holding" }, "2026-01-01T10:00:09Z"), NOW)).toBe(false);
    expect(firesNow(SEPARATION, drone({ activity: "holding", held: true }), NOW)).toBe(false);
    const cut = fired({ event: "lean_deg", threshold: 65, action: "cut" });
    expect(firesNow(cut, drone({ activity: "cut" }), NOW)).toBe(true);
    expect(firesNow(cut, drone({ activity: "cut" }, "2026-01-01T10:00:09Z"), NOW)).toBe(false);
    // A newcomer does not know since when, and believes what it is told.
    expect(firesNow(SEPARATION, drone({ activity: "holding" }, ""), NOW)).toBe(true);
  });
});

describe("tileNews", () => {
  it("tells the strongest of what fires now", () => {
    const both = drone({ video_age_s: 5, battery_pct: 12, activity: "landing" });
    expect(tileNews([BATTERY, fired()], both, NOW)).toEqual({ fired: BATTERY, now: true });
  });

  it("is calm about what is over and about other drones", () => {
    expect(tileNews([fired()], drone(), NOW)).toBeNull();
    expect(tileNews([fired({ drone_id: "b" })], drone({ video_age_s: 9 }), NOW)).toBeNull();
  });

  it("says of a drone on the ground what brought it down, until it flies again", () => {
    const down = drone({ activity: "ground", battery_pct: 12 });
    expect(tileNews([BATTERY, fired()], down, NOW)).toEqual({ fired: BATTERY, now: false });
    expect(tileNews([BATTERY], drone({ battery_pct: 90 }), NOW)).toBeNull();
    const another = drone({ activity: "ground", battery_pct: 12 }, "2026-01-01T10:20:00Z");
    expect(tileNews([BATTERY], another, NOW)).toBeNull();
  });
});

function row(event: string, threshold: number, action: FailsafeRow["action"]): FailsafeRow {
  return { event, threshold, action, unit: "s", description: "", direction: "at_least" };
}

const TABLE = [
  row("state_age_s", 3, "land"),
  row("link_age_s", 4, "hold"),
  row("link_age_s", 10, "land"),
  row("video_age_s", 4, "hold"),
  row("object_age_s", 20, "land"),
  row("velocity_age_s", 3, "land"),
  row("pose_sigma_m", 0.7, "hold"),
];

describe("countdown", () => {
  const next = (changes: Partial<DroneReport>, nowMs = NOW) => {
    const coming = countdown(TABLE, drone(changes), nowMs);
    return coming === null ? null : [coming.row.event, coming.row.action, coming.leftS];
  };

  it.each([
    ["state_age_s", 2, "land", 1],
    ["link_age_s", 2.5, "hold", 1.5],
    ["link_age_s", 4, "land", 6],
    ["video_age_s", 3, "hold", 1],
    ["object_age_s", 12, "land", 8],
    ["velocity_age_s", 2, "land", 1],
  ] as const)("%s at %d s: %s in %d s", (event, ageS, action, leftS) => {
    expect(next({ [event]: ageS })).toEqual([event, action, leftS]);
  });

  it("goes on while no report comes, and tells the first thing to happen", () => {
    expect(next({ link_age_s: 2.5, velocity_age_s: 2 }, NOW + 500)).toEqual(["velocity_age_s", "land", 0.5]);
  });

  it("is quiet on the ground, before half the time, and about what is not an age", () => {
    expect(next({})).toBeNull();
    expect(next({ link_age_s: null, object_age_s: null, position_sigma_m: 0.6 })).toBeNull();
    expect(next({ link_age_s: 3, activity: "ground" })).toBeNull();
    expect(next({ video_age_s: 3, video_wanted: false })).toBeNull();
  });

  it("does not threaten a landing drone with a landing", () => {
    expect(next({ object_age_s: 15, activity: "landing" })).toBeNull();
  });
});

describe("newestByRow", () => {
  it("keeps each drone's newest in each row", () => {
    const later = fired({ at: "2026-01-01T10:05:00Z" });
    const other = fired({ drone_id: "b" });
    const rows = newestByRow([fired(), other, later, BATTERY]);
    expect(rows.get("video_age_s hold")).toEqual([later, other]);
    expect(rows.get("battery_pct land")).toEqual([BATTERY]);
    expect(rows.size).toBe(2);
  });
});
