import type { Check } from "../api/safety";
import type { FloorPlan, StartPlace } from "../api/setup";
import { useConsole } from "../context";
import { Icon } from "../design/Icon";
import { Panel } from "../design/Panel";
import { FloorSketch } from "../floor/FloorSketch";
import { activityFace, isFlying } from "../fly/activity";
import { markedArea } from "../noGo/marked";
import { words } from "../text/words";
import { CalibrationTable } from "./CalibrationTable";

interface FloorPlanPanelProps {
  readonly plan: FloorPlan | null;
  readonly error: string | null;
  readonly checks: readonly Check[];
  readonly onCalibrate: (droneId: string) => void;
}

/** Where to set each drone down, and facing where. */
export function FloorPlanPanel({ plan, error, checks, onCalibrate }: FloorPlanPanelProps) {
  const text = words.setup;
  const volumes = useConsole((state) => state.noGo);
  return (
    <Panel title={text.floor} className="floor">
      {error !== null && <p className="field-error">{text.unknown(error)}</p>}
      {plan !== null && (
        <>
          <FloorSketch
            reachM={1.42 * plan.start_radius_m}
            circlesM={[{ radiusM: plan.start_radius_m, label: text.radius(plan.start_radius_m.toFixed(1)) }]}
            spots={plan.places.map((place) => ({
              key: place.drone_id,
              x: place.x_m,
              y: place.y_m,
              yaw: place.yaw_rad,
              colour: place.colour,
              label: place.name,
              kind: "drone",
            }))}
            areas={volumes.map(markedArea)}
            object={{ from: [-0.2, -0.2], to: [0.2, 0.2] }}
            label={text.floorShows(plan.places.length, plan.start_radius_m.toFixed(1))}
          />
          <ol className="steps">
            {text.steps(plan.start_radius_m.toFixed(1)).map((step) => (
              <li key={step}>{step}</li>
            ))}
          </ol>
          <p className="hint">{text.limits(plan.fence_radius_m.toFixed(1), plan.ceiling_m.toFixed(1))}</p>
          <table className="table" data-testid="fleet">
            <caption>{text.fleet}</caption>
            <thead>
              <tr>
                <th scope="col">{words.plan.drone}</th>
                <th scope="col">{text.place}</th>
                <th scope="col">{text.address}</th>
                <th scope="col">{text.is}</th>
              </tr>
            </thead>
            <tbody>
              {plan.places.map((place) => (
                <FleetRow
                  key={place.drone_id}
                  place={place}
                  failed={checks.filter((check) => check.drone_id === place.drone_id && !check.passed).length}
                />
              ))}
            </tbody>
          </table>
          <CalibrationTable places={plan.places} onCalibrate={onCalibrate} />
        </>
      )}
    </Panel>
  );
}

function FleetRow({ place, failed }: { readonly place: StartPlace; readonly failed: number }) {
  const report = useConsole((state) => state.drones.get(place.drone_id)?.report);
  const face = activityFace(report?.activity ?? "offline");
  // The checklist is for drones that stand.
  const amiss = failed > 0 && !isFlying(report?.activity ?? "offline");
  const azimuthDeg = ((Math.atan2(place.y_m, place.x_m) * 180) / Math.PI + 360) % 360;
  const address = [place.address, place.serial].filter((each) => each !== "").join(" · ");
  return (
    <tr>
      <th scope="row" className="line-drone" style={{ "--drone": place.colour } as React.CSSProperties}>
        {place.name}
      </th>
      <td>{words.setup.at(azimuthDeg.toFixed(0))}</td>
      <td>
        <code>{address === "" ? words.setup.searched : address}</code>
      </td>
      <td>
        <span className={`chip chip-${amiss ? "bad" : face.tone}`}>
          <Icon name={amiss ? "warning" : face.icon} />
          {amiss ? words.preflight.notOk(failed) : face.word}
        </span>
      </td>
    </tr>
  );
}
