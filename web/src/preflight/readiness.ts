import type { Check } from "../api/safety";

/** Reasons by key of the checklist item, as they are typed. */
export type Reasons = Readonly<Record<string, string>>;

export const REASON_LENGTH = { least: 3, most: 300 } as const;

/** True when a reason is long enough to be one. */
export function isReason(text: string | undefined): boolean {
  const { length } = text?.trim() ?? "";
  return length >= REASON_LENGTH.least && length <= REASON_LENGTH.most;
}

/** True when an item keeps its drone, or the console, on the ground. */
export function blocks(check: Check, reasons: Reasons): boolean {
  return !check.passed && (check.final || !isReason(reasons[check.key]));
}

/** The items of one drone, or of the console (`droneId` null). */
export interface Group {
  readonly droneId: string | null;
  readonly checks: readonly Check[];
}

/** Return the checklist drone by drone as it came, the console last. */
export function groups(checks: readonly Check[]): readonly Group[] {
  const byDrone = new Map<string | null, Check[]>();
  for (const check of checks) {
    const group = byDrone.get(check.drone_id);
    if (group === undefined) byDrone.set(check.drone_id, [check]);
    else group.push(check);
  }
  const drones = [...byDrone].filter(([droneId]) => droneId !== null);
  const own = byDrone.get(null);
  return [...drones, ...(own === undefined ? [] : [[null, own] as const])].map(
    ([droneId, items]) => ({ droneId, checks: items }),
  );
}

/** Who would fly, and what is in the way. */
interface Readiness {
  /** The drones that would fly, in fleet order: those that are ready before the others. */
  readonly crew: readonly string[];
  /** All drones that nothing keeps on the ground. */
  readonly ready: readonly string[];
  /** What keeps this crew on the ground. */
  readonly blockers: readonly Check[];
}

/** Judge a checklist for `count` drones (null for all) and the reasons given so far. */
export function readiness(
  checks: readonly Check[],
  count: number | null,
  reasons: Reasons,
): Readiness {
  const drones = groups(checks)
    .map((group) => group.droneId)
    .filter((droneId) => droneId !== null);
  const blocking = checks.filter((check) => blocks(check, reasons));
  const blocked = new Set(blocking.map((check) => check.drone_id));
  const ready = drones.filter((droneId) => !blocked.has(droneId));
  const preferred = [...ready, ...drones.filter((droneId) => blocked.has(droneId))];
  const chosen = new Set(preferred.slice(0, count ?? drones.length));
  return {
    crew: drones.filter((droneId) => chosen.has(droneId)),
    ready,
    blockers: blocking.filter((check) => check.drone_id === null || chosen.has(check.drone_id)),
  };
}

/** Return the reasons worth sending: complete ones, for items of this checklist. */
export function overridesFrom(checks: readonly Check[], reasons: Reasons): Record<string, string> {
  return Object.fromEntries(
    checks
      .filter((check) => !check.passed && !check.final && isReason(reasons[check.key]))
      .map((check) => [check.key, (reasons[check.key] ?? "").trim()]),
  );
}
