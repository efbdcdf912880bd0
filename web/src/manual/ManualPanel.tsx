import { useEffect, useRef, useState } from "react";
import { clientId } from "../api/tabId";
import { useConsole, useOperator } from "../context";
import { Icon } from "../design/Icon";
import { Panel } from "../design/Panel";
import { takesText, type KeyTarget } from "../fly/holdKey";
import { fliesByItself, type ConsoleState } from "../state/state";
import { words } from "../text/words";
import { Hand } from "./hand";
import { LETTER, pushOfKey, type Push } from "./sticks";

/** Where each button stands: the left cross climbs and turns, the right one goes. */
const CROSSES: readonly (readonly Push[])[] = [
  ["up", "turnLeft", "turnRight", "down"],
  ["forward", "left", "right", "back"],
];

/** Fly one drone by hand: by keys, by a gamepad, or by buttons that are held. */
export function ManualPanel() {
  const steerable = useConsole(steerableDrones);
  const [wanted, setWanted] = useState<string | null>(null);
  const ids = steerable === "" ? [] : steerable.split("\n");
  const droneId = wanted !== null && ids.includes(wanted) ? wanted : null;
  // A drone that was held, or has landed, is chosen again by hand and not by itself.
  if (wanted !== null && droneId === null) setWanted(null);
  const drones = useConsole((state) => state.drones);
  const holder = useConsole((state) => state.command.holder);
  const operator = useOperator();
  const text = words.manual;
  if (ids.length === 0) return null;
  return (
    <Panel title={text.title} className="manual">
      <div className="segments" role="group" aria-label={text.which}>
        {ids.map((id) => (
          <button
            key={id}
            type="button"
            aria-pressed={droneId === id}
            data-testid={`manual-${id}`}
            onClick={() => {
              setWanted(droneId === id ? null : id);
              if (holder === null) operator.takeCommand();
            }}
          >
            {drones.get(id)?.report.name ?? id}
          </button>
        ))}
      </div>
      {droneId === null ? (
        <p className="hint">{text.choose}</p>
      ) : holder === clientId ? (
        <Pad key={droneId} droneId={droneId} />
      ) : (
        <p className="hint" role="status">
          {holder === null ? text.waiting : text.other}
        </p>
      )}
    </Panel>
  );
}

/** The ids of the drones that may be flown by hand, one per line: the same text while they stay. */
function steerableDrones(state: ConsoleState): string {
  if (fliesByItself(state.capture)) return "";
  const reports = [...state.drones.values()].map((drone) => drone.report);
  return reports
    .filter((report) => report.activity === "flying" && !report.held)
    .map((report) => report.drone_id)
    .join("\n");
}

function Pad({ droneId }: { readonly droneId: string }) {
  const hand = useHand(droneId);
  const pad = useGamepadName();
  const text = words.manual;
  return (
    <>
      <div className="pad">
        {CROSSES.map((cross) => (
          <div key={cross[0]} className="cross">
            {cross.map((push) => (
              <PushButton key={push} push={push} hand={hand} />
            ))}
          </div>
        ))}
      </div>
      <p className="hint">{pad === null ? text.hint : text.pad(pad)}</p>
    </>
  );
}

interface PushButtonProps {
  readonly push: Push;
  readonly hand: { readonly current: Hand | null };
}

/** A button that pushes as long as it is held, by a finger, a mouse or the Enter key. */
function PushButton({ push, hand }: PushButtonProps) {
  const press = () => {
    hand.current?.push(push);
  };
  const release = () => {
    hand.current?.release(push);
  };
  return (
    <button
      type="button"
      className={`button push push-${push}`}
      aria-keyshortcuts={LETTER[push]}
      onPointerDown={press}
      onPointerUp={release}
      onPointerLeave={release}
      onPointerCancel={release}
      onKeyDown={(event) => {
        if (event.key === "Enter") press();
      }}
      onKeyUp={release}
      onBlur={release}
      onContextMenu={(event) => {
        event.preventDefault();
      }}
    >
      <Icon name={push} />
      <span>{words.manual.push[push]}</span>
      <kbd>{LETTER[push]}</kbd>
    </button>
  );
}

/** A hand on the sticks of `droneId` while the panel shows it, with the keys of the page. */
function useHand(droneId: string): { readonly current: Hand | null } {
  const operator = useOperator();
  const hand = useRef<Hand | null>(null);
  useEffect(() => {
    const own = new Hand(
      (sticks) => {
        operator.steer(droneId, sticks);
      },
      { pads: gamepads, seen: () => !document.hidden },
    );
    hand.current = own;
    own.start();
    const forget = listenForPushes(own);
    return () => {
      forget();
      own.stop();
      hand.current = null;
    };
  }, [droneId, operator]);
  return hand;
}

function listenForPushes(hand: Hand): () => void {
  const down = (event: KeyboardEvent) => {
    if (event.ctrlKey || event.altKey || event.metaKey) {
      // Some systems keep the release of other keys to themselves while such a key is down.
      hand.letGo();
      return;
    }
    const push = pushOfKey(event.code);
    if (push === null || isElsewhere(event.target)) return;
    event.preventDefault();
    // A key that was held before the drone could be flown repeats, and means nothing.
    if (!event.repeat) hand.push(push);
  };
  const up = (event: KeyboardEvent) => {
    const push = pushOfKey(event.code);
    if (push !== null) hand.release(push);
  };
  // Keys that are released elsewhere are never heard of.
  const away = () => {
    hand.letGo();
  };
  const listeners = new AbortController();
  const { signal } = listeners;
  window.addEventListener("keydown", down, { signal });
  window.addEventListener("keyup", up, { signal });
  for (const event of ["blur", "contextmenu"]) window.addEventListener(event, away, { signal });
  document.addEventListener("visibilitychange", away, { signal });
  return () => {
    listeners.abort();
  };
}

/** True where a letter is meant for something else: a field, a choice, a sheet above the screen. */
function isElsewhere(target: EventTarget | null): boolean {
  if (takesText(target as KeyTarget | null) || target instanceof HTMLSelectElement) return true;
  return document.querySelector("main")?.inert === true;
}

/** The name of the first gamepad at hand; a browser shows it once one of its buttons was pressed. */
function useGamepadName(): string | null {
  const [name, setName] = useState(firstPad);
  useEffect(() => {
    const look = () => {
      setName(firstPad());
    };
    window.addEventListener("gamepadconnected", look);
    window.addEventListener("gamepaddisconnected", look);
    return () => {
      window.removeEventListener("gamepadconnected", look);
      window.removeEventListener("gamepaddisconnected", look);
    };
  }, []);
  return name;
}

function firstPad(): string | null {
  return gamepads().find((pad) => pad !== null)?.id ?? null;
}

/** The gamepads at hand; none where the browser keeps them to secure pages, or a policy forbids them. */
function gamepads(): readonly (Gamepad | null)[] {
  try {
    return navigator.getGamepads();
  } catch {
    return [];
  }
}
