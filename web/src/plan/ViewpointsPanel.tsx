import type { Plan, PlannedViewpoint } from "../api/plans";
import { useConsole } from "../context";
import { Panel } from "../design/Panel";
import { words } from "../text/words";
import { rounds } from "./route";

/** The chosen viewpoints, round by round: who, where and how high. */
export function ViewpointsPanel({ plan }: { readonly plan: Plan | null }) {
  const capture = useConsole((state) => state.capture);
  const text = words.plan;
  if (plan === null || plan.viewpoints.length === 0) return null;
  return (
    <Panel title={text.viewpoints} className="viewpoints" aside={<span>{plan.viewpoints.length}</span>}>
      <div className="table-scroll" tabIndex={0} role="region" aria-label={text.viewpoints}>
        <table className="table">
          <thead>
            <tr>
              <th scope="col">{words.mission.rounds}</th>
              <th scope="col">{text.drone}</th>
              <th scope="col">{text.azimuth}</th>
              <th scope="col">{text.distance}</th>
              <th scope="col">{text.height}</th>
            </tr>
          </thead>
          {rounds(plan.viewpoints).map((round) => {
            const now = capture?.phase === "fly" || capture?.phase === "tune" || capture?.phase === "capture";
            return (
              <tbody
                key={round.index}
                className={now && capture.round_index === round.index ? "is-now" : ""}
              >
                {round.views.map((view, index) => (
                  <Row key={view.drone_id} view={view} first={index === 0} />
                ))}
              </tbody>
            );
          })}
        </table>
      </div>
    </Panel>
  );
}

function Row({ view, first }: { readonly view: PlannedViewpoint; readonly first: boolean }) {
  const drone = useConsole((state) => state.drones.get(view.drone_id)?.report);
  const [x, y, z] = view.position_world;
  const azimuthDeg = (Math.atan2(y, x) * 180) / Math.PI;
  return (
    <tr className={first ? "is-first" : ""}>
      <td>{first && view.round_index + 1}</td>
      <th
        scope="row"
        className="line-drone"
        style={{ "--drone": drone?.colour ?? "var(--line)" } as React.CSSProperties}
      >
        {drone?.name ?? view.drone_id}
      </th>
      <td>{((azimuthDeg + 360) % 360).toFixed(0)}°</td>
      <td>{Math.hypot(x, y).toFixed(2)} m</td>
      <td>{z.toFixed(2)} m</td>
    </tr>
  );
}
