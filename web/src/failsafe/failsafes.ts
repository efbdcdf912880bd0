import type { FailsafeRow } from "../api/safety";
import type { DroneReport, FailsafeReport } from "../protocol/messages.gen";
import { activityFace, isFlying } from "../fly/activity";
import type { DroneState } from "../state/state";

type Action = FailsafeReport["action"];

const RANK: Readonly<Record<Action, number>> = { hold: 0, land: 1, land_all: 2, cut: 3 };

/** The events that come nearer by the mere passing of time; a report names their values alike. */
const AGES = ["state_age_s", "link_age_s", "video_age_s", "object_age_s", "velocity_age_s"] as const;

/** What else a drone reports of the values that the table watches; the others only the server knows. */
const LEVELS: Readonly<Record<string, (report: DroneReport) => number | null>> = {
  battery_pct: (report) => report.battery_pct,
  temperature_c: (report) => report.temperature_c,
  pose_sigma_m: (report) => report.position_sigma_m,
};

/** A drone that came down later than this after a failsafe came down for another reason. */
const LONGEST_LANDING_S = 60;

function isAge(event: string): event is (typeof AGES)[number] {
  return AGES.some((age) => age === event);
}

/** Return an event's value `elapsedS` after the report, null where none is known. */
function measured(event: string, report: DroneReport, elapsedS: number): number | null {
  if (isAge(event)) {
    const ageS = report[event];
    return ageS === null ? null : ageS + elapsedS;
  }
  return Object.hasOwn(LEVELS, event) ? (LEVELS[event]?.(report) ?? null) : null;
}

/** Return whether what fired still fires, as far as the drone's newest report tells. */
export function firesNow(fired: FailsafeReport, drone: DroneState | undefined, nowMs: number): boolean {
  if (drone === undefined) return false;
  const { report, receivedMs, activitySince } = drone;
  if (fired.action === "cut") return report.activity === "cut" && fired.at >= activitySince;
  if (!activityFace(report.activity).inAir) return false;
  const value = measured(fired.event, report, Math.max(0, nowMs - receivedMs) / 1000);
  if (value !== null) {
    return fired.event === "battery_pct" ? value <= fired.threshold : value >= fired.threshold;
  }
  const answer = fired.action === "hold" ? "holding" : "landing";
  // An earlier flight's or hold's cause is not the cause of this one.
  return report.activity === answer && !report.held && fired.at >= activitySince;
}

/** What a tile tells of the failsafes of its drone. */
interface TileNews {
  readonly fired: FailsafeReport;
  readonly now: boolean;
}

/**
 * Return the strongest of what fires for a drone now; for one that was brought down, what did it.
 */
export function tileNews(
  failsafes: readonly FailsafeReport[],
  drone: DroneState,
  nowMs: number,
): TileNews | null {
  const own = failsafes.filter((fired) => fired.drone_id === drone.report.drone_id);
  const now = own.filter((fired) => firesNow(fired, drone, nowMs));
  const strongest = now.reduce<FailsafeReport | null>(
    (best, fired) => (best === null || RANK[fired.action] >= RANK[best.action] ? fired : best),
    null,
  );
  if (strongest !== null) return { fired: strongest, now: true };
  const last = own.findLast((fired) => fired.action !== "hold");
  if (last === undefined || isFlying(drone.report.activity)) return null;
  const downS = (Date.parse(drone.activitySince) - Date.parse(last.at)) / 1000;
  // Written so that an unknown time of landing is believed.
  return downS > LONGEST_LANDING_S ? null : { fired: last, now: false };
}

/** What the table is about to do to a drone, and when. */
export interface Countdown {
  readonly row: FailsafeRow;
  readonly leftS: number;
}

/** A silence is worth a word from this share of its threshold on. */
const WARNING_SHARE = 0.5;

/**
 * Return the next thing the table does to a drone by the mere passing of time, null while nothing
 * is about to happen: a drone in the air that has been silent for half of what a row allows.
 */
export function countdown(
  table: readonly FailsafeRow[],
  drone: DroneState,
  nowMs: number,
): Countdown | null {
  const { report, receivedMs } = drone;
  if (!activityFace(report.activity).inAir || report.activity === "offline") return null;
  const elapsedS = Math.max(0, nowMs - receivedMs) / 1000;
  let next: Countdown | null = null;
  for (const row of table) {
    if (!isAge(row.event)) continue;
    if (row.event === "video_age_s" && !report.video_wanted) continue;
    // What lands already is neither held nor landed.
    if (report.activity === "landing" && (row.action === "hold" || row.action === "land")) continue;
    const ageS = measured(row.event, report, elapsedS);
    if (ageS === null || ageS >= row.threshold) continue;
    const earlier = table.some(
      (other) => other.event === row.event && other.threshold < row.threshold && ageS >= other.threshold,
    );
    // Once one row of an event has acted, the next one counts down from then on.
    if (!earlier && ageS < WARNING_SHARE * row.threshold) continue;
    const leftS = row.threshold - ageS;
    if (next === null || leftS < next.leftS) next = { row, leftS };
  }
  return next;
}

/** What the server does to the fleet when it hears nothing of the operator in command. */
export function silenceCountdown(
  table: readonly FailsafeRow[],
  silentS: number,
): Countdown | null {
  const next = table
    .filter((row) => row.event === "operator_silence_s" && row.threshold > silentS)
    .sort((a, b) => a.threshold - b.threshold)[0];
  return next === undefined ? null : { row: next, leftS: next.threshold - silentS };
}

/** The key of a table row; an event may hold at one threshold and land at another. */
export function rowKey(row: { readonly event: string; readonly action: string }): string {
  return `${row.event} ${row.action}`;
}

/** Return by row and then drone the newest time that each fired. */
export function newestByRow(
  failsafes: readonly FailsafeReport[],
): ReadonlyMap<string, readonly FailsafeReport[]> {
  const rows = new Map<string, Map<string, FailsafeReport>>();
  for (const fired of failsafes) {
    const key = rowKey(fired);
    const row = rows.get(key) ?? new Map<string, FailsafeReport>();
    row.set(fired.drone_id, fired);
    rows.set(key, row);
  }
  return new Map([...rows].map(([key, row]) => [key, [...row.values()]]));
}
