import { describe, expect, it } from "vitest";
import type { CalibratedCamera, Calibration } from "../api/calibration";
import { de } from "../text/de";
import { en } from "../text/en";
import {
  canGoOn,
  coverageCells,
  coverageShare,
  fileName,
  goesOn,
  GOOD,
  missed,
  wantsRest,
} from "./calibrating";

const IDLE: Calibration = {
  drone_id: "drone-1",
  state: "idle",
  board: "charuco:7x5:38:28",
  views: 0,
  views_wanted: 25,
  views_least: 10,
  coverage: [
    [0, 3],
    [0, 0],
  ],
  tilted: [0, 0],
  tilted_wanted: 4,
  hint: null,
  spent_s: 0,
  lack: null,
  ending: null,
  reason: "",
  result: null,
  applied: null,
  file: null,
};

describe("a calibration under way", () => {
  it("covers cells of the picture, counted from its top left", () => {
    expect(coverageCells(IDLE.coverage).filter((cell) => cell.covered)).toEqual([
      { key: "0 1", column: 1, row: 0, covered: true },
    ]);
    expect(coverageShare(IDLE.coverage)).toBe(0.25);
    expect(coverageShare([])).toBe(0);
  });

  it("lets a drone rest after three minutes", () => {
    const collecting: Calibration = { ...IDLE, state: "collecting", spent_s: 200 };
    expect(wantsRest(collecting)).toBe(true);
    expect(wantsRest({ ...collecting, spent_s: 100 })).toBe(false);
    expect(wantsRest({ ...collecting, state: "solved" })).toBe(false);
  });

  it("can be gone on with once it is over and has views", () => {
    const refused: Calibration = { ...IDLE, state: "refused", views: 4 };
    expect(goesOn(refused)).toBe(false);
    expect(canGoOn(refused)).toBe(true);
    expect(canGoOn({ ...refused, views: 0 })).toBe(false);
    expect(canGoOn({ ...refused, state: "collecting" })).toBe(false);
    expect(goesOn({ ...refused, state: "solving" })).toBe(true);
  });

  it("is not gone on with where its views would be refused again", () => {
    const refused: Calibration = { ...IDLE, state: "refused", views: 12 };
    for (const lack of ["sizes", "contradict", "disagree"] as const) {
      expect(canGoOn({ ...refused, lack }), lack).toBe(false);
      for (const { calibrating } of [en.setup, de.setup]) expect(calibrating.lack[lack]).toMatch(/(Begin anew|Beginn neu)\.$/);
    }
    expect(canGoOn({ ...refused, lack: "flat" })).toBe(true);
  });
});

describe("a calibrated camera", () => {
  const camera: CalibratedCamera = {
    width: 960,
    height: 720,
    fx: 920,
    fy: 921,
    cx: 480,
    cy: 360,
    fx_sd: 2,
    distortion: [0, 0, 0, 0, 0],
    terms_fixed: [],
    mean_px: 0.31,
    rms_px: 0.35,
    views_kept: 23,
    views_dropped: 2,
    coverage: 0.92,
    tilts_deg: [31, 28],
    toml: "",
  };

  it("is good when nothing is missing that the manual wants", () => {
    expect(missed(camera)).toEqual([]);
  });

  it.each([
    ["views", { views_kept: 19 }],
    ["error", { mean_px: 0.5 }],
    ["focal", { fx_sd: 3 }],
    ["coverage", { coverage: 0.8 }],
    ["tilts", { tilts_deg: [31, 24] }],
    ["tilts", { tilts_deg: [25, 31] }],
    ["dropped", { views_dropped: 3 }],
  ] as const)("says that it misses: %s", (want, change) => {
    expect(missed({ ...camera, ...change })).toEqual([want]);
    for (const { calibrating } of [en.setup, de.setup]) {
      expect(calibrating.wants[want](GOOD[want])).toContain(String(GOOD[want]));
    }
  });

  it("goes into a file that is known by its name", () => {
    expect(["/etc/dronerf/fleet.toml", "C:\\us\\fleet.toml", "fleet.toml"].map(fileName)).toEqual(
      Array(3).fill("fleet.toml"),
    );
  });
});

describe("the words of a calibration", () => {
  it("have three steps and say what to do about whatever is lacking", () => {
    for (const { calibrating } of [en.setup, de.setup]) {
      expect(calibrating.steps).toHaveLength(3);
      for (const lack of Object.values(calibrating.lack)) expect(lack).toMatch(/\. .+\.$/);
    }
  });
});
