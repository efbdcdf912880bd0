import { LONG_WORK_MS, request } from "./request";

/** An end of the known length in one picture, pixels of the picture. */
interface MarkedEnd {
  readonly picture: number;
  readonly x: number;
  readonly y: number;
}

/** How long something really is, and where its ends are. */
export interface KnownLengthWish {
  readonly length_m: number;
  readonly ends: readonly [readonly MarkedEnd[], readonly MarkedEnd[]];
}

/** All lengths times `factor`, known to `sigma`; the thing seemed to be `measured_m` long. */
export interface ScaleFound {
  readonly factor: number;
  readonly sigma: number;
  readonly measured_m: number;
}

/** @throws RequestError when it is refused (the marks tell no scale) or not answered. */
export async function scaleCapture(captureId: string, wish: KnownLengthWish): Promise<ScaleFound> {
  const path = `/captures/${encodeURIComponent(captureId)}/scale`;
  return (await request("POST", path, wish, LONG_WORK_MS)) as ScaleFound;
}
