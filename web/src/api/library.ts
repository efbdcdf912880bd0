import type { CaptureReport } from "../protocol/messages.gen";
import { BASE } from "./base";
import { LONG_WORK_MS, request, requestAll, requestText } from "./request";

/** A capture as the library lists it. */
export interface CaptureEntry {
  readonly id: string;
  readonly state: CaptureReport["state"];
  readonly phase: string;
  readonly run: string;
  readonly error: string | null;
  readonly mode: string;
  readonly name: string;
  readonly images: number;
  readonly images_total: number;
  readonly started_at: string;
  readonly metrics: RunMetrics | null;
}

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
  readonly dropped?: Readonly<Record<string, string>>;
}

/** A file of a run. */
export interface Artifact {
  readonly path: string;
  readonly size_bytes: number;
  readonly url: string;
}

/** All captures, newest first. @throws RequestError */
export async function getCaptures(): Promise<readonly CaptureEntry[]> {
  return (await requestAll("/captures")) as readonly CaptureEntry[];
}

/** The files of a capture. @throws RequestError */
export async function getArtifacts(captureId: string): Promise<readonly Artifact[]> {
  const query = new URLSearchParams({ capture: captureId });
  return (await requestAll(`/artifacts?${query.toString()}`)) as readonly Artifact[];
}

/** @throws RequestError also where the run has no such file. */
export async function getCaptureFile(captureId: string): Promise<CaptureFile> {
  return (await request("GET", artifactPath(captureId, "capture.json"))) as CaptureFile;
}

/** How sure the refinement is of each still's pose, as `poses.json` of a run folder tells. */
export interface RefinedPose {
  readonly file: string;
  readonly refined: boolean;
  readonly sigma_m: number;
  readonly sigma_deg: number;
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

/** Delete a capture and its files for good. @throws RequestError */
export async function deleteCapture(captureId: string): Promise<void> {
  await request("DELETE", `/captures/${encodeURIComponent(captureId)}`, undefined, LONG_WORK_MS);
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
