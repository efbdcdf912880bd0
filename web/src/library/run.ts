import type { Artifact, CaptureEntry, CaptureFile } from "../api/library";

/** A run's files by their first folder, those of the run folder itself first. */
export function filesByFolder(
  files: readonly Artifact[],
): readonly { readonly folder: string; readonly files: readonly Artifact[] }[] {
  const folders = new Map<string, Artifact[]>([["", []]]);
  for (const file of files) {
    const cut = file.path.indexOf("/");
    const folder = cut < 0 ? "" : file.path.slice(0, cut);
    folders.set(folder, [...(folders.get(folder) ?? []), file]);
  }
  return [...folders]
    .filter(([, inside]) => inside.length > 0)
    .map(([folder, inside]) => ({ folder, files: inside }));
}

/** Seconds from the checklist to the landing; null where the run does not tell. */
export function flightSeconds(seconds: CaptureFile["seconds"]): number | null {
  if (seconds === undefined) return null;
  const flown = Object.entries(seconds).filter(([phase]) => phase !== "train" && phase !== "grounded");
  return flown.length === 0 ? null : flown.reduce((sum, [, value]) => sum + value, 0);
}

/** One figure of two runs. */
export interface Difference {
  readonly key: "psnr" | "psnrObject" | "ssim" | "flip" | "images" | "heldOut" | "flight" | "training" | "seed";
  readonly a: number | null;
  readonly b: number | null;
  readonly digits: number;
  readonly unit: string;
  /** Which way is better; null where neither is. */
  readonly better: "more" | "less" | null;
}

/** The figures of two runs side by side. */
export function differences(
  a: CaptureEntry,
  b: CaptureEntry,
  fileA: CaptureFile | null,
  fileB: CaptureFile | null,
): readonly Difference[] {
  const both = (pick: (entry: CaptureEntry, file: CaptureFile | null) => number | null | undefined) => ({
    a: pick(a, fileA) ?? null,
    b: pick(b, fileB) ?? null,
  });
  return [
    { key: "psnr", ...both((run) => run.metrics?.psnr_db), digits: 2, unit: "dB", better: "more" },
    { key: "psnrObject", ...both((run) => run.metrics?.psnr_db_object), digits: 2, unit: "dB", better: "more" },
    { key: "ssim", ...both((run) => run.metrics?.ssim), digits: 3, unit: "", better: "more" },
    { key: "flip", ...both((run) => run.metrics?.flip), digits: 3, unit: "", better: "less" },
    { key: "images", ...both((run) => run.images), digits: 0, unit: "", better: null },
    { key: "heldOut", ...both((run) => run.metrics?.images_held_out), digits: 0, unit: "", better: null },
    { key: "flight", ...both((_, file) => flightSeconds(file?.seconds)), digits: 0, unit: "s", better: "less" },
    { key: "training", ...both((_, file) => file?.request?.train_seconds), digits: 0, unit: "s", better: null },
    { key: "seed", ...both((_, file) => file?.request?.seed), digits: 0, unit: "", better: null },
  ];
}

/** Which run a figure speaks for; null where it speaks for neither, or they show the same. */
export function winner({ a, b, better, digits }: Difference): "a" | "b" | null {
  if (a === null || b === null || better === null || a.toFixed(digits) === b.toFixed(digits)) return null;
  return a > b === (better === "more") ? "a" : "b";
}
