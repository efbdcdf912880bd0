import type { Artifact, CaptureEntry, CaptureFile, RunMetrics } from "../api/library";
import type { Training } from "../api/trainings";
import { moment } from "../design/format";
import { words } from "../text/words";
import { readFieldKey } from "./fieldKey";

/** A field to compare: a capture's own, or one trained anew on its pictures. */
export interface Field {
  /** Of the run folder with its files. */
  readonly id: string;
  readonly name: string;
  readonly entry: CaptureEntry;
  readonly training: Training | null;
}

/** What people call a field. */
export function fieldName(entry: CaptureEntry, training: Training | null): string {
  const name = entry.name === "" ? entry.id : entry.name;
  return training === null ? name : words.library.anew(name, moment(training.created_at));
}

/** What a marked field is called where its training is not at hand: by the training's run folder. */
export function markName(key: string, captures: readonly CaptureEntry[]): string {
  const { capture, training } = readFieldKey(key);
  const entry = captures.find(({ id }) => id === capture);
  const name = entry === undefined ? capture : fieldName(entry, null);
  return training === null ? name : words.library.anew(name, training);
}

function metricsOf({ entry, training }: Field): RunMetrics | null {
  return training === null ? entry.metrics : training.metrics;
}

/** Whether two fields are judged in the same way: one that shows the object alone is judged before white. */
export function judgedAlike(a: Field, b: Field): boolean {
  return (a.training?.object_only ?? false) === (b.training?.object_only ?? false);
}

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

/** One figure of two fields. */
export interface Difference {
  readonly key: "psnr" | "psnrObject" | "ssim" | "flip" | "images" | "heldOut" | "flight" | "training" | "seed";
  readonly a: number | null;
  readonly b: number | null;
  readonly digits: number;
  readonly unit: string;
  /** Which way is better; null where neither is. */
  readonly better: "more" | "less" | null;
}

/** The figures of two fields side by side; the files are those of their captures. */
export function differences(
  a: Field,
  b: Field,
  fileA: CaptureFile | null,
  fileB: CaptureFile | null,
): readonly Difference[] {
  const whole = judgedAlike(a, b);
  const more = whole ? "more" : null;
  const both = (pick: (field: Field, file: CaptureFile | null) => number | null | undefined) => ({
    a: pick(a, fileA) ?? null,
    b: pick(b, fileB) ?? null,
  });
  return [
    { key: "psnr", ...both((field) => metricsOf(field)?.psnr_db), digits: 2, unit: "dB", better: more },
    { key: "psnrObject", ...both((field) => metricsOf(field)?.psnr_db_object), digits: 2, unit: "dB", better: "more" },
    { key: "ssim", ...both((field) => metricsOf(field)?.ssim), digits: 3, unit: "", better: more },
    { key: "flip", ...both((field) => metricsOf(field)?.flip), digits: 3, unit: "", better: whole ? "less" : null },
    { key: "images", ...both((field) => field.entry.images), digits: 0, unit: "", better: null },
    { key: "heldOut", ...both((field) => metricsOf(field)?.images_held_out), digits: 0, unit: "", better: null },
    { key: "flight", ...both((_, file) => flightSeconds(file?.seconds)), digits: 0, unit: "s", better: "less" },
    {
      key: "training",
      ...both(({ training }, file) => (training === null ? file?.request?.train_seconds : training.seconds)),
      digits: 0,
      unit: "s",
      better: null,
    },
    {
      key: "seed",
      ...both(({ training }, file) => (training === null ? file?.request?.seed : training.seed)),
      digits: 0,
      unit: "",
      better: null,
    },
  ];
}

/** Which field a figure speaks for; null where it speaks for neither, or they show the same. */
export function winner({ a, b, better, digits }: Difference): "a" | "b" | null {
  if (a === null || b === null || better === null || a.toFixed(digits) === b.toFixed(digits)) return null;
  return a > b === (better === "more") ? "a" : "b";
}
