import type { AnnealingStep, PlannedViewpoint, PlanView, PlanViewChoice } from "../protocol/rest.gen";
import { call } from "./call";

export type { AnnealingStep, PlannedViewpoint };

/** The newest plan. */
export type Plan = PlanView;

export type ShownPlan = PlanViewChoice["shown"];

/** The newest capture's newest plan, null before there is one. @throws RequestError */
export async function getPlan(): Promise<Plan | null> {
  const plans = await call("GET /plans");
  return plans[0] ?? null;
}

/** Choose what the 3D scene shows, for everybody who looks at it. @throws RequestError */
export async function choosePlanView(shown: ShownPlan): Promise<void> {
  await call("PUT /plans/view", { body: { shown } });
}
