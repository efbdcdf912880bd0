import type { TrainingReport } from "../protocol/messages.gen";

/** The quality of the field over training time, column by column as the plot wants it. */
export interface QualitySeries {
  /** Seconds of training since the first report, all stages in a row. */
  readonly seconds: readonly number[];
  readonly trainDb: readonly (number | null)[];
  readonly heldOutDb: readonly (number | null)[];
  readonly heldOutSsim: readonly (number | null)[];
  readonly loss: readonly (number | null)[];
  /** Where stages began. */
  readonly stages: readonly { readonly name: string; readonly startS: number }[];
  /** Training seconds spent in earlier stages. */
  readonly offsetS: number;
}

export const EMPTY_SERIES: QualitySeries = {
  seconds: [],
  trainDb: [],
  heldOutDb: [],
  heldOutSsim: [],
  loss: [],
  stages: [],
  offsetS: 0,
};

/** More points than any plot has pixels for; beyond this every second old point goes. */
const MOST_POINTS = 2000;

/** Stages that train nothing: the curves leave their time out. */
const NO_TRAINING: ReadonlySet<string> = new Set(["refine", "masks", "evaluate", "mesh", "film"]);

/** True for a stage in which the field is trained. */
export function trains(stage: string): boolean {
  return !NO_TRAINING.has(stage);
}

/**
 * Append a report to the series.
 *
 * A report's seconds count within its stage, so each stage continues where the one before ended.
 * Held-out values are kept at the moment they were measured only: the server repeats the newest ones.
 */
export function appendReport(
  series: QualitySeries,
  previous: TrainingReport | null,
  report: TrainingReport,
): QualitySeries {
  if (!trains(report.stage)) return series;
  const begins =
    previous?.stage !== report.stage || report.seconds < previous.seconds;
  const last = series.seconds.at(-1) ?? 0;
  const offsetS = begins ? last : series.offsetS;
  const stages = begins ? [...series.stages, { name: report.stage, startS: offsetS }] : series.stages;
  const repeated =
    !begins &&
    previous.held_out_psnr_db === report.held_out_psnr_db &&
    previous.held_out_ssim === report.held_out_ssim;
  const kept = series.seconds.length >= MOST_POINTS ? thinned(series) : series;
  return {
    seconds: [...kept.seconds, offsetS + report.seconds],
    trainDb: [...kept.trainDb, report.psnr_db],
    heldOutDb: [...kept.heldOutDb, repeated ? null : report.held_out_psnr_db],
    heldOutSsim: [...kept.heldOutSsim, repeated ? null : report.held_out_ssim],
    loss: [...kept.loss, report.loss],
    stages,
    offsetS,
  };
}

/** Drop every second point, but none with a held-out value: those are few and dear. */
function thinned(series: QualitySeries): QualitySeries {
  const keep = (index: number) => index % 2 === 0 || series.heldOutDb[index] !== null;
  const pick = <T>(column: readonly T[]) => column.filter((_, index) => keep(index));
  return {
    ...series,
    seconds: pick(series.seconds),
    trainDb: pick(series.trainDb),
    heldOutDb: pick(series.heldOutDb),
    heldOutSsim: pick(series.heldOutSsim),
    loss: pick(series.loss),
  };
}
