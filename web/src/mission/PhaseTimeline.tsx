import { clock } from "../design/format";
import { Icon } from "../design/Icon";
import type { CaptureReport } from "../protocol/messages.gen";
import { STEPS, type Step } from "../state/phases";
import { isActive } from "../state/state";
import { words } from "../text/words";

interface PhaseTimelineProps {
  readonly capture: CaptureReport | null;
  readonly step: Step | null;
  readonly entered: Readonly<Partial<Record<Step, string>>>;
}

type StepState = keyof typeof words.mission.stepState;

/** The mission's course: what is done, where it stands, what is to come. */
export function PhaseTimeline({ capture, step, entered }: PhaseTimelineProps) {
  return (
    <ol className="timeline" aria-label={words.mission.timeline}>
      {STEPS.map((each, index) => {
        const state = stepState(each, step, capture);
        const note = each === "rounds" ? roundNote(capture, state) : stepTime(index, entered, state);
        return (
          <li key={each} className={`step is-${state}`} aria-current={state === "now" ? "step" : undefined}>
            <span className="step-mark">
              {state === "past" && <Icon name="check" />}
              {state === "failed" && <Icon name="abort" />}
            </span>
            <span>{words.mission.step[each]}</span>
            <span className="sr-only">{words.mission.stepState[state]}</span>
            <span className="step-note">{note}</span>
          </li>
        );
      })}
    </ol>
  );
}

function stepState(each: Step, step: Step | null, capture: CaptureReport | null): StepState {
  if (capture === null || step === null) return "future";
  if (capture.state === "succeeded") return "past";
  const distance = STEPS.indexOf(each) - STEPS.indexOf(step);
  if (distance !== 0) return distance < 0 ? "past" : "future";
  return isActive(capture) ? "now" : "failed";
}

function roundNote(capture: CaptureReport | null, state: StepState): string {
  if (capture === null || capture.rounds === 0 || state === "future") return "";
  const done = state === "past" ? capture.rounds : capture.round_index + 1;
  return words.mission.round(Math.min(done, capture.rounds), capture.rounds);
}

/** How long a finished step took: until the next one that was entered. */
function stepTime(index: number, entered: PhaseTimelineProps["entered"], state: StepState): string {
  if (state !== "past") return "";
  const start = at(STEPS[index], entered);
  const end = STEPS.slice(index + 1)
    .map((next) => at(next, entered))
    .find((ms) => ms !== null);
  if (start === null || end === undefined) return "";
  return clock((end - start) / 1000);
}

function at(step: Step | undefined, entered: PhaseTimelineProps["entered"]): number | null {
  const moment = step === undefined ? undefined : entered[step];
  return moment === undefined ? null : Date.parse(moment);
}
