import { describe, expect, it } from "vitest";
import { endsOf, isEnough, nextEnd, placeInPicture, within, withMark, type Mark } from "./marks";

const WHOLE = { width: 960, height: 720 };

describe("marks of a known length", () => {
  it("replaces an older mark of the same end in the same picture", () => {
    const first: Mark = { end: 0, picture: 3, x: 1, y: 2 };
    const moved: Mark = { end: 0, picture: 3, x: 5, y: 6 };
    const other: Mark = { end: 1, picture: 3, x: 7, y: 8 };
    expect(withMark([first, other], moved)).toEqual([other, moved]);
  });

  it("goes on with the end that is missing in a picture", () => {
    const a: Mark = { end: 0, picture: 0, x: 0, y: 0 };
    const b: Mark = { end: 1, picture: 0, x: 0, y: 0 };
    expect(nextEnd([], 0, 1)).toBe(0);
    expect(nextEnd([a], 0, 0)).toBe(1);
    expect(nextEnd([a, b], 0, 0)).toBe(0);
    expect(nextEnd([a, b], 0, 1)).toBe(1);
    expect(nextEnd([a, b], 1, 1)).toBe(0);
  });

  it("asks for either end in two pictures", () => {
    const marks: readonly Mark[] = [
      { end: 0, picture: 0, x: 0, y: 0 },
      { end: 1, picture: 0, x: 0, y: 0 },
      { end: 0, picture: 6, x: 0, y: 0 },
    ];
    expect(isEnough(marks)).toBe(false);
    expect(isEnough([...marks, { end: 1, picture: 6, x: 0, y: 0 }])).toBe(true);
  });

  it("turns a click into pixels of the picture, whose centres are whole", () => {
    expect(placeInPicture(0.25, 0.25, { width: 480, height: 360 }, WHOLE)).toEqual({ x: 0, y: 0 });
    expect(placeInPicture(240, 180, { width: 480, height: 360 }, WHOLE)).toEqual({ x: 479.5, y: 359.5 });
    expect(placeInPicture(-5, 999, { width: 480, height: 360 }, WHOLE)).toEqual({ x: 0, y: 719 });
  });

  it("keeps a place inside the picture", () => {
    expect(within({ x: -1, y: 1000 }, WHOLE)).toEqual({ x: 0, y: 719 });
  });

  it("sorts marks by end", () => {
    expect(
      endsOf([
        { end: 1, picture: 2, x: 3, y: 4 },
        { end: 0, picture: 1, x: 5, y: 6 },
      ]),
    ).toEqual([[{ picture: 1, x: 5, y: 6 }], [{ picture: 2, x: 3, y: 4 }]]);
  });
});
