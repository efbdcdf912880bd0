import { LONG_WORK_MS, request, requestAll } from "./request";
import type { Artifact, RunMetrics } from "./library";

/** A field trained anew on a capture's pictures, as its run folder and its job tell. */
export interface Training {
  readonly id: string;
  readonly capture: string;
  readonly state: "queued" | "running" | "succeeded" | "failed" | "cancelled" | "interrupted";
  readonly phase: string;
  /** Share of the phase done, 0 to 1. */
  readonly progress: number;
  readonly error: string | null;
  /** What can be cancelled; null where nothing can. */
  readonly job: string | null;
  readonly created_at: string;
  /** What was asked for; null where the run does not tell. */
  readonly seconds: number | null;
  readonly seed: number | null;
  readonly object_only: boolean;
  readonly metrics: RunMetrics | null;
  readonly size_bytes: number;
  readonly files: readonly Artifact[];
}

/** The fields trained anew on a capture, newest first. @throws RequestError */
export async function getTrainings(captureId: string): Promise<readonly Training[]> {
  return (await requestAll(pathOf(captureId))) as readonly Training[];
}

/** Delete a field trained anew and its files for good. @throws RequestError */
export async function deleteTraining(captureId: string, trainingId: string): Promise<void> {
  await request("DELETE", `${pathOf(captureId)}/${encodeURIComponent(trainingId)}`, undefined, LONG_WORK_MS);
}

export function isUnfinished({ state }: Pick<Training, "state">): boolean {
  return state === "queued" || state === "running";
}

function pathOf(captureId: string): string {
  return `/captures/${encodeURIComponent(captureId)}/trainings`;
}
