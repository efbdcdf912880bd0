import { expect, it } from "vitest";
import { seriesFromLog } from "./course";

const line = (stage: string, seconds: number, psnr: number | null) =>
  JSON.stringify({ event: "progressed", stage, seconds, loss: 0.1, psnr_db: psnr, held_out_psnr_db: null });

it("draws the curves of a training that nobody watched", () => {
  const log = [
    line("refine", 4, null),
    JSON.stringify({ event: "preview", file: "preview.jpg" }),
    line("train", 1, 12),
    line("train", 2, 15),
    line("train", 3, 16).slice(0, 20),
  ].join("\n");
  const series = seriesFromLog(log);
  expect(series.seconds).toEqual([1, 2]);
  expect(series.trainDb).toEqual([12, 15]);
  expect(series.stages.map((stage) => stage.name)).toEqual(["train"]);
});
