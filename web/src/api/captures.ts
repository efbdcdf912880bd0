import type { FieldView } from "../reconstruct/fieldView";
import type { CaptureSpec } from "../protocol/rest.gen";
import { BASE } from "./base";
import { call } from "./call";
import { CANCEL_MS } from "./jobs";

export type Mode = NonNullable<CaptureSpec["mode"]>;

/** What to capture; a field that is left out takes the server's default. */
export type CaptureRequest = CaptureSpec &
  Required<Pick<CaptureSpec, "mode" | "pictures" | "train_seconds" | "name">>;

export type CaptureVerb = "pause" | "resume" | "abort";

/** @throws RequestError when it is refused (one capture at a time) or not answered. */
export async function startCapture(wish: CaptureRequest): Promise<void> {
  await call("POST /captures", { body: wish });
}

/** @throws RequestError when it is refused or not answered. */
export async function changeCapture(captureId: string, verb: CaptureVerb): Promise<void> {
  const path = { capture_id: captureId };
  // Where only its training is left, an abort waits for the worker.
  const patience = verb === "abort" ? { timeoutMs: CANCEL_MS } : {};
  await call(`POST /captures/{capture_id}/${verb}`, { path, ...patience });
}

/** @throws RequestError when it is refused (its drones are on their way down) or not answered. */
export async function addPictures(captureId: string, count: number): Promise<void> {
  await call("POST /captures/{capture_id}/pictures", { path: { capture_id: captureId }, body: { count } });
}

/** See the field from `view` while it is trained, null: from the orbit. @throws RequestError */
export async function viewField(captureId: string, view: FieldView | null): Promise<void> {
  const path = { capture_id: captureId };
  await (view === null
    ? call("DELETE /captures/{capture_id}/view", { path })
    : call("PUT /captures/{capture_id}/view", { path, body: view }));
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
