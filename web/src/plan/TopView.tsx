import { useState } from "react";
import type { Plan, PlannedViewpoint } from "../api/plans";
import { getFloorPlan } from "../api/setup";
import { useAnswer } from "../api/useAnswer";
import { useConsole, useOperator } from "../context";
import { Icon } from "../design/Icon";
import { Panel } from "../design/Panel";
import { FloorSketch, type Spot } from "../floor/FloorSketch";
import { markedArea } from "../noGo/marked";
import { NoGoList } from "../noGo/NoGoList";
import { words } from "../text/words";
import { routes } from "./route";

/**
 * The room from above: the plan, and the volumes that no drone may enter.
 *
 * Also for whoever has no 3D graphics or wants all of it at a glance.
 */
export function TopView({ plan }: { readonly plan: Plan | null }) {
  const operator = useOperator();
  const drones = useConsole((state) => state.drones);
  const seed = useConsole((state) => state.findings.seed);
  const shown = useConsole((state) => state.planView);
  const volumes = useConsole((state) => state.noGo);
  const epoch = useConsole((state) => String(state.epoch));
  const { value: floor } = useAnswer(epoch, getFloorPlan);
  const [drawing, setDrawing] = useState(false);
  const [chosen, setChosen] = useState<string | null>(null);
  const text = words.noGo;

  const comparable = plan !== null && plan.ring.length > 0;
  const spot = (kind: Spot["kind"]) => (view: PlannedViewpoint) => ({
    key: `${kind} ${view.round_index} ${view.drone_id}`,
    x: view.position_world[0],
    y: view.position_world[1],
    yaw: view.yaw_rad,
    colour: drones.get(view.drone_id)?.report.colour ?? "var(--muted)",
    kind,
  });
  const views = [
    ...(comparable && shown !== "planned" ? plan.ring.map(spot("ring")) : []),
    ...(plan !== null && (!comparable || shown !== "ring") ? plan.viewpoints.map(spot("view")) : []),
  ];
  // Before there is a plan, the places where the drones are set down say where what is.
  const places: Spot[] = (floor?.places ?? []).map((place) => ({
    key: place.drone_id,
    x: place.x_m,
    y: place.y_m,
    yaw: place.yaw_rad,
    colour: place.colour,
    kind: "drone",
  }));
  const spots = views.length > 0 ? views : places;
  const fenceM = floor?.fence_radius_m ?? 0;
  const farM = Math.max(1, ...spots.map((each) => Math.hypot(each.x, each.y)));
  // Where something is drawn, all of the room is shown.
  const wholeRoom = (drawing || volumes.length > 0) && fenceM > 0;
  const near = { radiusM: Math.ceil(farM) / 2, label: `${Math.ceil(farM) / 2} m` };
  const fence = { radiusM: fenceM, label: text.fence(fenceM.toFixed(1)) };
  const object =
    seed === null
      ? null
      : ({
          from: [at(seed.centre, 0) - at(seed.size, 0) / 2, at(seed.centre, 1) - at(seed.size, 1) / 2],
          to: [at(seed.centre, 0) + at(seed.size, 0) / 2, at(seed.centre, 1) + at(seed.size, 1) / 2],
        } as const);
  const areas = volumes.map((volume) => ({ ...markedArea(volume), chosen: volume.id === chosen }));
  const ways = (of: Plan) =>
    routes(of.viewpoints).map(({ droneId, ordered }) => ({
      key: droneId,
      colour: drones.get(droneId)?.report.colour ?? "var(--muted)",
      points: ordered.map((view) => [at(view.position_world, 0), at(view.position_world, 1)] as const),
    }));
  return (
    <Panel title={words.plan.above} className="above">
      <FloorSketch
        reachM={1.12 * (wholeRoom ? fenceM : farM)}
        circlesM={wholeRoom ? [near, fence] : [near]}
        spots={spots}
        trails={plan !== null && (!comparable || shown !== "ring") ? ways(plan) : []}
        areas={areas}
        object={object}
        label={words.plan.aboveShows(views.length, volumes.length)}
        {...(drawing
          ? {
              drawing: {
                onDrawn: (area) => {
                  void operator.addNoGo(area);
                },
                onMoved: (id, area) => {
                  void operator.changeNoGo(id, area);
                },
                onChosen: setChosen,
              },
            }
          : {})}
      />
      <div className="no-go-tools">
        <button
          type="button"
          className="button button-small"
          data-testid="draw-no-go"
          onClick={() => {
            setDrawing(!drawing);
          }}
        >
          <Icon name={drawing ? "check" : "draw"} />
          {drawing ? text.done : text.draw}
        </button>
        {drawing && fenceM > 0 && (
          <button
            type="button"
            className="button button-small"
            data-testid="add-no-go"
            onClick={() => {
              // At the fence, where nothing stands or flies: it is moved to its place from there.
              void operator.addNoGo([-0.25, fenceM - 0.5, 0.25, fenceM]);
            }}
          >
            <Icon name="add" />
            {text.add}
          </button>
        )}
        {drawing && <p className="hint">{text.hint}</p>}
      </div>
      <NoGoList volumes={volumes} chosen={chosen} onChosen={setChosen} />
    </Panel>
  );
}

function at(values: readonly number[], index: number): number {
  return values[index] ?? 0;
}
