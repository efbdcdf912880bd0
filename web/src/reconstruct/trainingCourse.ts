import type { TrainingReport } from "../protocol/messages.gen";
import { appendReport, EMPTY_SERIES, trains, type QualitySeries } from "../state/series";

/** What a line of the training's log has to hold to be a point of the curves. */
type Progress = Pick<TrainingReport, "stage" | "seconds" | "loss" | "psnr_db" | "held_out_psnr_db"> & {
  readonly event: "progressed";
};

/** What the logs of earlier versions do not tell. */
const UNTOLD: Pick<TrainingReport, "held_out_ssim"> = { held_out_ssim: null };

function isProgress(line: unknown): line is Progress {
  return typeof line === "object" && line !== null && (line as { event?: unknown }).event === "progressed";
}

/** What a training has told in all. */
export interface Course {
  readonly series: QualitySeries;
  /** Its last report while the field was trained, before that its last of all; null for none. */
  readonly last: TrainingReport | null;
}

export const NO_COURSE: Course = { series: EMPTY_SERIES, last: null };

/** What a training's log holds; the line that is being written is left out. */
export function courseFromLog(log: string): Course {
  let series = EMPTY_SERIES;
  let trained: TrainingReport | null = null;
  let previous: TrainingReport | null = null;
  for (const text of log.split("\n")) {
    let line: unknown;
    try {
      line = JSON.parse(text);
    } catch {
      continue;
    }
    if (!isProgress(line)) continue;
    const report = { ...UNTOLD, ...line } as unknown as TrainingReport;
    series = appendReport(series, previous, report);
    previous = report;
    if (trains(report.stage)) trained = report;
  }
  return { series, last: trained ?? previous };
}
