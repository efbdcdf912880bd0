import { request, requestAll } from "./request";

/** A worker is asked first, then told, and then ended: that may take this long. */
export const CANCEL_MS = 30_000;

/** A background job as it stands. */
export interface Job {
  readonly id: string;
  readonly kind: "plan" | "reconstruct" | "render" | "export";
  readonly state: "queued" | "running" | "succeeded" | "failed" | "cancelled";
  readonly phase: string;
  /** Share of the phase done, 0 to 1. */
  readonly progress: number;
  readonly run: string;
  readonly capture: string | null;
  readonly error: string | null;
  readonly created_at: string;
  readonly result: JobResult | null;
}

/** What a training ended with, as far as it is shown. */
export interface JobResult {
  readonly psnr_db?: number | null;
  readonly psnr_db_object?: number | null;
  readonly ssim?: number | null;
}

/** A training anew, on the pictures of a capture that is over. */
export interface TrainingWish {
  readonly capture: string;
  readonly seconds: number;
  readonly object_only: boolean;
  readonly seed: number;
}

/** The trainings anew on a capture's pictures since the console's start, newest first. @throws RequestError */
export async function getTrainings(captureId: string): Promise<readonly Job[]> {
  const jobs = (await requestAll("/jobs")) as readonly Job[];
  // The capture's own training works for the capture's own run.
  return jobs.filter((job) => job.capture === captureId && runOf(job) !== captureId);
}

/** The id of the run that a job works for. */
export function runOf(job: Job): string {
  return job.run.split("/").at(-1) ?? job.run;
}

/** @throws RequestError when it is refused or not answered. */
export async function startTraining(wish: TrainingWish): Promise<void> {
  await request("POST", "/reconstructions", wish);
}

/** @throws RequestError when it is not answered. */
export async function cancelJob(jobId: string): Promise<void> {
  await request("POST", `/jobs/${encodeURIComponent(jobId)}/cancel`, undefined, CANCEL_MS);
}
