import type { TrainingSpec } from "../protocol/rest.gen";
import { call } from "./call";

/** A worker is asked first, then told, and then ended: that may take this long. */
export const CANCEL_MS = 30_000;

/** A training anew, on the pictures of a capture that is over. */
export type TrainingWish = Required<TrainingSpec>;

/** @throws RequestError when it is refused or not answered. */
export async function startTraining(wish: TrainingWish): Promise<void> {
  await call("POST /reconstructions", { body: wish });
}

/** @throws RequestError when it is not answered. */
export async function cancelJob(jobId: string): Promise<void> {
  await call("POST /jobs/{job_id}/cancel", { path: { job_id: jobId }, timeoutMs: CANCEL_MS });
}
