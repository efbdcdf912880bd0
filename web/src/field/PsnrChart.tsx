import { useEffect, useRef } from "react";
import uPlot from "uplot";
import "uplot/dist/uPlot.min.css";
import type { QualitySeries } from "../state/series";
import { en } from "../text/en";

/** The colours of the page's theme, read where the plot needs them: a canvas knows no CSS. */
function themeColours(element: HTMLElement) {
  const style = getComputedStyle(element);
  const colour = (name: string) => style.getPropertyValue(name).trim();
  const letterPx = 0.8 * parseFloat(getComputedStyle(document.documentElement).fontSize);
  return {
    text: colour("--muted"),
    grid: colour("--line-soft"),
    train: colour("--plot-train"),
    heldOut: colour("--plot-held-out"),
    letterPx,
    font: (px: number) => `${px}px ${style.fontFamily}`,
  };
}

function options(
  element: HTMLElement,
  stages: () => QualitySeries["stages"],
): Omit<uPlot.Options, "width" | "height"> {
  const colours = themeColours(element);
  const axis = {
    stroke: colours.text,
    font: colours.font(colours.letterPx),
    grid: { stroke: colours.grid, width: 1 },
    ticks: { show: false },
  };
  return {
    legend: { show: false },
    cursor: { y: false, points: { size: 6 } },
    padding: [10, 10, 0, 0],
    scales: { x: { time: false }, y: { range: dbRange } },
    axes: [
      { ...axis, size: 2.2 * colours.letterPx, values: (_, ticks) => ticks.map((tick) => `${tick} s`) },
      { ...axis, size: 3.1 * colours.letterPx },
    ],
    series: [
      {},
      { stroke: colours.train, width: 1.25, spanGaps: true, points: { show: false } },
      {
        stroke: colours.heldOut,
        width: 2,
        spanGaps: true,
        points: { show: true, size: 6, fill: colours.heldOut, width: 0 },
      },
    ],
    hooks: {
      draw: [
        (plot) => {
          drawStages(plot, stages(), colours);
        },
      ],
    },
  };
}

/** At least six decibels high, so that a converged curve does not look like noise. */
function dbRange(_: uPlot, least: number | null, most: number | null): uPlot.Range.MinMax {
  if (least === null || most === null) return [0, 30];
  const middle = (least + most) / 2;
  const half = Math.max(3, 0.55 * (most - least));
  return [middle - half, middle + half];
}

/** A thin upright line and a word where each stage of the training begins. */
function drawStages(
  plot: uPlot,
  stages: QualitySeries["stages"],
  colours: ReturnType<typeof themeColours>,
): void {
  const { ctx, bbox } = plot;
  const words: Readonly<Record<string, string>> = en.field.stage;
  ctx.save();
  ctx.beginPath();
  ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
  ctx.clip();
  ctx.strokeStyle = ctx.fillStyle = colours.text;
  ctx.globalAlpha = 0.7;
  ctx.setLineDash([2, 3]);
  ctx.textAlign = "left";
  ctx.textBaseline = "bottom";
  ctx.font = colours.font(0.9 * colours.letterPx * uPlot.pxRatio);
  let freeFrom = -Infinity;
  for (const { name, startS } of stages) {
    const x = Math.round(plot.valToPos(startS, "x", true)) + 0.5;
    ctx.beginPath();
    ctx.moveTo(x, bbox.top);
    ctx.lineTo(x, bbox.top + bbox.height);
    ctx.stroke();
    const word = words[name] ?? name;
    const left = x + 4 * uPlot.pxRatio;
    const right = left + ctx.measureText(word).width;
    // Stages may follow each other faster than their words have room.
    if (left >= freeFrom && right <= bbox.left + bbox.width) {
      ctx.fillText(word, left, bbox.top + bbox.height - 2 * uPlot.pxRatio);
      freeFrom = right + 6 * uPlot.pxRatio;
    }
  }
  ctx.restore();
}

function columns(series: QualitySeries): uPlot.AlignedData {
  return [series.seconds.slice(), series.trainDb.slice(), series.heldOutDb.slice()];
}

/** PSNR over training time: the training batch thin, held-out pictures bold. */
export function PsnrChart({ series }: { readonly series: QualitySeries }) {
  const host = useRef<HTMLDivElement>(null);
  const plot = useRef<uPlot | null>(null);
  const newest = useRef(series);

  useEffect(() => {
    newest.current = series;
    plot.current?.setData(columns(series));
  }, [series]);

  useEffect(() => {
    const element = host.current;
    if (element === null) return;
    const light = matchMedia("(prefers-color-scheme: light)");
    const size = () => ({ width: element.clientWidth, height: element.clientHeight });
    const build = () => {
      plot.current?.destroy();
      const made = options(element, () => newest.current.stages);
      plot.current = new uPlot({ ...made, ...size() }, columns(newest.current), element);
    };
    const watcher = new ResizeObserver(() => plot.current?.setSize(size()));
    build();
    watcher.observe(element);
    light.addEventListener("change", build);
    return () => {
      light.removeEventListener("change", build);
      watcher.disconnect();
      plot.current?.destroy();
      plot.current = null;
    };
  }, []);

  return (
    <div className="curve" data-testid="psnr-curve" data-points={series.seconds.length}>
      <div className="curve-legend" aria-hidden="true">
        <span className="key key-train">{en.field.train}</span>
        <span className="key key-held-out">{en.field.heldOut}</span>
        <span className="curve-unit">dB</span>
      </div>
      <div ref={host} className="curve-plot" role="img" aria-label={en.field.curve} />
      {series.seconds.length === 0 && <p className="curve-empty">{en.field.noCurve}</p>}
    </div>
  );
}
