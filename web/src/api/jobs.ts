import { request } from "./request";

/** A worker is asked first, then told, and then ended: that may take this long. */
export const CANCEL_MS = 30_000;

/** A training anew, on the pictures of a capture that is over. */
export interface TrainingWish {
  readonly capture: string;
  readonly seconds: number;
  readonly object_only: boolean;
  readonly seed: number;
}

/** @throws RequestError when it is refused or not answered. */
export async function startTraining(wish: TrainingWish): Promise<void> {
  await request("POST", "/reconstructions", wish);
}

/** @throws RequestError when it is not answered. */
export async function cancelJob(jobId: string): Promise<void> {
  await request("POST", `/jobs/${encodeURIComponent(jobId)}/cancel`, undefined, CANCEL_MS);
}
