import { useMemo } from "react";
import type { AnnealingStep, Plan } from "../api/plans";
import { useConsole } from "../context";
import { count, power } from "../design/format";
import { Panel } from "../design/Panel";
import { LOGARITHMIC, Plot, RIGHT } from "../design/Plot";
import { Countdown, Waiting } from "../design/Waiting";
import { isActive } from "../state/state";
import { words } from "../text/words";
import { searchOf } from "./search";

/** The annealing as it runs: best fitness so far and temperature over the moves. */
export function AnnealingPanel({ plan }: { readonly plan: Plan | null }) {
  const seen = useConsole((state) => state.findings.annealing);
  const running = useConsole((state) => state.findings.planning !== null);
  // Whoever comes later, or missed reports on a slow line, gets all of it with the plan.
  const course: readonly AnnealingStep[] = running || plan === null ? seen : plan.annealing;
  const moves = useConsole((state) => state.findings.annealing.at(-1)?.iterations);
  const data = useMemo(
    () =>
      [
        course.map((each) => each.iteration),
        course.map((each) => each.fitness),
        course.map(({ temperature }) => (temperature !== null && temperature > 0 ? temperature : null)),
      ] as [number[], (number | null)[], (number | null)[]],
    [course],
  );
  const last = course.at(-1);
  const text = words.plan;
  return (
    <Panel
      title={text.annealing}
      className="annealing"
      aside={last !== undefined && <span>{text.moves(count(last.iteration), count(moves ?? last.iteration))}</span>}
    >
      <SearchProgress />
      <div className="curve" data-testid="annealing-curve" data-points={course.length}>
        <div className="curve-legend" aria-hidden="true">
          <span className="key key-held-out">{text.fitness}</span>
          <span className="key">{text.temperature}</span>
        </div>
        <Plot
          className="curve-plot"
          data={data}
          label={text.annealingPlot}
          options={({ axis, colour, letterPx }) => ({
            legend: { show: false },
            cursor: { y: false, points: { size: 6 } },
            padding: [10, 4, 0, 0],
            scales: { x: { time: false }, t: { distr: LOGARITHMIC } },
            axes: [
              { ...axis, size: 2.2 * letterPx, values: (_, ticks) => ticks.map(count) },
              { ...axis, size: 4.6 * letterPx },
              {
                ...axis,
                scale: "t",
                side: RIGHT,
                grid: { show: false },
                size: 4.2 * letterPx,
                values: (_, ticks: (number | null)[]) => ticks.map(power),
              },
            ],
            series: [
              {},
              { stroke: colour("--plot-held-out"), width: 2, points: { show: false } },
              { stroke: colour("--plot-train"), width: 1.25, scale: "t", dash: [4, 3], points: { show: false } },
            ],
          })}
        />
        {course.length === 0 && <p className="curve-empty">{text.noAnnealing}</p>}
      </div>
    </Panel>
  );
}

/** How far the search for a plan is; before its first report, what is waited for. */
function SearchProgress() {
  const { planning, annealing, plan } = useConsole((state) => state.findings);
  const phase = useConsole(({ capture }) => (capture !== null && isActive(capture) ? capture.phase : null));
  const text = words.plan;
  // After a reconnection the search's last word may come behind the plan it led to.
  const running = phase !== null && planning !== null && (plan === null || planning.at > plan.at);
  const search = running ? searchOf(annealing) : null;
  if (search === null) {
    return phase === "plan" && plan === null ? (
      <p className="under-way">
        <Waiting what={text.weighing} />
      </p>
    ) : null;
  }
  return (
    <p className="under-way" data-testid="search">
      <progress aria-label={text.searchProgress} value={search.share} max={1} />
      <Countdown key={planning?.at} leftS={search.leftS} />
    </p>
  );
}
