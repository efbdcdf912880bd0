import { useEffect, useRef } from "react";
import uPlot from "uplot";
import "uplot/dist/uPlot.min.css";

// The library's enumerations exist for its compiler only: there is nothing to import.
/* eslint-disable @typescript-eslint/no-unsafe-enum-assignment */
export const LOGARITHMIC = 3 as uPlot.Scale.Distr;
export const RIGHT = 1 as uPlot.Axis.Side;
/* eslint-enable @typescript-eslint/no-unsafe-enum-assignment */

/** What a plot takes from the page's theme: a canvas knows no CSS. */
export interface PlotTheme {
  readonly colour: (name: string) => string;
  readonly letterPx: number;
  readonly font: (px: number) => string;
  /** An axis in the page's letters and lines. */
  readonly axis: uPlot.Axis;
}

export type PlotOptions = Omit<uPlot.Options, "width" | "height">;

interface PlotProps {
  readonly data: uPlot.AlignedData;
  /** Called anew whenever the theme or `version` changes; the rest is kept as it was first given. */
  readonly options: (theme: PlotTheme) => PlotOptions;
  /** Another value builds the plot anew, as other series need. */
  readonly version?: string;
  /** Says in words what the plot shows. */
  readonly label: string;
  readonly className?: string;
}

function themeOf(element: HTMLElement): PlotTheme {
  const style = getComputedStyle(element);
  const colour = (name: string) => style.getPropertyValue(name).trim();
  const letterPx = 0.8 * parseFloat(getComputedStyle(document.documentElement).fontSize);
  const font = (px: number) => `${px}px ${style.fontFamily}`;
  const axis = {
    stroke: colour("--muted"),
    font: font(letterPx),
    grid: { stroke: colour("--line-soft"), width: 1 },
    ticks: { show: false },
  };
  return { colour, letterPx, font, axis };
}

/** A uPlot that fills its place, follows the theme and takes new data without being built anew. */
export function Plot({ data, options, version = "", label, className = "" }: PlotProps) {
  const host = useRef<HTMLDivElement>(null);
  const plot = useRef<uPlot | null>(null);
  const newest = useRef({ data, options });

  useEffect(() => {
    newest.current = { data, options };
  });
  useEffect(() => {
    plot.current?.setData(data);
  }, [data]);

  useEffect(() => {
    const element = host.current;
    if (element === null) return;
    const light = matchMedia("(prefers-color-scheme: light)");
    const size = () => ({ width: element.clientWidth, height: element.clientHeight });
    const build = () => {
      plot.current?.destroy();
      const made = newest.current.options(themeOf(element));
      plot.current = new uPlot({ ...made, ...size() }, newest.current.data, element);
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
  }, [version]);

  return <div ref={host} className={className} role="img" aria-label={label} />;
}
