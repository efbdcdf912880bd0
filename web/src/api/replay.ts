import { LONG_WORK_MS, request } from "./request";

/** A believed camera pose: seconds, world metres, heading in radians. */
export type WayPoint = readonly [atS: number, x: number, y: number, z: number, heading: number];

export interface DroneReplay {
  readonly drone_id: string;
  /** The address of its video, which begins at `begins_s`. */
  readonly film: string | null;
  readonly begins_s: number;
  readonly way: readonly WayPoint[];
}

/** Something that happened: a line of the log, or a picture with its number as `text`. */
export interface ReplayMoment {
  readonly at_s: number;
  readonly kind: "picture" | "info" | "warning" | "error";
  readonly drone_id: string;
  readonly text: string;
}

/** A recording; times are seconds since its first picture. */
export interface Replay {
  readonly seconds: number;
  readonly drones: readonly DroneReplay[];
  readonly moments: readonly ReplayMoment[];
  readonly object_box: readonly [readonly number[], readonly number[]] | null;
}

/** What a capture's recording shows; the first time its films are made. @throws RequestError */
export async function getReplay(captureId: string): Promise<Replay> {
  const path = `/captures/${encodeURIComponent(captureId)}/replay`;
  return (await request("GET", path, undefined, LONG_WORK_MS)) as Replay;
}
