import type { Artifact, CaptureView } from "../protocol/rest.gen";
import { BASE } from "./base";
import { call, callAll } from "./call";
import { LONG_WORK_MS, request, requestText } from "./request";

export type { Artifact };

/** A capture as the library lists it. */
export type CaptureEntry = Omit<CaptureView, "metrics"> & { readonly metrics: RunMetrics | null };

// What follows, up to the artifacts, is in JSON files of run folders. The server hands those on as
// they are, whichever program wrote them, and so its schema does not tell what is in them.

/** The judgement of a run; older runs may lack some of it. */
export interface RunMetrics {
  readonly images?: number;
  readonly images_held_out?: number;
  readonly psnr_db?: number | null;
  readonly psnr_db_object?: number | null;
  readonly ssim?: number | null;
  readonly flip?: number | null;
  readonly pictures?: readonly { readonly index: number; readonly psnr_db: number | null }[];
}

/** What `capture.json` of a run folder tells beside that. */
export interface CaptureFile {
  readonly seconds?: Readonly<Record<string, number>>;
  readonly request?: { readonly train_seconds?: number; readonly seed?: number };
}

/** How sure the refinement is of each still's pose, as `poses.json` of a run folder tells. */
export interface RefinedPose {
  readonly sigma_m: number;
  readonly sigma_deg: number;
}

/** All captures, newest first. @throws RequestError */
export async function getCaptures(): Promise<readonly CaptureEntry[]> {
  return callAll("GET /captures");
}

/** The files of a capture. @throws RequestError */
export async function getArtifacts(captureId: string): Promise<readonly Artifact[]> {
  return callAll("GET /artifacts", { query: { capture: captureId } });
}

/** @throws RequestError also where the run has no such file. */
export async function getCaptureFile(captureId: string): Promise<CaptureFile> {
  return (await request("GET", artifactPath(captureId, "capture.json"))) as CaptureFile;
}

/** The poses of a capture's pictures. @throws RequestError also where they were not refined. */
export async function getPoses(captureId: string): Promise<readonly RefinedPose[]> {
  const file = (await request("GET", artifactPath(captureId, "poses.json"))) as {
    readonly pictures?: readonly RefinedPose[];
  };
  return file.pictures ?? [];
}

/** Where in a run folder the training's log is. */
export const TRAINING_LOG = "jobs/reconstruct/events.jsonl";

/** All that a capture's training has told, line by line as JSON. @throws RequestError also where it never trained. */
export async function getTrainingLog(captureId: string): Promise<string> {
  return requestText(artifactPath(captureId, TRAINING_LOG));
}

/** Keep a capture, whatever retention would delete, or no longer. @throws RequestError */
export async function starCapture(captureId: string, starred: boolean): Promise<void> {
  const path = { capture_id: captureId };
  await (starred
    ? call("PUT /captures/{capture_id}/star", { path })
    : call("DELETE /captures/{capture_id}/star", { path }));
}

/** Delete a capture and its files for good. @throws RequestError */
export async function deleteCapture(captureId: string): Promise<void> {
  await call("DELETE /captures/{capture_id}", { path: { capture_id: captureId }, timeoutMs: LONG_WORK_MS });
}

function artifactPath(captureId: string, path: string): string {
  return `/artifacts/${encodeURIComponent(captureId)}/${path.split("/").map(encodeURIComponent).join("/")}`;
}

/** The address of a file of a run. */
export function artifactUrl(captureId: string, path: string): string {
  return `${BASE}/api/v1${artifactPath(captureId, path)}`;
}

/** The file of a capture's picture. */
export function pictureFile(index: number): string {
  return `images/${String(index).padStart(4, "0")}.jpg`;
}
