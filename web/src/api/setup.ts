import { request } from "./request";

/** Where a drone is set down: metres from the middle of the start circle, and its heading. */
export interface StartPlace {
  readonly drone_id: string;
  readonly name: string;
  readonly colour: string;
  readonly address: string;
  readonly serial: string;
  readonly x_m: number;
  readonly y_m: number;
  readonly yaw_rad: number;
  /** Its camera: focal length in pixels, and how far it looks below the horizon. */
  readonly focal_px: number;
  readonly tilt_deg: number;
  /** False while the camera is taken to be a usual Tello's. */
  readonly calibrated: boolean;
}

export interface FloorPlan {
  readonly start_radius_m: number;
  readonly fence_radius_m: number;
  readonly ceiling_m: number;
  readonly places: readonly StartPlace[];
}

/** One setting, its meaning and what it may be. */
export interface Setting {
  readonly group: string;
  readonly name: string;
  readonly value: unknown;
  readonly default: unknown;
  readonly meaning: string;
  readonly variable: string;
  readonly least: number | null;
  readonly more_than: number | null;
  readonly most: number | null;
}

/** @throws RequestError when it is not answered. */
export async function getFloorPlan(): Promise<FloorPlan> {
  return (await request("GET", "/fleet")) as FloorPlan;
}

/** @throws RequestError when it is not answered. */
export async function getSettings(): Promise<readonly Setting[]> {
  return (await request("GET", "/settings")) as readonly Setting[];
}
