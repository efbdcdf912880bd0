import { useEffect, useRef, useState, type KeyboardEvent } from "react";
import type { CaptureRequest } from "../api/captures";
import { useConsole, useOperator } from "../context";
import { Icon } from "../design/Icon";
import { Elapsed } from "../design/Waiting";
import { words } from "../text/words";
import { CheckRow } from "./CheckRow";
import { blocks, groups, overridesFrom, readiness, type Group, type Reasons } from "./readiness";
import { usePreflight, type Preflight } from "./usePreflight";

/** On a phone a drone that is ready takes one line, so that what is not stands in sight. */
const WIDE = window.matchMedia("(min-width: 561px)");

interface PreflightSheetProps {
  readonly request: CaptureRequest;
  readonly onClose: () => void;
}

/**
 * The checklist between the wish for a capture and its take-off.
 *
 * It lies over the page but below the stops: those take every press while it is open.
 */
export function PreflightSheet({ request, onClose }: PreflightSheetProps) {
  const operator = useOperator();
  const preflight = usePreflight();
  const [reasons, setReasons] = useState<Reasons>({});
  const [count, setCount] = useState(request.drones ?? null);
  const [busy, setBusy] = useState(false);
  const sheet = useFocusWhileOpen();
  const checks = preflight.checks ?? [];
  const judged = readiness(checks, count, reasons);
  const clear = preflight.checks !== null && preflight.error === null && judged.blockers.length === 0;
  const start = () => {
    setBusy(true);
    const drones = count === null ? {} : { drones: count };
    const overrides = overridesFrom(checks, reasons);
    void operator.startCapture({ ...request, ...drones, overrides }).then((accepted) => {
      setBusy(false);
      if (accepted) onClose();
    });
  };
  const changeReason = (key: string, reason: string | null) => {
    const others = Object.entries(reasons).filter(([other]) => other !== key);
    setReasons(Object.fromEntries(reason === null ? others : [...others, [key, reason]]));
  };
  const text = words.preflight;
  return (
    <section
      ref={sheet}
      className="sheet-preflight"
      role="dialog"
      aria-label={text.title}
      tabIndex={-1}
      data-testid="preflight"
      onKeyDown={(event: KeyboardEvent) => {
        if (event.key === "Escape") onClose();
      }}
    >
      <header className="preflight-head">
        <h2>{text.title}</h2>
        <Verdict preflight={preflight} blockers={judged.blockers.length} />
        <button type="button" className="button button-quiet" onClick={onClose}>
          <Icon name="close" />
          {text.close}
        </button>
      </header>
      <div className="check-groups">
        {groups(checks).map((group) => (
          <DroneChecks
            key={group.droneId ?? ""}
            group={group}
            stays={group.droneId !== null && !judged.crew.includes(group.droneId)}
            reasons={reasons}
            onReason={changeReason}
          />
        ))}
      </div>
      <footer className="preflight-foot">
        <p className="hint">{text.refreshes}</p>
        <OtherCrew ready={judged.ready.length} crew={judged.crew.length} blocked={!clear} onChoose={setCount} />
        <button
          type="button"
          className="button button-primary"
          data-testid="preflight-start"
          disabled={!clear || busy}
          onClick={start}
        >
          <Icon name="takeoff" />
          {busy ? words.mission.form.starting : text.start(judged.crew.length)}
        </button>
      </footer>
    </section>
  );
}

function Verdict(props: { readonly preflight: Preflight; readonly blockers: number }) {
  const { checks, error } = props.preflight;
  const text = words.preflight;
  const good = error === null && checks !== null && props.blockers === 0;
  const word =
    error !== null
      ? text.stale(error)
      : checks === null
        ? <>{text.asking} <Elapsed /></>
        : props.blockers === 0
          ? text.clear
          : text.blocked(props.blockers);
  return (
    <p className={`chip ${good ? "chip-good" : checks === null && error === null ? "" : "chip-bad"}`} role="status">
      <Icon name={good ? "check" : "warning"} />
      {word}
    </p>
  );
}

/** Offers to fly with the drones that are ready, when others are not. */
function OtherCrew(props: {
  readonly ready: number;
  readonly crew: number;
  readonly blocked: boolean;
  readonly onChoose: (count: number) => void;
}) {
  const { ready, crew, blocked, onChoose } = props;
  if (!blocked || ready === 0 || ready >= crew) return null;
  return (
    <button
      type="button"
      className="button"
      data-testid="use-others"
      onClick={() => {
        onChoose(ready);
      }}
    >
      {words.preflight.useOthers(ready)}
    </button>
  );
}

function DroneChecks(props: {
  readonly group: Group;
  readonly stays: boolean;
  readonly reasons: Reasons;
  readonly onReason: (key: string, reason: string | null) => void;
}) {
  const { group, stays, reasons, onReason } = props;
  const drone = useConsole((state) =>
    group.droneId === null ? undefined : state.drones.get(group.droneId)?.report,
  );
  const name = drone?.name ?? group.droneId ?? words.preflight.console;
  const failed = group.checks.filter((check) => blocks(check, reasons)).length;
  const clear = failed === 0;
  return (
    <details
      open={WIDE.matches || group.checks.some((check) => !check.passed)}
      className={`check-group ${stays ? "is-staying" : ""}`}
      style={{ "--drone": drone?.colour ?? "var(--line)" } as React.CSSProperties}
      aria-label={name}
    >
      <summary>
        <h3 className={group.droneId === null ? "" : "card-name"}>{name}</h3>
        {stays && <span className="chip">{words.preflight.stays}</span>}
        {!stays && (
          <span className={`chip ${clear ? "chip-good" : "chip-bad"}`}>
            <Icon name={clear ? "check" : "abort"} />
            {clear ? words.preflight.ready : words.preflight.notOk(failed)}
          </span>
        )}
      </summary>
      <ul>
        {group.checks.map((check) => (
          <CheckRow
            key={check.key}
            check={check}
            reason={reasons[check.key]}
            onReason={(reason) => {
              onReason(check.key, reason);
            }}
          />
        ))}
      </ul>
    </details>
  );
}

/** Take the keyboard's focus while the sheet is open and give it back afterwards. */
function useFocusWhileOpen() {
  const sheet = useRef<HTMLElement>(null);
  useEffect(() => {
    const before = document.activeElement;
    sheet.current?.focus();
    return () => {
      if (before instanceof HTMLElement && before.isConnected) before.focus();
    };
  }, []);
  return sheet;
}
