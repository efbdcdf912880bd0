import type { CaptureRequest, Mode } from "../api/captures";
import { words } from "../text/words";

/** The capture form as it is typed. */
export interface Wish {
  readonly mode: Mode;
  readonly pictures: string;
  readonly trainSeconds: string;
  /** A number of drones, or empty for all. */
  readonly drones: string;
  readonly name: string;
}

export const FIRST_WISH: Wish = {
  mode: "optimized",
  pictures: "24",
  trainSeconds: "60",
  drones: "",
  name: "",
};

export const LIMITS = {
  pictures: { least: 4, most: 400 },
  /** No seconds at all take pictures only. */
  trainSeconds: { least: 1, most: 3600 },
  nameLength: 80,
} as const;

type WishErrors = Readonly<Partial<Record<"pictures" | "trainSeconds" | "name", string>>>;

/** Return what is wrong with a form, field by field; nothing when it can be sent. */
export function wishErrors(wish: Wish): WishErrors {
  const { pictures, trainSeconds, nameLength } = LIMITS;
  const errors: Partial<Record<"pictures" | "trainSeconds" | "name", string>> = {};
  const count = Number(wish.pictures);
  if (!Number.isInteger(count) || count < pictures.least || count > pictures.most) {
    errors.pictures = words.mission.form.whole(pictures.least, pictures.most);
  }
  const seconds = wish.trainSeconds.trim() === "" ? Number.NaN : Number(wish.trainSeconds);
  // Written so that NaN is refused as well.
  if (seconds !== 0 && !(seconds >= trainSeconds.least && seconds <= trainSeconds.most)) {
    errors.trainSeconds = words.mission.form.zeroOr(trainSeconds.least, trainSeconds.most);
  }
  if (wish.name.trim().length > nameLength) errors.name = words.mission.form.nameLong(nameLength);
  return errors;
}

/** The request for a form without errors. */
export function requestFromWish(wish: Wish): CaptureRequest {
  return {
    mode: wish.mode,
    pictures: Number(wish.pictures),
    train_seconds: Number(wish.trainSeconds),
    name: wish.name.trim(),
    ...(wish.drones === "" ? {} : { drones: Number(wish.drones) }),
  };
}
