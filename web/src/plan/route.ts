import type { PlannedViewpoint } from "../api/plans";
import type { CaptureReport } from "../protocol/messages.gen";

/** What a drone has to do for its part of the plan. */
interface Route {
  readonly droneId: string;
  /** Its viewpoints in the order of flying. */
  readonly ordered: readonly PlannedViewpoint[];
  /** From the first to the last one in straight lines, metres. */
  readonly lengthM: number;
}

function distance(a: PlannedViewpoint, b: PlannedViewpoint): number {
  return Math.hypot(...a.position_world.map((value, axis) => value - (b.position_world[axis] ?? 0)));
}

/** Each drone's route, in the order in which the drones first appear. */
export function routes(viewpoints: readonly PlannedViewpoint[]): readonly Route[] {
  const byDrone = new Map<string, PlannedViewpoint[]>();
  for (const view of viewpoints) {
    const own = byDrone.get(view.drone_id) ?? [];
    byDrone.set(view.drone_id, [...own, view]);
  }
  return [...byDrone].map(([droneId, views]) => {
    const ordered = [...views].sort((a, b) => a.round_index - b.round_index);
    const lengthM = ordered.reduce((sum, view, index) => {
      const before = ordered[index - 1];
      return before === undefined ? sum : sum + distance(before, view);
    }, 0);
    return { droneId, ordered, lengthM };
  });
}

/** The least distance between two viewpoints that are taken at the same time; null for one drone. */
export function nearestM(viewpoints: readonly PlannedViewpoint[]): number | null {
  let nearest: number | null = null;
  viewpoints.forEach((view, index) => {
    for (const other of viewpoints.slice(index + 1)) {
      if (other.round_index !== view.round_index) continue;
      const apart = distance(view, other);
      if (nearest === null || apart < nearest) nearest = apart;
    }
  });
  return nearest;
}

/** Viewpoints by round. */
export function rounds(
  viewpoints: readonly PlannedViewpoint[],
): readonly { readonly index: number; readonly views: readonly PlannedViewpoint[] }[] {
  const indices = [...new Set(viewpoints.map((view) => view.round_index))].sort((a, b) => a - b);
  return indices.map((index) => ({
    index,
    views: viewpoints.filter((view) => view.round_index === index),
  }));
}

/** What a simulated fleet needs for a round beside its ways, seconds, and its pace on them. */
const USUAL_ROUND_S = 8;
const USUAL_M_S = 0.15;

/** Seconds that the rounds not yet begun usually take: each as long as its longest way. */
export function usualFlightS(viewpoints: readonly PlannedViewpoint[], roundsBegun: number): number {
  const ways = new Map<number, number>();
  for (const { ordered } of routes(viewpoints)) {
    ordered.forEach((view, index) => {
      const before = ordered[index - 1];
      const way = before === undefined ? 0 : distance(before, view);
      ways.set(view.round_index, Math.max(way, ways.get(view.round_index) ?? 0));
    });
  }
  return [...ways]
    .filter(([round]) => round >= roundsBegun)
    .reduce((sum, [, metres]) => sum + USUAL_ROUND_S + metres / USUAL_M_S, 0);
}

/** Fewest pictures after which their pace says how long the others will take. */
const LEAST_PICTURES = 4;

/**
 * Seconds until the last picture at the pace of those taken so far; null while that is unknown.
 *
 * `since` is when the rounds began (ISO 8601).
 */
export function flightLeftS(capture: CaptureReport, since: string | undefined): number | null {
  if (since === undefined || capture.images < LEAST_PICTURES) return null;
  const spentS = (Date.parse(capture.at) - Date.parse(since)) / 1000;
  const left = Math.max(0, capture.images_total - capture.images);
  return (Math.max(0, spentS) / capture.images) * left;
}
