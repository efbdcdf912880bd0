import type { DroneReplay, ReplayMoment, ReplayView } from "../protocol/rest.gen";
import { call } from "./call";
import { LONG_WORK_MS } from "./request";

export type { DroneReplay, ReplayMoment };

/** A recording; times are seconds since its first picture. */
export type Replay = ReplayView;

/** A believed camera pose: seconds, world metres x, y and z, heading in radians. */
export type WayPoint = DroneReplay["way"][number];

/** What a capture's recording shows; the first time its films are made. @throws RequestError */
export async function getReplay(captureId: string): Promise<Replay> {
  return call("GET /captures/{capture_id}/replay", {
    path: { capture_id: captureId },
    timeoutMs: LONG_WORK_MS,
  });
}

/** How much of a recording has been read by now, 0 to 1; null while nobody reads it. @throws RequestError */
export async function getReplayShare(captureId: string): Promise<number | null> {
  const path = { capture_id: captureId };
  return (await call("GET /captures/{capture_id}/replay/progress", { path })).share;
}
