import { useConsole } from "../context";
import { Icon } from "../design/Icon";
import { useNow } from "../design/useNow";
import type { DroneState } from "../state/state";
import { words } from "../text/words";
import { countdown, type Countdown } from "./failsafes";

/** On a drone's tile: what the failsafe table is about to do, and in how many seconds. */
export function CountdownNote({ drone }: { readonly drone: DroneState }) {
  const table = useConsole((state) => state.failsafeTable);
  const nowMs = useNow(250);
  const next = table === null ? null : countdown(table, drone, nowMs);
  if (next === null) return null;
  return (
    <p className="fired-note is-soon" data-testid={`countdown-${drone.report.drone_id}`}>
      <Icon name="clock" />
      <span>
        <strong>{countdownWord(next)}</strong> {eventName(next.row.event)}
      </span>
    </p>
  );
}

/** What is about to be done, and when: "Land in 4 s". */
export function countdownWord({ row, leftS }: Countdown): string {
  const actions: Readonly<Record<string, string>> = words.failsafe.actions;
  return words.failsafe.soon(actions[row.action] ?? row.action, Math.ceil(leftS));
}

function eventName(event: string): string {
  const names: Readonly<Record<string, string>> = words.failsafe.events;
  return names[event] ?? event;
}
