import { expect, it } from "vitest";
import { courseFromLog } from "./trainingCourse";

const line = (stage: string, seconds: number, psnr: number | null, more: object = {}) =>
  JSON.stringify({ event: "progressed", stage, seconds, loss: 0.1, psnr_db: psnr, held_out_psnr_db: null, ...more });

it("draws the curves of a training that nobody watched", () => {
  const log = [
    line("refine", 4, null),
    JSON.stringify({ event: "preview", file: "preview.jpg" }),
    line("train", 1, 12),
    line("train", 2, 15),
    line("train", 3, 16).slice(0, 20),
  ].join("\n");
  const { series } = courseFromLog(log);
  expect(series.seconds).toEqual([1, 2]);
  expect(series.trainDb).toEqual([12, 15]);
  expect(series.stages.map((stage) => stage.name)).toEqual(["train"]);
});

it("draws how alike the pictures are, where the log tells it", () => {
  const judged = (held_out_psnr_db: number, held_out_ssim: number) => ({ held_out_psnr_db, held_out_ssim });
  const told = [line("train", 1, 12, judged(18, 0.5)), line("train", 2, 15, judged(19, 0.6))].join("\n");
  expect(courseFromLog(told).series.heldOutSsim).toEqual([0.5, 0.6]);
  // An earlier version's log does not.
  expect(courseFromLog(line("train", 1, 12)).series.heldOutSsim).toEqual([null]);
});

it("ends with the figures of the last training, and not of the film after it", () => {
  expect(courseFromLog("").last).toBeNull();
  expect(courseFromLog(line("refine", 4, null)).last).toMatchObject({ stage: "refine" });
  const told = [line("train", 9, 15), line("deliver", 5, 18, { step: 800 }), line("film", 30, null, { step: 0 })];
  expect(courseFromLog(told.join("\n")).last).toMatchObject({ stage: "deliver", seconds: 5, step: 800 });
});
