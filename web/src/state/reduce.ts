import type {
  CaptureReport,
  FailsafeReport,
  PictureReport,
  PlanProgress,
  ServerMessage,
} from "../protocol/messages.gen";
import { words } from "../text/words";
import { withPast, withReport } from "./history";
import { stepOfPhase, STEPS, stepsEntered, type Step } from "./phases";
import { appendReport } from "./series";
import {
  isActive,
  NO_FINDINGS,
  NO_MISSION,
  type ConsoleState,
  type Findings,
  type LocalMessage,
  type LogLine,
  type Message,
  type Mission,
} from "./state";

/** Lines the event log keeps; the oldest go first. The run folder has them all. */
const LONGEST_LOG = 500;

/** As many as the server remembers. */
const MOST_FAILSAFES = 50;

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
    : reduceServer(settled({ ...state, lastMessageMs: nowMs }, message, nowMs), message, nowMs);
}

/** Every tag of the local messages, once; the compiler refuses a missing or a foreign one. */
const LOCAL_TYPES: Readonly<Record<LocalMessage["type"], true>> = {
  stream_opened: true,
  stream_lost: true,
  signed_out: true,
  failsafes_known: true,
  history_known: true,
  command_taken: true,
  command_released: true,
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
      return {
        ...state,
        connection: { kind: "open" },
        epoch: state.epoch + 1,
        lastMessageMs: nowMs,
        arriving: {
          mission: NO_MISSION,
          sinceMs: nowMs,
          before:
            state.connection.kind === "lost"
              ? { lostMs: state.connection.sinceMs, lines: state.nextLogId }
              : null,
        },
        // The server repeats those that stand; the others were taken back meanwhile.
        planView: "planned",
        command: { holder: null, asking: null },
        picks: new Map(),
        disagreement: null,
        priorities: [],
        noGo: [],
      };
    case "stream_lost":
      if (state.connection.kind === "signed_out") return state;
      return {
        ...state,
        connection: {
          kind: "lost",
          sinceMs: state.connection.kind === "lost" ? state.connection.sinceMs : nowMs,
          retryMs: nowMs + message.retryInMs,
        },
      };
    case "signed_out":
      return { ...state, connection: { kind: "signed_out" } };
    case "failsafes_known":
      return { ...state, failsafeTable: message.rows };
    case "history_known":
      return { ...state, history: withPast(state.history, message.reports) };
    case "command_taken":
    case "command_released": {
      const inCommand = message.type === "command_taken";
      return state.inCommand === inCommand ? state : { ...state, inCommand };
    }
    case "hold_accepted":
      return { ...state, drones: withHeld(state, message.droneId) };
    case "alarm_raised":
      return withAlarm(state, { at: message.at, text: message.text, level: "error", droneId: null });
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
      const before = drones.get(message.drone_id);
      const same = before?.report.activity === message.activity;
      const activitySince = before === undefined ? "" : same ? before.activitySince : message.at;
      drones.set(message.drone_id, { report: message, receivedMs: nowMs, activitySince });
      return { ...state, drones, history: withReport(state.history, message) };
    }
    case "command_changed":
      return { ...state, command: { holder: message.holder, asking: message.asking } };
    case "plan_view_changed":
      return { ...state, planView: message.shown };
    case "failsafe_fired":
      return withFailsafe(state, message);
    case "object_pointed_out": {
      const picks = new Map(state.picks);
      if (message.box === null) picks.delete(message.drone_id);
      else picks.set(message.drone_id, message);
      return { ...state, picks };
    }
    case "views_disagree":
      return { ...state, disagreement: message.drone_ids.length === 0 ? null : message };
    case "priorities_changed":
      return { ...state, priorities: message.parts };
    case "no_go_changed":
      return { ...state, noGo: message.volumes };
    case "noted":
      return withLine(state, { ...message, droneId: message.drone_id });
    case "missed":
      return withLine(state, {
        at: new Date(nowMs).toISOString(),
        level: "warning",
        text: words.log.missed(message.events),
        droneId: null,
      });
    case "capture_changed":
    case "capture_taken":
    case "plan_progressed":
    case "plan_found":
    case "seed_fitted":
    case "surface_seen":
    case "training_progressed":
    case "poses_refined":
    case "preview_rendered":
    case "metrics_measured": {
      const { arriving } = state;
      if (arriving === null) return { ...state, ...reduceMission(state, message, true) };
      const mission = reduceMission(arriving.mission, message, false);
      return { ...state, arriving: { ...arriving, mission } };
    }
  }
}

