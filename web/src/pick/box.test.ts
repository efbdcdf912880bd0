import { describe, expect, it } from "vitest";
import { boxBetween, isBox, MIDDLE, nudged, placeOf, shareAt, type ShareBox } from "./box";

const AREA = { left: 100, top: 50, width: 400, height: 300 };

describe("shareAt", () => {
  it("counts from the picture's corner", () => {
    expect(shareAt(100, 50, AREA)).toEqual({ x: 0, y: 0 });
    expect(shareAt(200, 200, AREA)).toEqual({ x: 0.25, y: 0.5 });
  });

  it("stays in the picture when the pointer leaves it", () => {
    expect(shareAt(-1000, 9999, AREA)).toEqual({ x: 0, y: 1 });
  });
});

describe("placeOf", () => {
  it("takes a press that hardly moved for a click", () => {
    const place = placeOf({ x: 0.5, y: 0.5 }, { x: 0.51, y: 0.51 }, AREA);
    expect(place).toEqual({ kind: "point", point: { x: 0.51, y: 0.51 } });
  });

  it("takes a drag for a box, whichever way it was drawn", () => {
    const [a, b] = [{ x: 0.75, y: 0.25 }, { x: 0.25, y: 0.5 }];
    const place = { kind: "box", box: [0.25, 0.25, 0.75, 0.5] };
    expect(placeOf(a, b, AREA)).toEqual(place);
    expect(placeOf(b, a, AREA)).toEqual(place);
  });

  it("takes a line for nothing", () => {
    expect(placeOf({ x: 0.2, y: 0.5 }, { x: 0.8, y: 0.5 }, AREA)).toBeNull();
  });
});

describe("nudged", () => {
  it("moves the box and keeps its size at the picture's edge", () => {
    let box: ShareBox = MIDDLE;
    for (let i = 0; i < 100; i += 1) box = nudged(box, "ArrowRight", false) ?? box;
    expect(box[2]).toBeCloseTo(1);
    expect(box[2] - box[0]).toBeCloseTo(MIDDLE[2] - MIDDLE[0]);
  });

  it("resizes the box but never turns it inside out", () => {
    let box: ShareBox = MIDDLE;
    for (let i = 0; i < 100; i += 1) {
      box = nudged(box, "ArrowUp", true) ?? box;
      box = nudged(box, "ArrowLeft", true) ?? box;
    }
    expect(box.slice(0, 2)).toEqual(MIDDLE.slice(0, 2));
    expect(isBox([box[0], box[1], box[2] + 1e-9, box[3] + 1e-9])).toBe(true);
  });

  it("leaves other keys alone", () => {
    expect(nudged(MIDDLE, "Enter", false)).toBeNull();
    expect(nudged(MIDDLE, "toString", false)).toBeNull();
  });
});

describe("boxBetween", () => {
  it("orders the corners", () => {
    expect(boxBetween({ x: 1, y: 0 }, { x: 0, y: 1 })).toEqual([0, 0, 1, 1]);
  });
});
