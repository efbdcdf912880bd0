import type { MetricsReport, PictureReport, PosesReport, TrainingReport } from "../protocol/messages.gen";

/** What became of a picture of the capture. */
interface PictureState {
  /** Kept from the training that is judged, to judge it on. */
  readonly heldOut: boolean;
  /** `waiting` before the poses were refined; `flight` kept the pose believed in flight. */
  readonly pose: "waiting" | "refined" | "flight";
  readonly used: boolean;
}

/** Every eighth picture in file order is held out, the first one included. */
const HELD_OUT_EVERY = 8;

/** Return what became of picture `index`, as far as the mission has told. */
export function pictureState(
  index: number,
  poses: PosesReport | null,
  training: TrainingReport | null,
  metrics: MetricsReport | null,
): PictureState {
  const judged = metrics !== null || training?.stage === "train" || training?.stage === "evaluate";
  const delivered = training?.stage === "deliver";
  const heldOut = judged && index % HELD_OUT_EVERY === 0;
  const pose = poses === null ? "waiting" : poses.unrefined.includes(index) ? "flight" : "refined";
  const counted = index < (training?.images ?? metrics?.images ?? 0);
  return { heldOut, pose, used: counted && (delivered || metrics !== null || !heldOut) };
}

/**
 * Less sharp than this share of its drone's median, a picture is blurred. Sharp pictures of one object
 * stay above two thirds of it from all sides; a smear of a sixtieth of the picture's width halves it.
 */
const BLURRED_BELOW = 0.5;
/** A median of fewer pictures says little. */
const LEAST_MEASURED = 3;

/**
 * Return the indices of the blurred pictures.
 *
 * Each is compared with those of its own drone, which sees the object from one side and with one lens.
 */
export function blurredPictures(
  pictures: readonly Pick<PictureReport, "index" | "drone_id" | "sharpness">[],
): ReadonlySet<number> {
  const measured = new Map<string, number[]>();
  for (const { drone_id, sharpness } of pictures) {
    if (sharpness !== null) measured.set(drone_id, [...(measured.get(drone_id) ?? []), sharpness]);
  }
  const blurred = pictures.filter(({ drone_id, sharpness }) => {
    const others = measured.get(drone_id) ?? [];
    return sharpness !== null && others.length >= LEAST_MEASURED && sharpness < BLURRED_BELOW * median(others);
  });
  return new Set(blurred.map(({ index }) => index));
}

function median(values: readonly number[]): number {
  const sorted = values.toSorted((a, b) => a - b);
  return sorted[Math.floor(sorted.length / 2)] ?? NaN;
}
