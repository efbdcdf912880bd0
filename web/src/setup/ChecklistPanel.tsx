import type { Check } from "../api/safety";
import { useConsole } from "../context";
import { Icon } from "../design/Icon";
import { Panel } from "../design/Panel";
import { activityFace, isFlying } from "../fly/activity";
import { CheckRow } from "../preflight/CheckRow";
import { groups, type Group } from "../preflight/readiness";
import type { Preflight } from "../preflight/usePreflight";
import { words } from "../text/words";

/** The preflight checklist as it stands, and what to do about each failure. */
export function ChecklistPanel({ preflight: { checks, error } }: { readonly preflight: Preflight }) {
  const drones = useConsole((state) => state.drones);
  const inAir = [...drones.values()].filter(({ report }) => isFlying(report.activity));
  const flying = new Set(inAir.map(({ report }) => report.drone_id));
  // The checklist is for drones that stand.
  const counts = (check: Check) => check.drone_id === null || !flying.has(check.drone_id);
  const failed = (checks ?? []).filter((check) => !check.passed && counts(check)).length;
  const text = words.preflight;
  const good = checks !== null && error === null && failed === 0;
  return (
    <Panel
      title={words.setup.checklist}
      className="checklist"
      aside={
        <span className={`chip ${good ? "chip-good" : "chip-bad"}`} role="status" data-testid="checklist-verdict">
          <Icon name={good ? "check" : "warning"} />
          {error !== null ? text.stale(error) : checks === null ? text.asking : good ? text.clear : text.notOk(failed)}
        </span>
      }
    >
      {flying.size > 0 && <p className="hint">{words.setup.inAir(flying.size)}</p>}
      <div className="check-groups">
        {groups(checks ?? []).map((group) => (
          <DroneChecks key={group.droneId ?? ""} group={group} />
        ))}
      </div>
      <p className="hint">{words.setup.overrides}</p>
    </Panel>
  );
}

/** A drone's items; those of one that is ready are folded away. */
function DroneChecks({ group }: { readonly group: Group }) {
  const drone = useConsole((state) =>
    group.droneId === null ? undefined : state.drones.get(group.droneId)?.report,
  );
  const activity = drone?.activity ?? "ground";
  const inAir = isFlying(activity);
  const face = activityFace(activity);
  const failed = inAir ? 0 : group.checks.filter((check) => !check.passed).length;
  const name = drone?.name ?? group.droneId ?? words.preflight.console;
  return (
    <details
      className="check-group"
      open={failed > 0}
      style={{ "--drone": drone?.colour ?? "var(--line)" } as React.CSSProperties}
    >
      <summary>
        <h3 className={group.droneId === null ? "" : "card-name"}>{name}</h3>
        {inAir ? (
          <span className={`chip chip-${face.tone}`}>
            <Icon name={face.icon} />
            {face.word}
          </span>
        ) : (
          <span className={`chip ${failed === 0 ? "chip-good" : "chip-bad"}`}>
            <Icon name={failed === 0 ? "check" : "abort"} />
            {failed === 0 ? words.preflight.ready : words.preflight.notOk(failed)}
          </span>
        )}
      </summary>
      <ul>
        {group.checks.map((check) => (
          <CheckRow key={check.key} check={check} />
        ))}
      </ul>
    </details>
  );
}
