import type { Calibration } from "../api/calibration";
import { words } from "../text/words";
import { coverageCells, coverageShare } from "./calibrating";

const CELL = 10;

/** The camera's picture in cells: those that views have reached carry a dot. */
export function CoverageGrid({ coverage }: { readonly coverage: Calibration["coverage"] }) {
  const rows = coverage.length;
  const columns = coverage[0]?.length ?? 0;
  const percent = Math.round(100 * coverageShare(coverage));
  return (
    <svg
      className="coverage-grid"
      viewBox={`0 0 ${CELL * columns} ${CELL * rows}`}
      role="img"
      aria-label={words.setup.calibrating.coverageShows(percent)}
      data-testid="coverage-grid"
      data-percent={percent}
    >
      {coverageCells(coverage).map(({ key, column, row, covered }) => (
        <g key={key} transform={`translate(${CELL * column} ${CELL * row})`} className={covered ? "is-covered" : ""}>
          <rect x={0.5} y={0.5} width={CELL - 1} height={CELL - 1} rx={1} />
          {covered && <circle cx={CELL / 2} cy={CELL / 2} r={2} />}
        </g>
      ))}
    </svg>
  );
}
