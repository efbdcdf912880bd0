import type { TrainingView } from "../protocol/rest.gen";
import { call, callAll } from "./call";
import type { RunMetrics } from "./library";
import { LONG_WORK_MS } from "./request";

/** A field trained anew on a capture's pictures. `metrics` is what its run folder has, as far as it is shown. */
export type Training = Omit<TrainingView, "metrics"> & { readonly metrics: RunMetrics | null };

/** The fields trained anew on a capture, newest first. @throws RequestError */
export async function getTrainings(captureId: string): Promise<readonly Training[]> {
  return callAll("GET /captures/{capture_id}/trainings", { path: { capture_id: captureId } });
}

/** Delete a field trained anew and its files for good. @throws RequestError */
export async function deleteTraining(captureId: string, trainingId: string): Promise<void> {
  await call("DELETE /captures/{capture_id}/trainings/{training_id}", {
    path: { capture_id: captureId, training_id: trainingId },
    timeoutMs: LONG_WORK_MS,
  });
}

export function isUnfinished({ state }: Pick<Training, "state">): boolean {
  return state === "queued" || state === "running";
}
