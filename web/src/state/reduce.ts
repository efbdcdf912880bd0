import type { CaptureReport, PictureReport, ServerMessage } from "../protocol/messages.gen";
import { en } from "../text/en";
import { stepOfPhase, STEPS, type Step } from "./phases";
import { appendReport } from "./series";
import {
  isActive,
  NO_FINDINGS,
  type ConsoleState,
  type Findings,
  type LocalMessage,
  type LogLine,
  type Message,
} from "./state";

/** Lines the event log keeps; the oldest go first. The run folder has them all. */
const LONGEST_LOG = 500;

/** Alarms that fit above the page without hiding it. */
const MOST_ALARMS = 3;

/**
 * Return the state after `message`, received at `nowMs` of the browser's clock.
 *
 * Pure: the same state, message and time give the same state, and nothing is changed in place.
 */
export function reduce(state: ConsoleState, message: Message, nowMs: number): ConsoleState {
  return isLocal(message)
    ? reduceLocal(state, message, nowMs)
    : reduceServer({ ...state, lastMessageMs: nowMs }, message, nowMs);
}

/** Every tag of the local messages, once; the compiler refuses a missing or a foreign one. */
const LOCAL_TYPES: Readonly<Record<LocalMessage["type"], true>> = {
  stream_opened: true,
  stream_lost: true,
  signed_out: true,
  hold_accepted: true,
  alarm_raised: true,
  alarm_dismissed: true,
  logged: true,
};

function isLocal(message: Message): message is LocalMessage {
  return Object.hasOwn(LOCAL_TYPES, message.type);
}

function reduceLocal(state: ConsoleState, message: LocalMessage, nowMs: number): ConsoleState {
  switch (message.type) {
    case "stream_opened":
      // The server repeats what stands, so nothing has to be forgotten here.
      return {
        ...state,
        connection: { kind: "open" },
        epoch: state.epoch + 1,
        lastMessageMs: nowMs,
      };
    case "stream_lost":
      if (state.connection.kind === "lost" || state.connection.kind === "signed_out") return state;
      return { ...state, connection: { kind: "lost", sinceMs: nowMs } };
    case "signed_out":
      return { ...state, connection: { kind: "signed_out" } };
    case "hold_accepted":
      return { ...state, drones: withHeld(state, message.droneId) };
    case "alarm_raised":
      return withAlarm(state, { ...message, level: "error" });
    case "alarm_dismissed":
      return { ...state, alarms: state.alarms.filter((alarm) => alarm.id !== message.id) };
    case "logged":
      return withLine(state, message);
  }
}

function reduceServer(state: ConsoleState, message: ServerMessage, nowMs: number): ConsoleState {
  switch (message.type) {
    case "drone_reported": {
      const drones = new Map(state.drones);
      drones.set(message.drone_id, { report: message, receivedMs: nowMs });
      return { ...state, drones };
    }
    case "capture_changed":
      return withCapture(state, message);
    case "capture_taken":
      return found(state, { pictures: withPicture(state.findings.pictures, message) });
    case "plan_progressed":
      return found(state, { planning: message });
    case "plan_found":
      return found(state, { plan: message, planning: null });
    case "seed_fitted":
      return found(state, { seed: message });
    case "training_progressed": {
      const { quality, training } = state.findings;
      const next = found(state, {
        training: message,
        quality: appendReport(quality, training, message),
      });
      return withStep(next, message.at);
    }
    case "poses_refined":
      return found(state, { poses: message });
    case "preview_rendered":
      return found(state, { preview: message });
    case "metrics_measured":
      return found(state, { metrics: message });
    case "noted":
      return withLine(state, { ...message, droneId: message.drone_id });
    case "missed":
      return withLine(state, {
        at: new Date(nowMs).toISOString(),
        level: "warning",
        text: en.log.missed(message.events),
        droneId: null,
      });
  }
}

function found(state: ConsoleState, news: Partial<Findings>): ConsoleState {
  return { ...state, findings: { ...state.findings, ...news } };
}

function withHeld(state: ConsoleState, droneId: string | null): ConsoleState["drones"] {
  const drones = new Map(state.drones);
  for (const [id, drone] of state.drones) {
    if (droneId === null || id === droneId) {
      drones.set(id, { ...drone, report: { ...drone.report, held: true } });
    }
  }
  return drones;
}

/** Pictures in order of taking; one that is reported twice is kept once. */
function withPicture(
  pictures: readonly PictureReport[],
  picture: PictureReport,
): readonly PictureReport[] {
  const others = pictures.filter((other) => other.index !== picture.index);
  return [...others, picture].sort((a, b) => a.index - b.index);
}

/**
 * Take over a capture's new state.
 *
 * The capture at hand is the active one, else the newest; a report about an older one changes
 * nothing. When another one becomes active, the findings of the last one go.
 */
function withCapture(state: ConsoleState, capture: CaptureReport): ConsoleState {
  const current = state.capture;
  if (current === null || current.id === capture.id) {
    return withStep({ ...state, capture }, capture.at);
  }
  if (!isActive(capture) && (isActive(current) || capture.at < current.at)) return state;
  const fresh: ConsoleState = {
    ...state,
    capture,
    step: null,
    stepEntered: {},
    findings: isActive(capture) ? NO_FINDINGS : state.findings,
  };
  return withStep(fresh, capture.at);
}

/** Move the timeline to where capture and training stand; it never moves back. */
function withStep(state: ConsoleState, at: string): ConsoleState {
  if (state.capture === null) return state;
  const step = stepOfPhase(state.capture.phase, state.findings.training?.stage ?? null);
  if (step === null || step === state.step || isBefore(step, state.step)) return state;
  return { ...state, step, stepEntered: { ...state.stepEntered, [step]: at } };
}

function isBefore(step: Step, other: Step | null): boolean {
  return other !== null && STEPS.indexOf(step) < STEPS.indexOf(other);
}

/** Log what failed and keep it in sight; the same failure again replaces the older one. */
function withAlarm(state: ConsoleState, line: Omit<LogLine, "id">): ConsoleState {
  const alarm = { ...line, id: state.nextLogId };
  const others = state.alarms.filter((other) => other.text !== line.text);
  return { ...withLine(state, line), alarms: [...others, alarm].slice(-MOST_ALARMS) };
}

/** Append a line; one that stands already is a repetition after a reconnection. */
function withLine(state: ConsoleState, line: Omit<LogLine, "id">): ConsoleState {
  const { at, level, text, droneId } = line;
  if (state.log.some((old) => old.at === at && old.text === text)) return state;
  const log = [...state.log, { id: state.nextLogId, at, level, text, droneId }];
  return { ...state, log: log.slice(-LONGEST_LOG), nextLogId: state.nextLogId + 1 };
}
