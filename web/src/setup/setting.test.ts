import { describe, expect, it } from "vitest";
import type { Setting } from "../api/setup";
import { boundsText, matches, valueText } from "./setting";

const setting: Setting = {
  group: "safety",
  name: "fence_radius_m",
  value: 4.5,
  default: 4.5,
  meaning: "Drones stay within this distance.",
  variable: "DRONERF_SAFETY__FENCE_RADIUS_M",
  least: null,
  more_than: null,
  most: null,
};

describe("a setting", () => {
  it.each([
    [0.1 + 0.2, "0.3"],
    [true, "yes"],
    ["", "–"],
    [[1, 1.15], "1, 1.15"],
    [{ hold: 1, land: 3 }, "hold 1, land 3"],
    [{}, "–"],
    [null, "–"],
  ])("%j reads %s", (value, text) => {
    expect(valueText(value)).toBe(text);
  });

  it("says what it may be", () => {
    expect(boundsText(setting)).toBe("");
    expect(boundsText({ ...setting, more_than: 0 })).toBe("More than 0");
    expect(boundsText({ ...setting, more_than: 0, most: 3 })).toBe("More than 0, at most 3");
    expect(boundsText({ ...setting, least: 1, most: 3 })).toBe("1 to 3");
    expect(boundsText({ ...setting, least: 1 })).toBe("At least 1");
    expect(boundsText({ ...setting, most: 1 })).toBe("At most 1");
  });

  it("is found by any words of it", () => {
    expect(matches(setting, "")).toBe(true);
    expect(matches(setting, "FENCE distance")).toBe(true);
    expect(matches(setting, "fence battery")).toBe(false);
  });
});
