import type { Plan, PlannedViewpoint } from "../api/plans";
import { useConsole } from "../context";
import { Panel } from "../design/Panel";
import { FloorSketch, type Spot } from "../floor/FloorSketch";
import { words } from "../text/words";

/** The plan from above, for whoever has no 3D graphics or wants all of it at a glance. */
export function TopView({ plan }: { readonly plan: Plan | null }) {
  const drones = useConsole((state) => state.drones);
  const seed = useConsole((state) => state.findings.seed);
  const shown = useConsole((state) => state.planView);
  if (plan === null) return null;
  const comparable = plan.ring.length > 0;
  const spot = (kind: Spot["kind"]) => (view: PlannedViewpoint) => ({
    key: `${kind} ${view.round_index} ${view.drone_id}`,
    x: view.position_world[0],
    y: view.position_world[1],
    yaw: view.yaw_rad,
    colour: drones.get(view.drone_id)?.report.colour ?? "var(--muted)",
    kind,
  });
  const spots = [
    ...(comparable && shown !== "planned" ? plan.ring.map(spot("ring")) : []),
    ...(!comparable || shown !== "ring" ? plan.viewpoints.map(spot("view")) : []),
  ];
  const farM = Math.max(1, ...spots.map((each) => Math.hypot(each.x, each.y)));
  const object =
    seed === null
      ? null
      : ({
          from: [at(seed.centre, 0) - at(seed.size, 0) / 2, at(seed.centre, 1) - at(seed.size, 1) / 2],
          to: [at(seed.centre, 0) + at(seed.size, 0) / 2, at(seed.centre, 1) + at(seed.size, 1) / 2],
        } as const);
  return (
    <Panel title={words.plan.above} className="above">
      <FloorSketch
        reachM={1.12 * farM}
        circlesM={[{ radiusM: Math.ceil(farM) / 2, label: `${Math.ceil(farM) / 2} m` }]}
        spots={spots}
        object={object}
        label={words.plan.aboveShows(spots.length)}
      />
    </Panel>
  );
}

function at(values: readonly number[], index: number): number {
  return values[index] ?? 0;
}
