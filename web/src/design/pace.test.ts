import { describe, expect, it } from "vitest";
import { secondsLeft, stillLeft } from "./pace";

describe("secondsLeft", () => {
  it("goes on at the pace that was seen, wherever it began", () => {
    expect(secondsLeft({ share: 0, atS: 100 }, { share: 0.25, atS: 110 })).toBe(30);
    expect(secondsLeft({ share: 0.5, atS: 0 }, { share: 0.75, atS: 10 })).toBe(10);
  });

  it("says nothing before there is a pace", () => {
    expect(secondsLeft({ share: 0.1, atS: 5 }, { share: 0.1, atS: 5 })).toBeNull();
    expect(secondsLeft({ share: 0, atS: 5 }, { share: 0.3, atS: 5.2 })).toBeNull();
    expect(secondsLeft({ share: 0.3, atS: 5 }, { share: 0.3, atS: 50 })).toBeNull();
    expect(secondsLeft({ share: 0.9, atS: 5 }, { share: 0.1, atS: 9 })).toBeNull();
  });

  it("has nothing left of what is done", () => {
    expect(secondsLeft({ share: 1, atS: 5 }, { share: 1, atS: 5 })).toBe(0);
  });
});

describe("stillLeft", () => {
  it("counts down what was told", () => {
    expect(stillLeft(12, 2)).toEqual({ kind: "left", seconds: 10 });
    expect(stillLeft(1, 2)).toEqual({ kind: "due", seconds: 0 });
    expect(stillLeft(null, 2)).toBeNull();
  });

  it("does not go on promising when nothing more is heard", () => {
    expect(stillLeft(60, 7.4)).toEqual({ kind: "silent", seconds: 7 });
    expect(stillLeft(null, 7.4)).toEqual({ kind: "silent", seconds: 7 });
    expect(stillLeft(60, 61)).toBeNull();
  });
});
