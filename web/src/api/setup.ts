import type { FloorPlanView, SettingView, StartPlaceView } from "../protocol/rest.gen";
import { call } from "./call";

/** Where a drone is set down, and what its camera is. */
export type StartPlace = StartPlaceView;
export type FloorPlan = FloorPlanView;

/** One setting, its meaning and what it may be. */
export type Setting = SettingView;

/** @throws RequestError when it is not answered. */
export async function getFloorPlan(): Promise<FloorPlan> {
  return call("GET /fleet");
}

/** @throws RequestError when it is not answered. */
export async function getSettings(): Promise<readonly Setting[]> {
  return call("GET /settings");
}
