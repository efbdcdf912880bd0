import { describe, expect, it } from "vitest";
import { age, clock, count, power, timeOfDay, withUnit } from "./format";

describe("format", () => {
  it.each([
    [null, "–"],
    [-0.2, "0.0 s"],
    [0.04, "0.0 s"],
    [9.94, "9.9 s"],
    [9.96, "10 s"],
    [119, "119 s"],
    [600, "10 min"],
  ])("age of %s is %s", (seconds, text) => {
    expect(age(seconds)).toBe(text);
  });

  it.each([
    [0, "0:00"],
    [59.6, "1:00"],
    [605, "10:05"],
    [3725, "1:02:05"],
    [-4, "0:00"],
  ])("clock of %s is %s", (seconds, text) => {
    expect(clock(seconds)).toBe(text);
  });

  it.each([
    [0, "0"],
    [999, "999"],
    [1000, "1.00 k"],
    [999_400, "999 k"],
    [999_600, "1.00 M"],
    [6_420_000, "6.42 M"],
  ])("count of %s is %s", (value, text) => {
    expect(count(value)).toBe(text);
  });

  it("a power of ten is told by its exponent, an unmarked tick by nothing", () => {
    expect([0.001, 1, null].map(power)).toEqual(["1e-3", "1e+0", ""]);
  });

  it("shows a dash without a unit where there is no value", () => {
    expect(withUnit(null, 2, "m")).toBe("–");
    expect(withUnit(1.005, 1, "m")).toBe("1.0 m");
  });

  it("shows a moment it cannot read as it is", () => {
    expect(timeOfDay("yesterday")).toBe("yesterday");
  });
});
