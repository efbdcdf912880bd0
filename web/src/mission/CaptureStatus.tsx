import { CANCEL_MS } from "../api/jobs";
import { useConsole, useOperator } from "../context";
import { ConfirmButton } from "../design/ConfirmButton";
import { clock } from "../design/format";
import { Icon, type IconName } from "../design/Icon";
import { useUnderWay } from "../design/useUnderWay";
import { Waiting } from "../design/Waiting";
import type { CaptureReport } from "../protocol/messages.gen";
import type { Step } from "../state/phases";
import { canPause, fliesByItself, isActive } from "../state/state";
import { words } from "../text/words";

type CaptureState = CaptureReport["state"];

const FACE: Readonly<Record<CaptureState, { icon: IconName; tone: string }>> = {
  queued: { icon: "info", tone: "calm" },
  running: { icon: "play", tone: "good" },
  paused: { icon: "pause", tone: "busy" },
  succeeded: { icon: "check", tone: "good" },
  failed: { icon: "error", tone: "bad" },
  aborted: { icon: "abort", tone: "busy" },
  interrupted: { icon: "warning", tone: "busy" },
};

/** A capture's state as a word with its drawing. */
export function CaptureChip({ state }: { readonly state: CaptureState }) {
  const face = FACE[state];
  return (
    <span className={`chip chip-${face.tone}`}>
      <Icon name={face.icon} />
      {words.mission.state[state]}
    </span>
  );
}

/** State, phase, progress and counters of the capture at hand. */
export function CaptureStatus({ capture, step }: { readonly capture: CaptureReport | null; readonly step: Step | null }) {
  if (capture === null) {
    return (
      <div className="status">
        <p className="status-phase" data-testid="phase" data-phase="">
          {words.mission.idle}
        </p>
      </div>
    );
  }
  return (
    <div className="status">
      <div className="status-line">
        <p className="status-phase" data-testid="phase" data-phase={capture.phase} data-state={capture.state}>
          {phaseWord(capture, step)}
        </p>
        <CaptureChip state={capture.state} />
      </div>
      <CaptureProgress capture={capture} />
      <dl className="counters">
        <div>
          <dt>{words.mission.pictures}</dt>
          <dd>
            {capture.images}
            <small> / {capture.images_total}</small>
          </dd>
        </div>
        <div>
          <dt>{words.mission.rounds}</dt>
          <dd>
            {Math.min(capture.round_index + 1, capture.rounds)}
            <small> / {capture.rounds}</small>
          </dd>
        </div>
        <div>
          <dt>{words.mission.left}</dt>
          <dd>
            {isActive(capture) && capture.eta_s !== null ? clock(capture.eta_s) : words.none}
          </dd>
        </div>
      </dl>
      <Counters capture={capture} />
      {capture.error !== null && (
        <p className="status-error" role="alert">
          <Icon name="error" />
          {capture.error}
        </p>
      )}
    </div>
  );
}

/** How much of the capture is behind it. */
export function CaptureProgress({ capture }: { readonly capture: CaptureReport }) {
  const percent = Math.round(100 * Math.min(1, Math.max(0, capture.progress)));
  return (
    <div
      className={`progress is-${capture.state}`}
      role="progressbar"
      aria-label={words.mission.progress}
      aria-valuemin={0}
      aria-valuemax={100}
      aria-valuenow={percent}
    >
      <span style={{ width: `${percent}%` }} />
    </div>
  );
}

/** How far the pictures have come: sent for, taken, shown here, in the field. */
function Counters({ capture }: { readonly capture: CaptureReport }) {
  const received = useConsole((state) => state.findings.pictures.length);
  const used = useConsole(
    ({ findings: { training, metrics } }) => training?.images ?? metrics?.images ?? 0,
  );
  const { counter } = words.mission;
  // Of an earlier program's capture nobody counted.
  if (!isActive(capture) && received === 0) return null;
  const rows = [
    ["commanded", capture.commanded],
    ["captured", capture.images],
    ["received", received],
    ["used", used],
  ] as const;
  return (
    <dl className="way" aria-label={counter.label}>
      {rows.map(([key, value]) => (
        <div key={key} title={counter[key].means} data-testid={`counter-${key}`}>
          <dt>{counter[key].word}</dt>
          <dd>{value}</dd>
        </div>
      ))}
    </dl>
  );
}

/** What the capture is doing, in words. */
export function phaseWord(capture: CaptureReport, step: Step | null): string {
  const names: Readonly<Record<string, string>> = words.mission.phase;
  const phase = capture.phase === "train" && step === "refine" ? "refine" : capture.phase;
  return names[phase] ?? phase;
}

/** Pause, resume and abort, as far as the capture's state allows. */
export function CaptureControls({ capture }: { readonly capture: CaptureReport }) {
  const operator = useOperator();
  const paused = capture.state === "paused";
  return (
    <div className="capture-controls">
      {(paused || canPause(capture)) && (
        <button
          type="button"
          className={`button ${paused ? "button-primary" : ""}`}
          data-testid={paused ? "capture-resume" : "capture-pause"}
          onClick={() => void operator.changeCapture(capture.id, paused ? "resume" : "pause")}
        >
          <Icon name={paused ? "play" : "pause"} />
          {paused ? words.mission.resume : words.mission.pause}
        </button>
      )}
      <AbortButton capture={capture} />
    </div>
  );
}

/** Ends the capture: in the air the drones land, on the ground the training stops. */
export function AbortButton({ capture }: { readonly capture: CaptureReport }) {
  const operator = useOperator();
  const [aborting, follow] = useUnderWay();
  return (
    <>
      <ConfirmButton
        className="button-danger"
        testId="capture-abort"
        label={
          <>
            <Icon name="abort" />
            {words.mission.abort}
          </>
        }
        confirm={
          <>
            <Icon name="abort" />
            {fliesByItself(capture) ? words.mission.abortConfirm : words.mission.abortDown}
          </>
        }
        onConfirm={() => {
          follow(operator.changeCapture(capture.id, "abort"));
        }}
      />
      {aborting && <Waiting quiet what={words.mission.aborting} mostMs={CANCEL_MS} />}
    </>
  );
}
