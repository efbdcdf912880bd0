import type { JobView, TrainingSpec } from "../protocol/rest.gen";
import { call, callAll } from "./call";

/** A worker is asked first, then told, and then ended: that may take this long. */
export const CANCEL_MS = 30_000;

/** A background job as it stands. `result` is what its run folder was given, as far as it is shown. */
export type Job = Omit<JobView, "result"> & { readonly result: JobResult | null };

/** What a training ended with, as far as it is shown. */
export interface JobResult {
  readonly psnr_db?: number | null;
  readonly psnr_db_object?: number | null;
  readonly ssim?: number | null;
}

/** A training anew, on the pictures of a capture that is over. */
export type TrainingWish = Required<TrainingSpec>;

/** A training anew, and how many others come before it. */
export type Training = Job & { readonly ahead: number };

/** The trainings anew on a capture's pictures since the console's start, newest first. @throws RequestError */
export async function getTrainings(captureId: string): Promise<readonly Training[]> {
  return trainingsOf(captureId, await callAll("GET /jobs"));
}

/** The trainings anew on a capture's pictures; they wait for each other, whichever capture's they are. */
export function trainingsOf(captureId: string, jobs: readonly Job[]): readonly Training[] {
  // A capture's own training works for the capture's own run.
  const anew = jobs.filter((job) => job.capture !== null && runOf(job) !== job.capture);
  const waited = anew.filter(({ state }) => state === "queued" || state === "running");
  return anew
    .filter((job) => job.capture === captureId)
    .map((job) => ({ ...job, ahead: waited.filter((other) => other.id < job.id).length }));
}

/** The id of the run that a job works for. */
export function runOf(job: Job): string {
  return job.run.split("/").at(-1) ?? job.run;
}

/** @throws RequestError when it is refused or not answered. */
export async function startTraining(wish: TrainingWish): Promise<void> {
  await call("POST /reconstructions", { body: wish });
}

/** @throws RequestError when it is not answered. */
export async function cancelJob(jobId: string): Promise<void> {
  await call("POST /jobs/{job_id}/cancel", { path: { job_id: jobId }, timeoutMs: CANCEL_MS });
}
