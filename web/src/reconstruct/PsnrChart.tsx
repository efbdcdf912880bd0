import { useMemo } from "react";
import uPlot from "uplot";
import { LOGARITHMIC, Plot, RIGHT, type PlotOptions, type PlotTheme } from "../design/Plot";
import type { QualitySeries } from "../state/series";
import { words } from "../text/words";

/** At least six decibels high, so that a converged curve does not look like noise. */
function dbRange(_: uPlot, least: number | null, most: number | null): uPlot.Range.MinMax {
  if (least === null || most === null) return [0, 30];
  const middle = (least + most) / 2;
  const half = Math.max(3, 0.55 * (most - least));
  return [middle - half, middle + half];
}

/** At least a tenth high, for the same reason. */
function ssimRange(_: uPlot, least: number | null, most: number | null): uPlot.Range.MinMax {
  if (least === null || most === null) return [0, 1];
  const middle = (least + most) / 2;
  const half = Math.max(0.05, 0.55 * (most - least));
  return [middle - half, middle + half];
}

/** What both curves share: seconds of training, and where each stage of it began. */
function options(theme: PlotTheme, stages: QualitySeries["stages"]): PlotOptions {
  return {
    legend: { show: false },
    cursor: { y: false, points: { size: 6 } },
    padding: [10, 1.6 * theme.letterPx, 0, 0],
    scales: { x: { time: false } },
    axes: axes(theme),
    series: [{}],
    hooks: {
      draw: [
        (plot) => {
          drawStages(plot, stages, theme);
        },
      ],
    },
  };
}

/** Seconds below, and at the left what a curve shows. */
function axes({ axis, letterPx }: PlotTheme): uPlot.Axis[] {
  return [
    { ...axis, size: 2.2 * letterPx, values: (_, ticks) => ticks.map((tick) => `${tick} s`) },
    { ...axis, size: 4.2 * letterPx },
  ];
}

/** A thin upright line and a word where each stage of the training begins. */
function drawStages(plot: uPlot, stages: QualitySeries["stages"], theme: PlotTheme): void {
  const { ctx, bbox } = plot;
  const names: Readonly<Record<string, string>> = words.field.stage;
  ctx.save();
  ctx.beginPath();
  ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
  ctx.clip();
  ctx.strokeStyle = ctx.fillStyle = theme.colour("--muted");
  ctx.globalAlpha = 0.7;
  ctx.setLineDash([2, 3]);
  ctx.textAlign = "left";
  ctx.textBaseline = "bottom";
  ctx.font = theme.font(0.9 * theme.letterPx * uPlot.pxRatio);
  let freeFrom = -Infinity;
  for (const { name, startS } of stages) {
    const x = Math.round(plot.valToPos(startS, "x", true)) + 0.5;
    ctx.beginPath();
    ctx.moveTo(x, bbox.top);
    ctx.lineTo(x, bbox.top + bbox.height);
    ctx.stroke();
    const word = names[name] ?? name;
    const width = ctx.measureText(word).width;
    const gap = 4 * uPlot.pxRatio;
    // A word that has no room on the right of its line stands on the left.
    const fits = x + gap + width <= bbox.left + bbox.width;
    const left = fits ? x + gap : x - gap - width;
    const right = left + width;
    // Stages may follow each other faster than their words have room.
    if (left >= freeFrom) {
      ctx.fillText(word, left, bbox.top + bbox.height - 2 * uPlot.pxRatio);
      freeFrom = right + 6 * uPlot.pxRatio;
    }
  }
  ctx.restore();
}

/** The stages' names and starts as one word: the curves are built anew when it changes. */
function stagesKey(series: QualitySeries): string {
  return series.stages.map((stage) => `${stage.name} ${stage.startS}`).join(", ");
}

/** PSNR over training time, the training batch thin, held-out pictures bold; and the SSIM of these. */
export function PsnrChart({ series }: { readonly series: QualitySeries }) {
  const data = useMemo<uPlot.AlignedData>(
    () => [
      series.seconds.slice(),
      series.trainDb.slice(),
      series.heldOutDb.slice(),
      series.heldOutSsim.slice(),
    ],
    [series],
  );
  // Trainings of earlier versions told none.
  const alike = series.heldOutSsim.some((ssim) => ssim !== null);
  return (
    <div className="curve" data-testid="psnr-curve" data-points={series.seconds.length}>
      <div className="curve-legend" aria-hidden="true">
        <span className="curve-unit">{words.field.psnr}, dB</span>
        <span className="key">{words.field.train}</span>
        <span className="key key-held-out">{words.field.heldOut}</span>
        {alike && <span className="key key-ssim">{words.field.ssimRight}</span>}
      </div>
      <Plot
        className="curve-plot"
        data={data}
        version={`${stagesKey(series)} ${alike}`}
        label={words.field.curve}
        options={(theme) => ({
          ...options(theme, series.stages),
          scales: { x: { time: false }, y: { range: dbRange }, ssim: { range: ssimRange } },
          axes: [
            ...axes(theme),
            {
              ...theme.axis,
              show: alike,
              scale: "ssim",
              side: RIGHT,
              grid: { show: false },
              size: 3.4 * theme.letterPx,
            },
          ],
          series: [
            {},
            {
              stroke: theme.colour("--plot-train"),
              width: 1.25,
              spanGaps: true,
              points: { show: false },
            },
            {
              stroke: theme.colour("--plot-held-out"),
              width: 2,
              spanGaps: true,
              points: { show: true, size: 6, fill: theme.colour("--plot-held-out"), width: 0 },
            },
            {
              stroke: theme.colour("--plot-ssim"),
              width: 1.5,
              scale: "ssim",
              dash: [4, 3],
              spanGaps: true,
              points: { show: true, size: 5, fill: theme.colour("--plot-ssim"), width: 0 },
            },
          ],
        })}
      />
      {series.seconds.length === 0 && <p className="curve-empty">{words.field.noCurve}</p>}
    </div>
  );
}

/** The training loss over training time, on a scale of powers of ten. */
export function LossChart({ series }: { readonly series: QualitySeries }) {
  const data = useMemo<uPlot.AlignedData>(
    // A logarithm knows no zero.
    () => [series.seconds.slice(), series.loss.map((loss) => (loss !== null && loss > 0 ? loss : null))],
    [series],
  );
  return (
    <div className="curve" data-testid="loss-curve" data-points={series.seconds.length}>
      <div className="curve-legend" aria-hidden="true">
        <span className="curve-unit">{words.field.loss}</span>
      </div>
      <Plot
        className="curve-plot"
        data={data}
        version={stagesKey(series)}
        label={words.field.lossCurve}
        options={(theme) => ({
          ...options(theme, series.stages),
          scales: { x: { time: false }, y: { distr: LOGARITHMIC } },
          series: [
            {},
            {
              stroke: theme.colour("--plot-train"),
              width: 1.5,
              spanGaps: true,
              points: { show: false },
            },
          ],
        })}
      />
      {series.seconds.length === 0 && <p className="curve-empty">{words.field.noCurve}</p>}
    </div>
  );
}
