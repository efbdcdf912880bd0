import { useMemo, useState } from "react";
import { useConsole } from "../context";
import { decimal } from "../design/format";
import { Panel } from "../design/Panel";
import { Plot } from "../design/Plot";
import { columns, QUANTITIES, type Quantity } from "../state/history";
import { words } from "../text/words";

/** Colour never alone: each drone's line has its own dashes, as its word in the legend shows. */
const DASHES: readonly (readonly number[])[] = [[], [8, 4], [2, 3], [10, 3, 2, 3]];

const FACE: Readonly<Record<Quantity, { readonly digits: number; readonly unit: string }>> = {
  battery_pct: { digits: 0, unit: "%" },
  height_m: { digits: 2, unit: "m" },
  speed_m_s: { digits: 2, unit: "m/s" },
  temperature_c: { digits: 0, unit: "°C" },
  position_sigma_m: { digits: 2, unit: "m" },
  state_age_s: { digits: 1, unit: "s" },
  video_fps: { digits: 0, unit: "fps" },
};

function isQuantity(value: string): value is Quantity {
  return (QUANTITIES as readonly string[]).includes(value);
}

/** One quantity of all drones over the last minutes. */
export function HistoryPanel() {
  const history = useConsole((state) => state.history);
  const drones = useConsole((state) => state.drones);
  const [quantity, setQuantity] = useState<Quantity>("battery_pct");
  const ids = [...drones.keys()].join("\n");
  const data = useMemo(() => {
    const { agoS, values } = columns(history, ids === "" ? [] : ids.split("\n"), quantity);
    return [agoS, ...values] as [number[], ...(number | null)[][]];
  }, [history, ids, quantity]);
  const { digits, unit } = FACE[quantity];
  const reports = [...drones.values()].map((drone) => drone.report);
  return (
    <Panel
      title={words.history.title}
      className="history"
      aside={
        <select
          className="select-small"
          aria-label={words.history.quantity}
          data-testid="history-quantity"
          value={quantity}
          onChange={(event) => {
            if (isQuantity(event.target.value)) setQuantity(event.target.value);
          }}
        >
          {QUANTITIES.map((each) => (
            <option key={each} value={each}>
              {words.history.of[each]}, {FACE[each].unit}
            </option>
          ))}
        </select>
      }
    >
      <Plot
        className="history-plot"
        data={data}
        version={`${ids} ${quantity}`}
        label={words.history.plot(words.history.of[quantity])}
        options={({ axis, letterPx }) => ({
          legend: { show: false },
          cursor: { y: false, points: { size: 6 } },
          padding: [8, 1.6 * letterPx, 0, 0],
          scales: {
            x: { time: false, range: (_, least) => [Math.min(least, -60), 0] },
            y: { range: (_, least, most) => spread(least, most, quantity) },
          },
          axes: [
            {
              ...axis,
              size: 2.2 * letterPx,
              values: (_, ticks) => ticks.map((tick) => words.history.ago(tick)),
            },
            { ...axis, size: 3.6 * letterPx },
          ],
          series: [
            {},
            ...reports.map((report, index) => ({
              stroke: report.colour,
              width: 1.75,
              dash: [...(DASHES[index % DASHES.length] ?? [])],
              points: { show: false },
            })),
          ],
        })}
      />
      <ul className="history-legend">
        {reports.map((report, index) => (
          <li key={report.drone_id} style={{ "--drone": report.colour } as React.CSSProperties}>
            <svg width="26" height="8" aria-hidden="true">
              <line x1="0" y1="4" x2="26" y2="4" strokeDasharray={(DASHES[index % DASHES.length] ?? []).join(" ")} />
            </svg>
            {report.name}
            <strong>
              {decimal(report[quantity], digits)} <small>{unit}</small>
            </strong>
          </li>
        ))}
      </ul>
    </Panel>
  );
}

/** A scale that does not make noise look like news; what cannot be negative starts at zero. */
function spread(least: number | null, most: number | null, quantity: Quantity): [number, number] {
  if (quantity === "battery_pct") return [0, 100];
  if (least === null || most === null) return [0, 1];
  if (quantity === "temperature_c") return [Math.min(40, least - 2), Math.max(90, most + 2)];
  return [Math.min(0, least), Math.max(most * 1.1, 0.2)];
}
