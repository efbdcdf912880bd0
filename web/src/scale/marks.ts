/** Which end of the known length a mark is of. */
export type End = 0 | 1;

/** A place in a picture, pixels of the picture itself. */
export interface Place {
  readonly x: number;
  readonly y: number;
}

/** One end in one picture. */
export interface Mark extends Place {
  readonly end: End;
  readonly picture: number;
}

/** The marks with `mark` in the place of an older one of the same end in the same picture. */
export function withMark(marks: readonly Mark[], mark: Mark): readonly Mark[] {
  return [...marks.filter((each) => each.end !== mark.end || each.picture !== mark.picture), mark];
}

/** The end to be marked next in a picture: the first that is missing there, else the one chosen now. */
export function nextEnd(marks: readonly Mark[], picture: number, now: End): End {
  const there = marks.filter((each) => each.picture === picture).map((each) => each.end);
  if (!there.includes(0)) return 0;
  return there.includes(1) ? now : 1;
}

/** Whether either end is marked in two pictures or more. */
export function isEnough(marks: readonly Mark[]): boolean {
  return ([0, 1] as const).every((end) => marks.filter((each) => each.end === end).length >= 2);
}

/** What a click at `x`, `y` in a shown picture of `shown` size means in one of `whole` size; pixel centres are whole. */
export function placeInPicture(
  x: number,
  y: number,
  shown: { readonly width: number; readonly height: number },
  whole: { readonly width: number; readonly height: number },
): Place {
  return within({ x: (x * whole.width) / shown.width - 0.5, y: (y * whole.height) / shown.height - 0.5 }, whole);
}

/** The place moved into the picture. */
export function within(place: Place, whole: { readonly width: number; readonly height: number }): Place {
  return {
    x: Math.min(Math.max(place.x, 0), whole.width - 1),
    y: Math.min(Math.max(place.y, 0), whole.height - 1),
  };
}

/** The marks as the server takes them. */
export function endsOf(marks: readonly Mark[]): readonly [readonly Omit<Mark, "end">[], readonly Omit<Mark, "end">[]] {
  const of = (end: End) =>
    marks.filter((each) => each.end === end).map(({ picture, x, y }) => ({ picture, x, y }));
  return [of(0), of(1)];
}
