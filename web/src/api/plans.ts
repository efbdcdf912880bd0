import type { PlanView as PlanViewMessage } from "../protocol/messages.gen";
import { request } from "./request";

/** Where a drone takes a picture: world metres and radians. */
export interface PlannedViewpoint {
  readonly round_index: number;
  readonly drone_id: string;
  readonly position_world: readonly [number, number, number];
  readonly yaw_rad: number;
}

/** One report of the annealing: moves so far, temperature, best fitness. */
export interface AnnealingStep {
  readonly iteration: number;
  readonly temperature: number | null;
  readonly fitness: number | null;
}

/** Shares of the object's surface that at least one and at least three pictures show. */
export interface Coverage {
  readonly once: number;
  readonly thrice: number;
}

/** The newest plan. */
export interface Plan {
  readonly capture_id: string | null;
  readonly at: string;
  readonly fitness: number | null;
  readonly terms: Readonly<Record<string, number | null>>;
  readonly candidates: number;
  readonly bound: number | null;
  readonly viewpoints: readonly PlannedViewpoint[];
  /** How it was found, from the first report on; empty for the ring. */
  readonly annealing: readonly AnnealingStep[];
  /** The standard ring around the same object; empty where it is what was chosen. */
  readonly ring: readonly PlannedViewpoint[];
  /** What all pictures will show when those planned are taken; what the ring would. */
  readonly expected: Coverage | null;
  readonly ring_expected: Coverage | null;
}

export type ShownPlan = PlanViewMessage["shown"];

/** The newest capture's newest plan, null before there is one. @throws RequestError */
export async function getPlan(): Promise<Plan | null> {
  const plans = (await request("GET", "/plans")) as readonly Plan[];
  return plans[0] ?? null;
}

/** Choose what the 3D scene shows, for everybody who looks at it. @throws RequestError */
export async function choosePlanView(shown: ShownPlan): Promise<void> {
  await request("PUT", "/plans/view", { shown });
}