/** A fleet reports last of all that stands; without one, this much time must do. */
const LONGEST_ARRIVAL_MS = 2000;

/** Show the mission that has arrived once it is whole. */
function settled(state: ConsoleState, message: ServerMessage, nowMs: number): ConsoleState {
  const { arriving } = state;
  if (arriving === null) return state;
  const late = nowMs - arriving.sinceMs > LONGEST_ARRIVAL_MS;
  if (message.type !== "drone_reported" && !late) return state;
  const next = { ...state, ...joined(missionOf(state), arriving.mission), arriving: null };
  return arriving.before === null ? next : withMissed(state, next, arriving.before, nowMs);
}

/** Say how long the line was gone and what happened meanwhile: the server has told it just now. */
function withMissed(
  before: ConsoleState,
  after: ConsoleState,
  lost: NonNullable<NonNullable<ConsoleState["arriving"]>["before"]>,
  nowMs: number,
): ConsoleState {
  const events = after.nextLogId - lost.lines;
  const same = before.capture?.id === after.capture?.id;
  const had = same ? before.findings.pictures.length : 0;
  const pictures = Math.max(0, after.findings.pictures.length - had);
  const seconds = Math.round((nowMs - lost.lostMs) / 1000);
  return withLine(after, {
    at: new Date(nowMs).toISOString(),
    level: "info",
    text: words.log.back(seconds, events, pictures),
    droneId: null,
  });
}

/** The mission as it arrived, with what only this browser remembers of the same capture. */
function joined(before: Mission, arrived: Mission): Mission {
  if (arrived.capture === null || before.capture?.id !== arrived.capture.id) return arrived;
  const { training, quality, annealing } = before.findings;
  const news = arrived.findings.training;
  const known = news === null || news.at === training?.at;
  return {
    ...arrived,
    stepEntered: { ...arrived.stepEntered, ...before.stepEntered },
    findings: {
      ...arrived.findings,
      annealing,
      training: known ? training : news,
      quality: known ? quality : appendReport(quality, training, news),
    },
  };
}

/** The mission alone, where the whole state may have been handed in. */
function missionOf(mission: Mission): Mission {
  const { capture, step, stepEntered, findings } = mission;
  return { capture, step, stepEntered, findings };
}

type MissionMessage = Exclude<
  ServerMessage,
  {
    readonly type:
      | "drone_reported"
      | "failsafe_fired"
      | "object_pointed_out"
      | "views_disagree"
      | "priorities_changed"
      | "no_go_changed"
      | "plan_view_changed"
      | "command_changed"
      | "noted"
      | "missed";
  }
>;

/** Take in news of the mission; `live` when they are not a repetition of what stands. */
function reduceMission(mission: Mission, message: MissionMessage, live: boolean): Mission {
  switch (message.type) {
    case "capture_changed":
      return withCapture(mission, message, live);
    case "capture_taken":
      return found(mission, { pictures: withPicture(mission.findings.pictures, message) });
    case "plan_progressed":
      return found(mission, {
        planning: message,
        annealing: withProgress(mission.findings.annealing, message),
      });
    case "plan_found":
      return found(mission, { plan: message, planning: null });
    case "seed_fitted":
      return found(mission, { seed: message });
    case "surface_seen":
      return found(mission, { coverage: message });
    case "training_progressed": {
      const { quality, training } = mission.findings;
      const next = found(mission, {
        training: message,
        quality: appendReport(quality, training, message),
      });
      return withStep(next, message.at);
    }
    case "poses_refined":
      return found(mission, { poses: message });
    case "preview_rendered":
      return found(mission, { preview: message });
    case "metrics_measured":
      return found(mission, { metrics: message });
  }
}

