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

/** Return by step when it was entered, from the same by phase in the order of entering. */
export function stepsEntered(
  phases: Readonly<Record<string, string>>,
): Readonly<Partial<Record<Step, string>>> {
  const steps: Partial<Record<Step, string>> = {};
  for (const [phase, at] of Object.entries(phases)) {
    const step = stepOfPhase(phase, null);
    if (step !== null) steps[step] ??= at;
  }
  return steps;
}

/** Stages of the training that come before the field's own, with null for none yet. */
const REFINING: ReadonlySet<string | null> = new Set([null, "live", "refine", "masks"]);

/**
 * Return the timeline's step for a phase, or null where the phase has none.
 *
 * The phase `train` begins with the refinement of the poses; the field's own stage tells when that
 * is over. `live` is the stage of the preview that trains during the flight.
 */
export function stepOfPhase(phase: string, trainingStage: string | null): Step | null {
  if (phase === "train" && REFINING.has(trainingStage)) return "refine";
  return Object.hasOwn(STEP_OF_PHASE, phase) ? (STEP_OF_PHASE[phase] ?? null) : null;
}
