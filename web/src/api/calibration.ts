import { BASE } from "./base";
import { request } from "./request";

export type CalibrationState = "idle" | "collecting" | "solving" | "solved" | "refused" | "ended";

/** What whoever holds the board shall do next; a side: show it at that side of the picture. */
export type CalibrationHint =
  | "show_board"
  | "hold_still"
  | "blurred"
  | "left"
  | "right"
  | "top"
  | "bottom"
  | "tilt_sideways"
  | "tilt_up_down"
  | "nearer"
  | "another";

/** What the views of a refused calibration lack. */
export type CalibrationLack =
  | "few_views"
  | "one_sided"
  | "coverage"
  | "flat"
  | "disagree"
  | "contradict"
  | "uncertain"
  | "undetermined"
  | "sizes";

/** Why a calibration ended without a result. */
export type CalibrationEnding = "cancelled" | "capture" | "flight" | "offline" | "closed" | "failed";

/** A camera as its views have it, in pixels of its own picture. */
export interface CalibratedCamera {
  readonly width: number;
  readonly height: number;
  readonly fx: number;
  readonly fy: number;
  readonly cx: number;
  readonly cy: number;
  readonly fx_sd: number;
  /** OpenCV's k1, k2, p1, p2, k3. */
  readonly distortion: readonly number[];
  readonly mean_px: number;
  readonly rms_px: number;
  readonly views_kept: number;
  readonly views_dropped: number;
  /** Share of the picture that kept views reach, 0 to 1. */
  readonly coverage: number;
  /** How far they are tilted at most, sideways and up or down. */
  readonly tilts_deg: readonly [number, number];
  /** The same as a piece of a fleet file. */
  readonly toml: string;
}

/** A result that the console uses since; `problem` says why it is not in the fleet file. */
export interface CalibrationUse {
  readonly file: string | null;
  readonly backup: string | null;
  readonly problem: string;
}

/** The newest calibration of a drone's camera. */
export interface Calibration {
  readonly drone_id: string;
  readonly state: CalibrationState;
  readonly views: number;
  readonly views_wanted: number;
  readonly views_least: number;
  /** Corners of kept views in each cell of the picture, row by row. */
  readonly coverage: readonly (readonly number[])[];
  /** How many views are tilted sideways and how many up or down. */
  readonly tilted: readonly [number, number];
  readonly tilted_wanted: number;
  /** Null while no picture comes, and when none is looked at. */
  readonly hint: CalibrationHint | null;
  readonly spent_s: number;
  readonly lack: CalibrationLack | null;
  readonly ending: CalibrationEnding | null;
  readonly reason: string;
  readonly result: CalibratedCamera | null;
  readonly applied: CalibrationUse | null;
  /** The fleet file that a result would be written into, null without one. */
  readonly file: string | null;
}

function pathOf(droneId: string, rest = ""): string {
  return `/drones/${encodeURIComponent(droneId)}/calibration${rest}`;
}

/** @throws RequestError when it is not answered. */
export async function getCalibration(droneId: string): Promise<Calibration> {
  return (await request("GET", pathOf(droneId))) as Calibration;
}

/** Begin; with `goOn` the views so far count, too. @throws RequestError when it is refused. */
export async function startCalibration(droneId: string, goOn: boolean): Promise<Calibration> {
  return (await request("POST", pathOf(droneId), { go_on: goOn })) as Calibration;
}

/** Collect no more and work the camera out. @throws RequestError when it is refused. */
export async function finishCalibration(droneId: string): Promise<Calibration> {
  return (await request("POST", pathOf(droneId, "/finish"))) as Calibration;
}

/** Use the result from now on. @throws RequestError when it is refused. */
export async function applyCalibration(droneId: string): Promise<Calibration> {
  return (await request("POST", pathOf(droneId, "/apply"))) as Calibration;
}

/** End it without a result. @throws RequestError when it is refused. */
export async function cancelCalibration(droneId: string): Promise<Calibration> {
  return (await request("DELETE", pathOf(droneId))) as Calibration;
}

/** Where the board to print is. */
export function boardUrl(droneId: string, form: "png" | "pdf"): string {
  return `${BASE}/api/v1${pathOf(droneId, `/board.${form}`)}`;
}

/** Where the picture of what the kept views reached is; `key` tells one result from the next. */
export function coverageUrl(droneId: string, key: string): string {
  return `${BASE}/api/v1${pathOf(droneId, "/coverage.png")}?of=${encodeURIComponent(key)}`;
}
