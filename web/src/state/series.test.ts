import { describe, expect, it } from "vitest";
import type { TrainingReport } from "../protocol/messages.gen";
import { appendReport, EMPTY_SERIES, type QualitySeries } from "./series";

type Point = Pick<TrainingReport, "stage" | "seconds" | "psnr_db" | "held_out_psnr_db" | "held_out_ssim">;

function series(points: readonly Point[]): QualitySeries {
  let previous: TrainingReport | null = null;
  let all = EMPTY_SERIES;
  for (const point of points) {
    const report: TrainingReport = {
      type: "training_progressed",
      at: "",
      step: 0,
      seconds_total: null,
      loss: null,
      samples_per_s: 0,
      images: 24,
      ...point,
    };
    all = appendReport(all, previous, report);
    previous = report;
  }
  return all;
}

function point(stage: string, seconds: number, heldOut: number | null = null): Point {
  return { stage, seconds, psnr_db: seconds, held_out_psnr_db: heldOut, held_out_ssim: heldOut === null ? null : heldOut / 100 };
}

describe("appendReport", () => {
  it("puts stages in a row", () => {
    const all = series([point("live", 1), point("live", 4), point("train", 0.5), point("train", 2)]);
    expect(all.seconds).toEqual([1, 4, 4.5, 6]);
    expect(all.stages).toEqual([
      { name: "live", startS: 0 },
      { name: "train", startS: 4 },
    ]);
  });

  it("leaves out the time in which nothing is trained", () => {
    const all = series([point("live", 4), point("refine", 30), point("train", 2), point("film", 500)]);
    expect(all.seconds).toEqual([4, 6]);
    expect(all.stages.map((stage) => stage.name)).toEqual(["live", "train"]);
  });

  it("takes a clock that starts again for a new stage of the same name", () => {
    const all = series([point("train", 10), point("train", 1)]);
    expect(all.seconds).toEqual([10, 11]);
    expect(all.stages).toHaveLength(2);
  });

  it("keeps a held-out value once, where it was measured", () => {
    const all = series([point("train", 1), point("train", 2, 18), point("train", 3, 18), point("train", 4, 19)]);
    expect(all.heldOutDb).toEqual([null, 18, null, 19]);
    expect(all.heldOutSsim).toEqual([null, 0.18, null, 0.19]);
  });

  it("stays bounded for hours, in order, and keeps every held-out value", () => {
    const points = Array.from({ length: 9000 }, (_, index) =>
      point("train", index, index % 100 === 0 ? index : (Math.floor(index / 100) * 100)),
    );
    const all = series(points);
    expect(all.seconds.length).toBeLessThanOrEqual(2001);
    expect(all.trainDb).toHaveLength(all.seconds.length);
    expect(all.seconds.every((s, index) => index === 0 || s > (all.seconds[index - 1] ?? s))).toBe(true);
    expect(all.heldOutDb.filter((db) => db !== null)).toHaveLength(90);
    expect(all.heldOutSsim.filter((value) => value !== null)).toHaveLength(90);
    expect(all.seconds.at(-1)).toBe(8999);
  });
});
