import { BASE } from "./base";
import type { FieldView } from "../reconstruct/fieldView";
import { CANCEL_MS } from "./jobs";
import { request } from "./request";

export type Mode = "optimized" | "standard";

/** What to capture; a field that is left out takes the server's default. */
export interface CaptureRequest {
  readonly mode: Mode;
  readonly drones?: number;
  readonly pictures: number;
  readonly train_seconds: number;
  readonly name: string;
  /** Reason by key of the checklist item that shall not keep the capture on the ground. */
  readonly overrides?: Readonly<Record<string, string>>;
}

export type CaptureVerb = "pause" | "resume" | "abort";

/** @throws RequestError when it is refused (one capture at a time) or not answered. */
export async function startCapture(wish: CaptureRequest): Promise<void> {
  await request("POST", "/captures", wish);
}

/** @throws RequestError when it is refused or not answered. */
export async function changeCapture(captureId: string, verb: CaptureVerb): Promise<void> {
  const path = `/captures/${encodeURIComponent(captureId)}/${verb}`;
  // Where only its training is left, an abort waits for the worker.
  await (verb === "abort" ? request("POST", path, undefined, CANCEL_MS) : request("POST", path));
}

/** @throws RequestError when it is refused (its drones are on their way down) or not answered. */
export async function addPictures(captureId: string, count: number): Promise<void> {
  await request("POST", `/captures/${encodeURIComponent(captureId)}/pictures`, { count });
}

/** See the field from `view` while it is trained, null: from the orbit. @throws RequestError */
export async function viewField(captureId: string, view: FieldView | null): Promise<void> {
  const path = `/captures/${encodeURIComponent(captureId)}/view`;
  await (view === null ? request("DELETE", path) : request("PUT", path, view));
}

/** Return false when the server does not know this browser; true when it does or is silent. */
export async function isSignedIn(): Promise<boolean> {
  try {
    const response = await fetch(`${BASE}/api/v1/captures?limit=1`, {
      credentials: "same-origin",
      cache: "no-store",
      signal: AbortSignal.timeout(3000),
    });
    return response.status !== 401;
  } catch {
    return true;
  }
}
