import type { ReplayMoment, WayPoint } from "../api/replay";

/** How many of `times`, which rise, are not later than `atS`. */
export function countUntil(times: readonly number[], atS: number): number {
  let [low, high] = [0, times.length];
  while (low < high) {
    const middle = (low + high) >> 1;
    if ((times[middle] ?? Infinity) <= atS) low = middle + 1;
    else high = middle;
  }
  return low;
}

/** A way up to a moment; the last point is where the drone is then. */
export function wayUntil(way: readonly WayPoint[], atS: number): readonly WayPoint[] {
  return way.slice(0, countUntil(way.map(([at]) => at), atS));
}

/** The number of the last thing that has happened at a moment; -1 before the first. */
export function lastMoment(moments: readonly ReplayMoment[], atS: number): number {
  return countUntil(moments.map((moment) => moment.at_s), atS) - 1;
}

/** Farther apart than this, seconds, a film is set anew; below, its own clock is good enough. */
const APART_S = 0.3;

/** What to do with a film that stands at `currentS` so that it shows the moment `atS`. */
export function filmCourse(
  film: { readonly beginsS: number; readonly lengthS: number; readonly currentS: number },
  atS: number,
  running: boolean,
): { readonly seekS: number | null; readonly plays: boolean } {
  const wantedS = Math.min(film.lengthS, Math.max(0, atS - film.beginsS));
  const inside = atS >= film.beginsS && atS < film.beginsS + film.lengthS;
  const apartS = Math.abs(film.currentS - wantedS);
  return { seekS: apartS > (running && inside ? APART_S : 0.02) ? wantedS : null, plays: running && inside };
}
