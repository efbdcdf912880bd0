import { describe, expect, it } from "vitest";
import { errorColour, errorMap, LARGEST_ERROR } from "./errorMap";

const pixel = (red: number, green: number, blue: number) => Uint8ClampedArray.of(red, green, blue, 255);

describe("errorMap", () => {
  it("is dark where the pictures agree and brightest from the largest error on", () => {
    expect([...errorMap(pixel(9, 80, 200), pixel(9, 80, 200))]).toEqual([...errorColour(0), 255]);
    const large = Math.ceil(255 * LARGEST_ERROR);
    const brightest = [...errorColour(1), 255];
    expect([...errorMap(pixel(0, 0, 0), pixel(large, large, large))]).toEqual(brightest);
    expect([...errorMap(pixel(255, 255, 255), pixel(0, 0, 0))]).toEqual(brightest);
  });

  it("weighs all three channels alike", () => {
    const red = errorMap(pixel(0, 0, 0), pixel(60, 0, 0));
    expect(errorMap(pixel(0, 0, 60), pixel(0, 0, 0))).toEqual(red);
    expect([...red]).not.toEqual([...errorColour(0), 255]);
  });

  it("refuses pictures of different sizes", () => {
    expect(() => errorMap(pixel(0, 0, 0), new Uint8ClampedArray(8))).toThrow(RangeError);
  });
});
