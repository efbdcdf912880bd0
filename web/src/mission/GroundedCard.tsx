import { useConsole } from "../context";
import { Icon } from "../design/Icon";
import { groups, readiness } from "../preflight/readiness";
import { usePreflight } from "../preflight/usePreflight";
import type { CaptureReport } from "../protocol/messages.gen";
import { words } from "../text/words";

/** All drones are down before the last picture: what to do, and which of them are ready again. */
export function GroundedCard({ capture }: { readonly capture: CaptureReport }) {
  const { checks, error } = usePreflight();
  const text = words.mission.grounded;
  return (
    <section className="grounded" aria-label={text.title} data-testid="grounded">
      <h3>
        <Icon name="ground" />
        {text.title}
      </h3>
      <p>{text.safe(capture.images, capture.images_total)}</p>
      <ol>
        {text.steps.map((step) => (
          <li key={step}>{step}</li>
        ))}
      </ol>
      {error !== null && <p className="field-error">{words.preflight.stale(error)}</p>}
      <ul className="grounded-drones">
        {groups(checks ?? [])
          .filter((group) => group.droneId !== null)
          .map((group) => (
            <DroneReady
              key={group.droneId}
              droneId={group.droneId ?? ""}
              missing={readiness(group.checks, null, {}).blockers.map((check) => check.found)}
            />
          ))}
      </ul>
    </section>
  );
}

function DroneReady({ droneId, missing }: { readonly droneId: string; readonly missing: readonly string[] }) {
  const drone = useConsole((state) => state.drones.get(droneId)?.report);
  const ready = missing.length === 0;
  return (
    <li className={ready ? "is-ready" : ""}>
      <span
        className="line-drone"
        style={{ "--drone": drone?.colour ?? "var(--line)" } as React.CSSProperties}
      >
        {drone?.name ?? droneId}
      </span>
      <span className="grounded-state">
        <Icon name={ready ? "check" : "abort"} />
        {ready ? words.mission.grounded.ready : missing.join(", ")}
      </span>
    </li>
  );
}
