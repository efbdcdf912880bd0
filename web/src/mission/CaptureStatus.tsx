import { useOperator } from "../context";
import { ConfirmButton } from "../design/ConfirmButton";
import { clock } from "../design/format";
import { Icon, type IconName } from "../design/Icon";
import type { CaptureReport } from "../protocol/messages.gen";
import type { Step } from "../state/phases";
import { isActive } from "../state/state";
import { en } from "../text/en";

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

/** State, phase, progress and counters of the capture at hand. */
export function CaptureStatus({ capture, step }: { readonly capture: CaptureReport | null; readonly step: Step | null }) {
  if (capture === null) {
    return (
      <div className="status">
        <p className="status-phase" data-testid="phase" data-phase="">
          {en.mission.idle}
        </p>
      </div>
    );
  }
  const face = FACE[capture.state];
  const percent = Math.round(100 * Math.min(1, Math.max(0, capture.progress)));
  return (
    <div className="status">
      <div className="status-line">
        <p className="status-phase" data-testid="phase" data-phase={capture.phase} data-state={capture.state}>
          {phaseWord(capture, step)}
        </p>
        <span className={`chip chip-${face.tone}`}>
          <Icon name={face.icon} />
          {en.mission.state[capture.state]}
        </span>
      </div>
      <div
        className={`progress is-${capture.state}`}
        role="progressbar"
        aria-label={en.mission.progress}
        aria-valuemin={0}
        aria-valuemax={100}
        aria-valuenow={percent}
      >
        <span style={{ width: `${percent}%` }} />
      </div>
      <dl className="counters">
        <div>
          <dt>{en.mission.pictures}</dt>
          <dd>
            {capture.images}
            <small> / {capture.images_total}</small>
          </dd>
        </div>
        <div>
          <dt>{en.mission.rounds}</dt>
          <dd>
            {Math.min(capture.round_index + 1, capture.rounds)}
            <small> / {capture.rounds}</small>
          </dd>
        </div>
        <div>
          <dt>{en.mission.left}</dt>
          <dd>
            {isActive(capture) && capture.eta_s !== null ? clock(capture.eta_s) : en.none}
          </dd>
        </div>
      </dl>
      {capture.error !== null && (
        <p className="status-error" role="alert">
          <Icon name="error" />
          {capture.error}
        </p>
      )}
    </div>
  );
}

function phaseWord(capture: CaptureReport, step: Step | null): string {
  const words: Readonly<Record<string, string>> = en.mission.phase;
  const phase = capture.phase === "train" && step === "refine" ? "refine" : capture.phase;
  return words[phase] ?? phase;
}

/** Pause, resume and abort, as far as the capture's state allows. */
export function CaptureControls({ capture }: { readonly capture: CaptureReport }) {
  const operator = useOperator();
  const paused = capture.state === "paused";
  return (
    <div className="capture-controls">
      <button
        type="button"
        className={`button ${paused ? "button-primary" : ""}`}
        data-testid={paused ? "capture-resume" : "capture-pause"}
        onClick={() => void operator.changeCapture(capture.id, paused ? "resume" : "pause")}
      >
        <Icon name={paused ? "play" : "pause"} />
        {paused ? en.mission.resume : en.mission.pause}
      </button>
      <ConfirmButton
        className="button-danger"
        label={
          <>
            <Icon name="abort" />
            {en.mission.abort}
          </>
        }
        confirm={
          <>
            <Icon name="abort" />
            {en.mission.abortConfirm}
          </>
        }
        onConfirm={() => void operator.changeCapture(capture.id, "abort")}
      />
    </div>
  );
}
