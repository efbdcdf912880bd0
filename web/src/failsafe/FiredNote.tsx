import { useConsole } from "../context";
import { timeOfDay } from "../design/format";
import { Icon } from "../design/Icon";
import { useNow } from "../design/useNow";
import type { DroneState } from "../state/state";
import { words } from "../text/words";
import { tileNews } from "./failsafes";

/** On a drone's tile: which failsafe acts on it, or brought it down. */
export function FiredNote({ drone }: { readonly drone: DroneState }) {
  const failsafes = useConsole((state) => state.failsafes);
  const nowMs = useNow(500);
  const news = tileNews(failsafes, drone, nowMs);
  if (news === null) return null;
  const { fired, now } = news;
  const acts = now ? words.failsafe.doing : words.failsafe.done;
  return (
    <p className={`fired-note ${now ? "is-now" : ""}`} data-testid={`fired-${fired.drone_id}`}>
      <Icon name={now ? "warning" : "info"} />
      <span>
        <strong>{acts[fired.action]}:</strong> {fired.text}
        {!now && <time dateTime={fired.at}> {timeOfDay(fired.at)}</time>}
      </span>
    </p>
  );
}
