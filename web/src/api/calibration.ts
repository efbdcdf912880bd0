import type { CalibrationView } from "../protocol/rest.gen";
import { BASE } from "./base";
import { call } from "./call";

/** The newest calibration of a drone's camera. */
export type Calibration = CalibrationView;
/** A camera as its views have it. */
export type CalibratedCamera = NonNullable<Calibration["result"]>;

/** @throws RequestError when it is not answered. */
export async function getCalibration(droneId: string): Promise<Calibration> {
  return call("GET /drones/{drone_id}/calibration", { path: { drone_id: droneId } });
}

/** Begin; with `goOn` the views so far count, too. @throws RequestError when it is refused. */
export async function startCalibration(droneId: string, goOn: boolean): Promise<Calibration> {
  return call("POST /drones/{drone_id}/calibration", { path: { drone_id: droneId }, body: { go_on: goOn } });
}

/** Collect no more and work the camera out. @throws RequestError when it is refused. */
export async function finishCalibration(droneId: string): Promise<Calibration> {
  return call("POST /drones/{drone_id}/calibration/finish", { path: { drone_id: droneId } });
}

/** Use the result from now on. @throws RequestError when it is refused. */
export async function applyCalibration(droneId: string): Promise<Calibration> {
  return call("POST /drones/{drone_id}/calibration/apply", { path: { drone_id: droneId } });
}

/** End it without a result. @throws RequestError when it is refused. */
export async function cancelCalibration(droneId: string): Promise<Calibration> {
  return call("DELETE /drones/{drone_id}/calibration", { path: { drone_id: droneId } });
}

function pathOf(droneId: string, rest: string): string {
  return `/drones/${encodeURIComponent(droneId)}/calibration${rest}`;
}

/** Where the board to print is. */
export function boardUrl(droneId: string, form: "png" | "pdf"): string {
  return `${BASE}/api/v1${pathOf(droneId, `/board.${form}`)}`;
}

/** Where the picture of what the kept views reached is; `key` tells one result from the next. */
export function coverageUrl(droneId: string, key: string): string {
  return `${BASE}/api/v1${pathOf(droneId, "/coverage.png")}?of=${encodeURIComponent(key)}`;
}
