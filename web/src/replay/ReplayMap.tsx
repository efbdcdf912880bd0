import type { DroneReplay, Replay } from "../api/replay";
import { FloorSketch, type Spot } from "../floor/FloorSketch";
import { words } from "../text/words";
import { wayUntil } from "./flightCourse";

export interface Face {
  readonly drone: DroneReplay;
  readonly name: string;
  readonly colour: string;
}

interface ReplayMapProps {
  readonly replay: Replay;
  readonly faces: readonly Face[];
  readonly atS: number;
}

/** Where everybody is at a moment, and the way there, seen from above. */
export function ReplayMap({ replay, faces, atS }: ReplayMapProps) {
  const ways = faces.map(({ drone }) => wayUntil(drone.way, atS));
  const spots = faces.flatMap(({ drone, name, colour }, index): Spot[] => {
    const here = ways[index]?.at(-1);
    if (here === undefined) return [];
    const [, x, y, , yaw] = here;
    return [{ key: drone.drone_id, x, y, yaw, colour, label: name, kind: "drone" }];
  });
  const farM = Math.max(1, ...faces.flatMap(({ drone }) => drone.way.map(([, x, y]) => Math.hypot(x, y))));
  const box = replay.object_box;
  return (
    <FloorSketch
      reachM={1.25 * farM}
      circlesM={[{ radiusM: Math.ceil(farM) / 2, label: `${Math.ceil(farM) / 2} m` }]}
      trails={faces.map(({ drone, colour }, index) => ({
        key: drone.drone_id,
        colour,
        points: (ways[index] ?? []).map(([, x, y]) => [x, y] as const),
      }))}
      spots={spots}
      object={box === null ? null : { from: corner(box[0]), to: corner(box[1]) }}
      label={words.replay.map}
    />
  );
}

function corner(point: readonly number[]): readonly [number, number] {
  return [point[0] ?? 0, point[1] ?? 0];
}
