import type { CalibratedCamera, Calibration } from "../api/calibration";

/** A cell of the picture, counted from its top left. */
interface CoverageCell {
  readonly key: string;
  readonly column: number;
  readonly row: number;
  readonly covered: boolean;
}

/** What the manual calls good: views, pixels, per cent of the focal length and of the picture, degrees, views. */
export const GOOD = { views: 20, error: 0.5, focal: 0.3, coverage: 80, tilts: 25, dropped: 2 } as const;
type Want = keyof typeof GOOD;
/** Refused for one of these, more views do not help: those that are there stay. */
const LOST: readonly Calibration["lack"][] = ["sizes", "contradict", "disagree"];
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

/** True when the drone has streamed so long on the ground that it should rest. */
export function wantsRest(calibration: Calibration): boolean {
  return calibration.state === "collecting" && calibration.spent_s >= REST_S;
}

/** What a camera misses to be known as well as its video allows. */
export function missed(camera: CalibratedCamera): readonly Want[] {
  const met: Readonly<Record<Want, boolean>> = {
    views: camera.views_kept >= GOOD.views,
    error: camera.mean_px < GOOD.error,
    focal: 100 * camera.fx_sd <= GOOD.focal * camera.fx,
    coverage: 100 * camera.coverage > GOOD.coverage,
    tilts: Math.min(...camera.tilts_deg) > GOOD.tilts,
    dropped: camera.views_dropped <= GOOD.dropped,
  };
  return (Object.keys(GOOD) as Want[]).filter((want) => !met[want]);
}

/** True when views that are there may be added to. */
export function canGoOn(calibration: Calibration): boolean {
  const { state, views, lack } = calibration;
  return !goesOn(calibration) && state !== "idle" && views > 0 && !LOST.includes(lack);
}

/** The last part of a path, of whichever system. */
export function fileName(path: string): string {
  return path.split(/[\\/]/).at(-1) ?? path;
}
