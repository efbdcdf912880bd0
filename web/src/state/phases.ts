/** The mission's course as people follow it: one entry per row of the timeline. */
export const STEPS = [
  "preflight",
  "take_off",
  "centre",
  "seed",
  "plan",
  "rounds",
  "land",
  "refine",
  "train",
  "done",
] as const;

export type Step = (typeof STEPS)[number];

/** Where each phase of the server belongs; `ended` is no place of its own. */
const STEP_OF_PHASE: Readonly<Record<string, Step>> = {
  preflight: "preflight",
  take_off: "take_off",
  centre: "centre",
  seed: "seed",
  plan: "plan",
  fly: "rounds",
  tune: "rounds",
  capture: "rounds",
  land: "land",
  refine: "refine",
  train: "train",
  done: "done",
};

/**
 * Return the timeline's step for a phase, or null where the phase has none.
 *
 * Poses are refined at the beginning of the phase `train`; there the training's own stage tells
 * the two apart.
 */
export function stepOfPhase(phase: string, trainingStage: string | null): Step | null {
  if (phase === "train" && trainingStage === "refine") return "refine";
  return Object.hasOwn(STEP_OF_PHASE, phase) ? (STEP_OF_PHASE[phase] ?? null) : null;
}
