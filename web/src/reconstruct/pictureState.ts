import type { MetricsReport, PosesReport, TrainingReport } from "../protocol/messages.gen";

/** What became of a picture of the capture. */
export interface PictureState {
  /** Kept from the training that is judged, to judge it on. */
  readonly heldOut: boolean;
  /** `waiting` before the poses were refined; `flight` kept the pose believed in flight. */
  readonly pose: "waiting" | "refined" | "flight";
  readonly used: boolean;
}

/** Every eighth picture in file order is held out, the first one included. */
export const HELD_OUT_EVERY = 8;

/** Return what became of picture `index`, as far as the mission has told. */
export function pictureState(
  index: number,
  poses: PosesReport | null,
  training: TrainingReport | null,
  metrics: MetricsReport | null,
): PictureState {
  const judged = metrics !== null || training?.stage === "train" || training?.stage === "evaluate";
  const delivered = training?.stage === "deliver";
  const heldOut = judged && index % HELD_OUT_EVERY === 0;
  const pose = poses === null ? "waiting" : poses.unrefined.includes(index) ? "flight" : "refined";
  const counted = index < (training?.images ?? metrics?.images ?? 0);
  return { heldOut, pose, used: counted && (delivered || metrics !== null || !heldOut) };
}
