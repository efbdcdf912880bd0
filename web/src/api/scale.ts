import type { KnownLength, ScaleView } from "../protocol/rest.gen";
import { call } from "./call";
import { LONG_WORK_MS } from "./request";

/** How long something really is, and where its ends are. */
export type KnownLengthWish = KnownLength;

/** All lengths times `factor`, known to `sigma`; the thing seemed to be `measured_m` long. */
export type ScaleFound = ScaleView;

/** @throws RequestError when it is refused (the marks tell no scale) or not answered. */
export async function scaleCapture(captureId: string, wish: KnownLengthWish): Promise<ScaleFound> {
  return call("POST /captures/{capture_id}/scale", {
    path: { capture_id: captureId },
    body: wish,
    timeoutMs: LONG_WORK_MS,
  });
}
