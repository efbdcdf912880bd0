import type { IconName } from "../design/Icon";
import type { DroneState } from "../state/state";
import { words } from "../text/words";

interface ActivityFace {
  readonly word: string;
  readonly icon: IconName;
  readonly tone: "calm" | "good" | "busy" | "bad";
  readonly inAir: boolean;
}

const FACES: Readonly<Record<string, ActivityFace>> = {
  // A drone that is not heard of may well be in the air: it can be told to land, not to take off.
  offline: { word: words.fly.activity.offline, icon: "offline", tone: "bad", inAir: true },
  ground: { word: words.fly.activity.ground, icon: "ground", tone: "calm", inAir: false },
  taking_off: { word: words.fly.activity.taking_off, icon: "takeoff", tone: "busy", inAir: true },
  flying: { word: words.fly.activity.flying, icon: "fly", tone: "good", inAir: true },
  holding: { word: words.fly.activity.holding, icon: "hold", tone: "busy", inAir: true },
  landing: { word: words.fly.activity.landing, icon: "land", tone: "busy", inAir: true },
  cut: { word: words.fly.activity.cut, icon: "cut", tone: "bad", inAir: false },
};

/** True when a drone is known to be in the air; one that is not heard of is not known to be. */
export function isFlying(activity: string): boolean {
  return activity !== "offline" && activityFace(activity).inAir;
}

/** True when any drone is known to be in the air. */
export function anyFlying(drones: ReadonlyMap<string, DroneState>): boolean {
  return [...drones.values()].some((drone) => isFlying(drone.report.activity));
}

/** Word, drawing and tone of what a drone is doing. An unknown activity is shown as it is named. */
export function activityFace(activity: string): ActivityFace {
  const known = Object.hasOwn(FACES, activity) ? FACES[activity] : undefined;
  return known ?? { word: activity, icon: "info", tone: "calm", inAir: true };
}
