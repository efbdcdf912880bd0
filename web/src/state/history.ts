import type { DroneReport } from "../protocol/messages.gen";

/** What all drones reported within one second, by drone id: the newest of each. */
interface Moment {
  /** Whole seconds since 1970 of the server's clock. */
  readonly second: number;
  readonly reports: ReadonlyMap<string, DroneReport>;
}

/** Reports of the last minutes, a moment per second. */
export type History = readonly Moment[];

/** A Tello flies for less. */
export const LONGEST_HISTORY_S = 900;

/** Take in a report; a second that has begun is written on, older ones stay as they were. */
export function withReport(history: History, report: DroneReport): History {
  const second = Math.floor(Date.parse(report.at) / 1000);
  if (Number.isNaN(second)) return history;
  const last = history.at(-1);
  if (last !== undefined && second < last.second) return history;
  const same = last?.second === second;
  const reports = new Map(same ? last.reports : []).set(report.drone_id, report);
  const before = same ? history.slice(0, -1) : history;
  return [...before.slice(-LONGEST_HISTORY_S + 1), { second, reports }];
}

/** Take in what was reported while this page did not listen; seconds it knows stay as they are. */
export function withPast(history: History, reports: readonly DroneReport[]): History {
  const known = new Set(history.map((moment) => moment.second));
  const past = reports.reduce<History>(withReport, []).filter((moment) => !known.has(moment.second));
  return [...past, ...history].sort((a, b) => a.second - b.second).slice(-LONGEST_HISTORY_S);
}

/** What can be plotted of a drone. */
export const QUANTITIES = [
  "battery_pct",
  "height_m",
  "speed_m_s",
  "temperature_c",
  "position_sigma_m",
  "state_age_s",
  "video_fps",
] as const;

export type Quantity = (typeof QUANTITIES)[number];

/** Columns for a plot: the seconds before the newest moment, and a column for each drone. */
export function columns(
  history: History,
  droneIds: readonly string[],
  quantity: Quantity,
): { readonly agoS: number[]; readonly values: (number | null)[][] } {
  const newest = history.at(-1)?.second ?? 0;
  return {
    agoS: history.map((moment) => moment.second - newest),
    values: droneIds.map((id) => history.map((moment) => moment.reports.get(id)?.[quantity] ?? null)),
  };
}

/** Shorter than this a battery's steps of one percent say nothing about its drain. */
const LEAST_DRAIN_S = 60;

/** Percent of battery a drone used per second over the last minutes; null while that is unknown. */
export function drainPerS(history: History, droneId: string): number | null {
  const known = history.filter((moment) => {
    const report = moment.reports.get(droneId);
    return report !== undefined && report.battery_pct !== null && report.activity !== "ground";
  });
  const [first, last] = [known[0], known.at(-1)];
  if (first === undefined || last === undefined) return null;
  const seconds = last.second - first.second;
  const used = charge(first, droneId) - charge(last, droneId);
  // A fresh battery was put in meanwhile, or nothing was used yet.
  return seconds < LEAST_DRAIN_S || used <= 0 ? null : used / seconds;
}

function charge(moment: Moment, droneId: string): number {
  return moment.reports.get(droneId)?.battery_pct ?? 0;
}