function found(mission: Mission, news: Partial<Findings>): Mission {
  const { capture, step, stepEntered, findings } = mission;
  return { capture, step, stepEntered, findings: { ...findings, ...news } };
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

/** The annealing's course; one that begins anew leaves nothing of the last. */
function withProgress(course: readonly PlanProgress[], news: PlanProgress): readonly PlanProgress[] {
  const last = course.at(-1);
  return last !== undefined && news.iteration > last.iteration ? [...course, news] : [news];
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
 * nothing. When another one begins (`live`), the findings of the last one go.
 */
function withCapture(mission: Mission, capture: CaptureReport, live: boolean): Mission {
  const current = mission.capture;
  // A browser that comes late knows from the report alone when the steps before were entered.
  const entered = stepsEntered(capture.entered);
  if (current === null || current.id === capture.id) {
    const stepEntered = { ...mission.stepEntered, ...entered };
    return withStep({ ...missionOf(mission), capture, stepEntered }, capture.at);
  }
  if (!isActive(capture) && (isActive(current) || capture.at < current.at)) return mission;
  const findings = live ? NO_FINDINGS : mission.findings;
  return withStep({ capture, step: null, stepEntered: entered, findings }, capture.at);
}

/** Move the timeline to where capture and training stand; it never moves back. */
function withStep(mission: Mission, at: string): Mission {
  if (mission.capture === null) return mission;
  const step = stepOfPhase(mission.capture.phase, mission.findings.training?.stage ?? null);
  if (step === null || step === mission.step || isBefore(step, mission.step)) return mission;
  return { ...mission, step, stepEntered: { [step]: at, ...mission.stepEntered } };
}

function isBefore(step: Step, other: Step | null): boolean {
  return other !== null && STEPS.indexOf(step) < STEPS.indexOf(other);
}

/** Keep what fired; one that stands already is a repetition after a reconnection. */
function withFailsafe(state: ConsoleState, fired: FailsafeReport): ConsoleState {
  const known = state.failsafes.some(
    (old) =>
      old.at === fired.at &&
      old.drone_id === fired.drone_id &&
      old.event === fired.event &&
      old.action === fired.action,
  );
  if (known) return state;
  return { ...state, failsafes: [...state.failsafes, fired].slice(-MOST_FAILSAFES) };
}

/** Log what failed and keep it in sight; the same failure again replaces the older one. */
function withAlarm(state: ConsoleState, line: Omit<LogLine, "id">): ConsoleState {
  const alarm = { ...line, id: state.nextLogId };
  const others = state.alarms.filter((other) => other.text !== line.text);
  return { ...withLine(state, line), alarms: [...others, alarm].slice(-MOST_ALARMS) };
}

/**
 * Append a line; one that stands already is a repetition after a reconnection.
 *
 * What arrives after the socket opened happened before: it goes where its time says. Later lines
 * stand in the order in which they come, for server and browser need not agree on the time.
 */
function withLine(state: ConsoleState, line: Omit<LogLine, "id">): ConsoleState {
  const { at, level, text, droneId } = line;
  if (state.log.some((old) => old.at === at && old.text === text)) return state;
  const ms = Date.parse(at);
  const later = (old: LogLine) => Date.parse(old.at) > ms;
  const before = state.arriving === null ? -1 : state.log.findIndex(later);
  const place = before < 0 ? state.log.length : before;
  const log = state.log.toSpliced(place, 0, { id: state.nextLogId, at, level, text, droneId });
  return { ...state, log: log.slice(-LONGEST_LOG), nextLogId: state.nextLogId + 1 };
}
