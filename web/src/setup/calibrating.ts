import type { CalibratedCamera, Calibration } from "../api/calibration";

/** A cell of the picture, counted from its top left. */
export interface CoverageCell {
  readonly key: string;
  readonly column: number;
  readonly row: number;
  readonly covered: boolean;
}

/** From this error on a result is worse than video need be, pixels. */
const GOOD_PX = 0.5;
/** A drone that stands gets hot: from here on it wants a rest. */
const REST_S = 180;

/** True while views are collected or the camera is worked out. */
export function goesOn({ state }: Calibration): boolean {
  return state === "collecting" || state === "solving";
}

export function coverageCells(coverage: Calibration["coverage"]): readonly CoverageCell[] {
  return coverage.flatMap((line, row) =>
    line.map((corners, column) => ({ key: `${row} ${column}`, column, row, covered: corners > 0 })),
  );
}

/** The share of the picture that views have reached, 0 to 1. */
export function coverageShare(coverage: Calibration["coverage"]): number {
  const cells = coverageCells(coverage);
  return cells.length === 0 ? 0 : cells.filter((cell) => cell.covered).length / cells.length;
}

/** A time as minutes and seconds. */
export function clockText(seconds: number): string {
  const whole = Math.max(0, Math.floor(seconds));
  return `${Math.floor(whole / 60)}:${String(whole % 60).padStart(2, "0")}`;
}

/** True when the drone has streamed so long on the ground that it should rest. */
export function wantsRest(calibration: Calibration): boolean {
  return calibration.state === "collecting" && calibration.spent_s >= REST_S;
}

/** True for a camera that is known as well as its video allows. */
export function isGood(camera: CalibratedCamera): boolean {
  return camera.mean_px <= GOOD_PX;
}

/** True when views that are there may be added to. */
export function canGoOn(calibration: Calibration): boolean {
  return !goesOn(calibration) && calibration.state !== "idle" && calibration.views > 0;
}

/** The last part of a path, of whichever system. */
export function fileName(path: string): string {
  return path.split(/[\\/]/).at(-1) ?? path;
}
