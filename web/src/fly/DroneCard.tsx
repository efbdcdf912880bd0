import { useState } from "react";
import type { DroneCommand } from "../api/drones";
import { useOperator } from "../context";
import { ConfirmButton } from "../design/ConfirmButton";
import { age, withUnit } from "../design/format";
import { Icon } from "../design/Icon";
import { useNow } from "../design/useNow";
import { CountdownNote } from "../failsafe/CountdownNote";
import { FiredNote } from "../failsafe/FiredNote";
import { DisagreementNote } from "../pick/DisagreementNote";
import type { DroneReport } from "../protocol/messages.gen";
import type { DroneState } from "../state/state";
import { words } from "../text/words";
import { activityFace } from "./activity";

/** A state report older than this is marked: ten reports a second are normal. */
const OLD_STATE_S = 1;
/** An answer older than this is marked: two questions a second are normal. */
const OLD_LINK_S = 1.3;
const LOW_BATTERY_PCT = 35;
const EMPTY_BATTERY_PCT = 20;
const HOT_C = 85;

/** How one drone is, and what may be asked of it alone; `brief` leaves the numbers out. */
export function DroneCard({ drone, brief }: { readonly drone: DroneState; readonly brief: boolean }) {
  const { report } = drone;
  const face = activityFace(report.activity);
  return (
    <div className="card">
      <div className="card-line">
        <span className="card-name">{report.name}</span>
        <span className={`chip chip-${report.held ? "held" : face.tone}`}>
          <Icon name={report.held ? "hold" : face.icon} />
          {report.held ? words.held.word : face.word}
        </span>
        <Battery percent={report.battery_pct} />
      </div>
      <FiredNote drone={drone} />
      <CountdownNote drone={drone} />
      <DisagreementNote droneId={report.drone_id} />
      {!brief && <Telemetry drone={drone} />}
      {!brief && <Commands report={report} inAir={face.inAir} />}
    </div>
  );
}

function Battery({ percent }: { readonly percent: number | null }) {
  const level =
    percent === null || percent > LOW_BATTERY_PCT ? "" : percent > EMPTY_BATTERY_PCT ? "is-warning" : "is-bad";
  return (
    <span className={`battery ${level}`} title={words.fly.telemetry.battery}>
      <span className="sr-only">{words.fly.telemetry.battery}</span>
      {level !== "" && <Icon name="warning" />}
      <span className="battery-body" aria-hidden="true">
        <span style={{ width: `${percent ?? 0}%` }} />
      </span>
      {percent === null ? words.none : `${percent}%`}
    </span>
  );
}

function Telemetry({ drone: { report, receivedMs } }: { readonly drone: DroneState }) {
  const nowMs = useNow(250);
  const names = words.fly.telemetry;
  const elapsedS = Math.max(0, nowMs - receivedMs) / 1000;
  const stateAgeS = report.state_age_s === null ? null : report.state_age_s + elapsedS;
  // Known in flight only: on the ground its silence is no fault.
  const linkAgeS = report.link_age_s === null ? null : report.link_age_s + elapsedS;
  const hot = report.temperature_c !== null && report.temperature_c >= HOT_C;
  return (
    <dl className="telemetry">
      <Value word={names.height} value={withUnit(report.height_m, 2, "m")} />
      <Value word={names.speed} value={withUnit(report.speed_m_s, 2, "m/s")} />
      <Value word={names.sigma} value={withUnit(report.position_sigma_m, 2, "m")} />
      <Value word={names.temperature} value={withUnit(report.temperature_c, 0, "°C")} marked={hot} />
      <Value
        word={names.stateAge}
        value={age(stateAgeS)}
        marked={stateAgeS === null || stateAgeS > OLD_STATE_S}
      />
      <Value word={names.linkAge} value={age(linkAgeS)} marked={linkAgeS !== null && linkAgeS > OLD_LINK_S} />
    </dl>
  );
}

function Value(props: { readonly word: string; readonly value: string; readonly marked?: boolean }) {
  return (
    <div className={props.marked === true ? "is-late" : ""}>
      <dt>{props.word}</dt>
      <dd>{props.value}</dd>
    </div>
  );
}

function Commands({ report, inAir }: { readonly report: DroneReport; readonly inAir: boolean }) {
  const operator = useOperator();
  const [busy, setBusy] = useState(false);
  const give = (command: DroneCommand) => {
    setBusy(true);
    void operator.command(report.drone_id, command).finally(() => {
      setBusy(false);
    });
  };
  const id = report.drone_id;
  return (
    <div className="card-commands">
      {report.held ? (
        <button
          type="button"
          className="button button-small"
          data-testid={`rearm-${id}`}
          disabled={busy}
          onClick={() => {
            give("rearm");
          }}
        >
          <Icon name="rearm" />
          {words.fly.command.rearm}
        </button>
      ) : (
        <button
          type="button"
          className="button button-small"
          data-testid={`hold-${id}`}
          onClick={() => {
            give("hold");
          }}
        >
          <Icon name="hold" />
          {words.fly.command.hold}
        </button>
      )}
      {inAir ? (
        <button
          type="button"
          className="button button-small"
          data-testid={`land-${id}`}
          onClick={() => {
            give("land");
          }}
        >
          <Icon name="land" />
          {words.fly.command.land}
        </button>
      ) : (
        <ConfirmButton
          className="button-small"
          disabled={busy || report.held}
          label={
            <>
              <Icon name="takeoff" />
              {words.fly.command.takeoff}
            </>
          }
          confirm={
            <>
              <Icon name="takeoff" />
              {words.fly.command.confirm}
            </>
          }
          onConfirm={() => {
            give("takeoff");
          }}
        />
      )}
    </div>
  );
}
