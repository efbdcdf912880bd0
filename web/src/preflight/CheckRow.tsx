import { useId } from "react";
import type { Check } from "../api/safety";
import { Icon } from "../design/Icon";
import { words } from "../text/words";
import { isReason, REASON_LENGTH } from "./readiness";

interface CheckRowProps {
  readonly check: Check;
  /** The reason as it is typed; undefined while nobody wants to override the item. */
  readonly reason?: string | undefined;
  /** Null takes the override back. Without it the item is only shown. */
  readonly onReason?: (reason: string | null) => void;
}

/** One item: mark and word, what was found, what to do, and the override where one is allowed. */
export function CheckRow({ check, reason, onReason }: CheckRowProps) {
  const text = words.preflight;
  const names: Readonly<Record<string, string>> = text.item;
  const overridden = !check.passed && !check.final && isReason(reason);
  const state = check.passed ? "passed" : overridden ? "overridden" : "failed";
  return (
    <li className={`check is-${state}`} data-testid={`check-${check.key}`} data-state={state}>
      <span className="check-mark">
        <Icon name={{ passed: "check", overridden: "hand", failed: "abort" }[state] as "check"} />
        {text.state[state]}
      </span>
      <span className="check-words">
        <span className="check-item">{names[check.item] ?? check.item.replaceAll("_", " ")}</span>
        <span className="check-found">{check.found}</span>
        {check.remedy !== "" && <span className="check-remedy">{check.remedy}</span>}
        {!check.passed && check.final && <span className="check-final">{text.final}</span>}
      </span>
      {!check.passed && !check.final && onReason !== undefined && (
        <Override check={check} reason={reason} onReason={onReason} />
      )}
    </li>
  );
}

/** Asks for the reason to fly anyway; without one the item keeps its drone on the ground. */
function Override({ check, reason, onReason }: Required<CheckRowProps>) {
  const id = useId();
  const text = words.preflight;
  if (reason === undefined) {
    return (
      <button
        type="button"
        className="button button-small check-override"
        data-testid={`override-${check.key}`}
        onClick={() => {
          onReason("");
        }}
      >
        {text.override}
      </button>
    );
  }
  const good = isReason(reason);
  return (
    <div className="check-reason">
      <label htmlFor={id}>{text.reason}</label>
      <input
        id={id}
        type="text"
        autoFocus
        autoComplete="off"
        required
        maxLength={REASON_LENGTH.most}
        aria-invalid={!good}
        aria-describedby={`${id}-hint`}
        value={reason}
        onChange={(event) => {
          onReason(event.target.value);
        }}
      />
      <span className="hint" id={`${id}-hint`}>
        {good ? text.reasonKept : text.reasonNeeded(REASON_LENGTH.least)}
      </span>
      <button
        type="button"
        className="button button-small button-quiet"
        onClick={() => {
          onReason(null);
        }}
      >
        {text.takeBack}
      </button>
    </div>
  );
}
