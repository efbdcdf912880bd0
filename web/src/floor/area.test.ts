import { describe, expect, it } from "vitest";
import { areaBetween, isArea, moved } from "./area";

describe("a rectangle of the floor", () => {
  it("is the same whichever way it is drawn, and keeps to the grid", () => {
    const wanted = [-1, 0.5, 0.25, 2];
    expect(areaBetween([-1.01, 0.51], [0.26, 1.99])).toEqual(wanted);
    expect(areaBetween([0.26, 0.51], [-1.01, 1.99])).toEqual(wanted);
  });

  it("moves with what is dragged and keeps its size", () => {
    expect(moved([0.1, 0.2, 1.1, 0.7], [0, 0], [0.31, -1.02])).toEqual([0.4, -0.8, 1.4, -0.3]);
    expect(moved([0.123, 0.2, 1.1, 0.7], [2, 2], [2.01, 2.01])).toEqual([0.123, 0.2, 1.1, 0.7]);
  });

  it("needs two sides", () => {
    expect(isArea([0, 0, 0, 1])).toBe(false);
    expect(isArea([0.25, 0.2, 0.3, 0.25])).toBe(true);
    expect(isArea([1, 0, 0, 1])).toBe(false);
  });
});
