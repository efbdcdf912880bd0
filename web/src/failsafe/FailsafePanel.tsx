import { useState } from "react";
import type { FailsafeRow } from "../api/safety";
import { useConsole } from "../context";
import { timeOfDay, withUnit } from "../design/format";
import { Icon, type IconName } from "../design/Icon";
import { Panel } from "../design/Panel";
import { useNow } from "../design/useNow";
import type { FailsafeReport } from "../protocol/messages.gen";
import { words } from "../text/words";
import { firesNow, newestByRow, rowKey } from "./failsafes";

const ACTION_ICON: Readonly<Record<string, IconName>> = {
  hold: "hold",
  land: "land",
  land_all: "land_all",
  cut: "cut",
};

/** The failsafe table: what is watched, when it acts and what it does; what acts now stands out. */
export function FailsafePanel() {
  const table = useConsole((state) => state.failsafeTable);
  const failsafes = useConsole((state) => state.failsafes);
  const drones = useConsole((state) => state.drones);
  const nowMs = useNow(500);
  const [open, setOpen] = useState(false);
  const text = words.failsafe;
  const byRow = newestByRow(failsafes);
  const lit = failsafes.filter((fired) => firesNow(fired, drones.get(fired.drone_id), nowMs));
  const litKeys = new Set(lit.map(rowKey));
  const rows = table ?? [];
  // Closed, the panel shows what fires now; open, everything there is.
  const shown = open ? rows : rows.filter((row) => litKeys.has(rowKey(row)));
  return (
    <Panel
      title={text.title}
      className="failsafes"
      aside={
        <>
          <span
            className={`chip ${lit.length > 0 ? "chip-bad" : "chip-good"}`}
            role="status"
            data-testid="failsafe-verdict"
          >
            <Icon name={lit.length > 0 ? "warning" : "shield"} />
            {lit.length > 0 ? text.firing(litKeys.size) : text.calm}
          </span>
          <button
            type="button"
            className="button button-small button-quiet"
            aria-expanded={open}
            data-testid="failsafe-toggle"
            onClick={() => {
              setOpen(!open);
            }}
          >
            {open ? text.less : text.more(rows.length)}
          </button>
        </>
      }
    >
      {shown.length > 0 && (
        <div className="failsafe-scroll" tabIndex={0} role="region" aria-label={text.title}>
          <table className="failsafe-table">
            <thead>
              <tr>
                <th scope="col">{text.event}</th>
                <th scope="col">{text.firesAt}</th>
                <th scope="col">{text.action}</th>
              </tr>
            </thead>
            <tbody>
              {shown.map((row, index) => (
                <Row
                  key={rowKey(row)}
                  row={row}
                  first={shown[index - 1]?.event !== row.event}
                  last={shown[index + 1]?.event !== row.event}
                  fired={byRow.get(rowKey(row)) ?? []}
                  lit={lit}
                  full={open}
                />
              ))}
            </tbody>
          </table>
        </div>
      )}
    </Panel>
  );
}

interface RowProps {
  readonly row: FailsafeRow;
  /** The first row of an event names it, the last one explains it. */
  readonly first: boolean;
  readonly last: boolean;
  readonly fired: readonly FailsafeReport[];
  readonly lit: readonly FailsafeReport[];
  readonly full: boolean;
}

function Row({ row, first, last, fired, lit, full }: RowProps) {
  const names: Readonly<Record<string, string>> = words.failsafe.events;
  const actions: Readonly<Record<string, string>> = words.failsafe.actions;
  const now = fired.filter((one) => lit.includes(one));
  const told = full ? fired : now;
  const sign = row.direction === "at_most" ? "≤" : "≥";
  return (
    <tr
      className={`${now.length > 0 ? "is-lit" : ""} ${first ? "is-first" : ""}`}
      data-testid={`failsafe-${row.event}-${row.action}`}
      data-lit={now.length > 0}
    >
      <th scope="row">
        <span className={first ? "" : "sr-only"}>{names[row.event] ?? row.event}</span>
        {last && full && <small>{row.description}</small>}
        {told.map((one) => (
          <FiredLine key={one.drone_id} fired={one} unit={row.unit} now={now.includes(one)} />
        ))}
      </th>
      <td>
        {sign} {row.threshold} {row.unit}
      </td>
      <td>
        <span className={`action action-${row.action}`}>
          <Icon name={ACTION_ICON[row.action] ?? "info"} />
          {actions[row.action] ?? row.action}
        </span>
      </td>
    </tr>
  );
}

/** For which drone a row fired, at what value and when. */
function FiredLine(props: { readonly fired: FailsafeReport; readonly unit: string; readonly now: boolean }) {
  const { fired, unit, now } = props;
  const drone = useConsole((state) => state.drones.get(fired.drone_id)?.report);
  return (
    <span className={`fired-line ${now ? "is-now" : ""}`}>
      <span
        className="line-drone"
        style={{ "--drone": drone?.colour ?? "var(--line)" } as React.CSSProperties}
      >
        {drone?.name ?? fired.drone_id}
      </span>
      <strong>{fired.value === null ? words.failsafe.unknown : withUnit(fired.value, 1, unit)}</strong>{" "}
      <time dateTime={fired.at}>{timeOfDay(fired.at)}</time>
      {!now && <> {words.failsafe.over}</>}
    </span>
  );
}
