import type {
  CaptureReport,
  DisagreementReport,
  DroneReport,
  FailsafeReport,
  MetricsReport,
  Note,
  PickReport,
  PictureReport,
  PlanProgress,
  PlanReport,
  PlanView,
  PosesReport,
  PreviewReport,
  NoGoVolume,
  PriorityPart,
  CoverageReport,
  SeedReport,
  ServerMessage,
  TrainingReport,
} from "../protocol/messages.gen";
import type { FailsafeRow } from "../api/safety";
import type { History } from "./history";
import type { Step } from "./phases";
import { EMPTY_SERIES, type QualitySeries } from "./series";

type Connection =
  | { readonly kind: "connecting" }
  | { readonly kind: "open" }
  /** The next attempt to open it begins at `retryMs`. */
  | { readonly kind: "lost"; readonly sinceMs: number; readonly retryMs: number }
  /** The server is there and does not know this browser any more. */
  | { readonly kind: "signed_out" };

/** A drone's newest report and when it came, in milliseconds of this browser's clock. */
export interface DroneState {
  readonly report: DroneReport;
  readonly receivedMs: number;
  /** When the drone began what it is doing (the server's ISO 8601 time); empty when it was before
   * anything was heard of it. */
  readonly activitySince: string;
}

export interface LogLine {
  /** Counts lines from 0; never reused. */
  readonly id: number;
  readonly at: string;
  readonly level: Note["level"];
  readonly text: string;
  readonly droneId: string | null;
}

/** Everything known about the capture at hand. */
export interface Findings {
  readonly pictures: readonly PictureReport[];
  readonly planning: PlanProgress | null;
  /** The newest annealing from its first report on, as far as this browser saw it. */
  readonly annealing: readonly PlanProgress[];
  readonly plan: PlanReport | null;
  readonly seed: SeedReport | null;
  readonly coverage: CoverageReport | null;
  readonly poses: PosesReport | null;
  readonly training: TrainingReport | null;
  readonly quality: QualitySeries;
  readonly preview: PreviewReport | null;
  readonly metrics: MetricsReport | null;
}

/** The capture at hand: how far it is and what it has found. */
export interface Mission {
  readonly capture: CaptureReport | null;
  /** The furthest step reached, with the time each was entered (ISO 8601). */
  readonly step: Step | null;
  readonly stepEntered: Readonly<Partial<Record<Step, string>>>;
  readonly findings: Findings;
}

/** What arrives after the socket opened, and how the page stood when the last socket was lost. */
interface Arrival {
  readonly mission: Mission;
  readonly sinceMs: number;
  /** Null on the page's first socket: there was nothing to miss. */
  readonly before: { readonly lostMs: number; readonly lines: number } | null;
}

export interface ConsoleState extends Mission {
  readonly connection: Connection;
  /** Times the socket opened; whatever depends on the server's life starts anew with it. */
  readonly epoch: number;
  readonly lastMessageMs: number | null;
  /** By drone id, in the server's order. */
  readonly drones: ReadonlyMap<string, DroneState>;
  readonly history: History;
  /** Which viewpoints the scene shows, in every browser. */
  readonly planView: PlanView["shown"];
  /**
   * The mission as the server repeats it after the socket opened, until all of it is here; null at
   * all other times. It is kept aside because its parts come in no order that tells them from
   * those of an earlier capture.
   */
  readonly arriving: Arrival | null;
  /** The failsafe table of the server at hand; null until it is known. */
  readonly failsafeTable: readonly FailsafeRow[] | null;
  /** The newest failsafes that began to fire, oldest first. */
  readonly failsafes: readonly FailsafeReport[];
  /** By drone id: where the operator pointed the object out, as long as that stands. */
  readonly picks: ReadonlyMap<string, PickReport>;
  /** Drones that see something else than the others, null while all agree. */
  readonly disagreement: DisagreementReport | null;
  /** The parts of the object that shall have better pictures. */
  readonly priorities: readonly PriorityPart[];
  /** The volumes that no drone may enter. */
  readonly noGo: readonly NoGoVolume[];
  /** Which browser is in command, and which one asks for it, by their ids; null for nobody. */
  readonly command: { readonly holder: string | null; readonly asking: string | null };
  /** True once somebody flew from this tab, until they take leave: their silence is a failsafe. */
  readonly inCommand: boolean;
  /** What the operator asked for and did not get; each stands until it is dismissed. */
  readonly alarms: readonly LogLine[];
  readonly log: readonly LogLine[];
  readonly nextLogId: number;
}

/** What happens inside the browser, beside what the server says. */
export type LocalMessage =
  | { readonly type: "stream_opened" }
  | { readonly type: "stream_lost"; readonly retryInMs: number }
  | { readonly type: "signed_out" }
  | { readonly type: "failsafes_known"; readonly rows: readonly FailsafeRow[] }
  /** What the drones reported before this page listened. */
  | { readonly type: "history_known"; readonly reports: readonly DroneReport[] }
  | { readonly type: "command_taken" }
  | { readonly type: "command_released" }
  /** The server accepted a hold, for one drone or (null) for all. */
  | { readonly type: "hold_accepted"; readonly droneId: string | null }
  | {
      readonly type: "alarm_raised";
      readonly at: string;
      readonly text: string;
    }
  | { readonly type: "alarm_dismissed"; readonly id: number }
  | {
      readonly type: "logged";
      readonly at: string;
      readonly level: Note["level"];
      readonly text: string;
      readonly droneId: string | null;
    };

export type Message = ServerMessage | LocalMessage;

export const NO_FINDINGS: Findings = {
  pictures: [],
  planning: null,
  annealing: [],
  plan: null,
  seed: null,
  coverage: null,
  poses: null,
  training: null,
  quality: EMPTY_SERIES,
  preview: null,
  metrics: null,
};

export const NO_MISSION: Mission = {
  capture: null,
  step: null,
  stepEntered: {},
  findings: NO_FINDINGS,
};

export const INITIAL_STATE: ConsoleState = {
  connection: { kind: "connecting" },
  epoch: 0,
  lastMessageMs: null,
  drones: new Map(),
  history: [],
  planView: "planned",
  ...NO_MISSION,
  arriving: null,
  failsafeTable: null,
  failsafes: [],
  picks: new Map(),
  disagreement: null,
  priorities: [],
  noGo: [],
  command: { holder: null, asking: null },
  inCommand: false,
  alarms: [],
  log: [],
  nextLogId: 0,
};

/** Phases of an active capture after which nothing flies any more. */
const AFTER_FLIGHT: ReadonlySet<string> = new Set(["train", "done", "ended"]);

/** True while a capture has drones in the air or will send them there by itself. */
export function fliesByItself(capture: CaptureReport | null): boolean {
  return (
    capture !== null &&
    isActive(capture) &&
    !isGrounded(capture) &&
    !AFTER_FLIGHT.has(capture.phase)
  );
}

/** Phases in which drones hover when asked to; the server refuses to pause in any other. */
const PAUSABLE: ReadonlySet<string> = new Set(["centre", "seed", "plan", "fly", "tune", "capture"]);

/** True while a capture can be paused. */
export function canPause(capture: CaptureReport): boolean {
  return capture.state === "running" && PAUSABLE.has(capture.phase);
}

/** True while the field is trained after the flight. */
export function isTraining(capture: CaptureReport): boolean {
  return isActive(capture) && capture.phase === "train";
}

/** How captures end whose training the console can go on with. */
const CUT_OFF: ReadonlySet<CaptureReport["state"]> = new Set(["interrupted", "aborted", "failed"]);

/** True when a capture's training was cut off, or never begun, and has pictures to go on with. */
export function canGoOn({ state, images }: Pick<CaptureReport, "state" | "images">): boolean {
  return CUT_OFF.has(state) && images > 0;
}

/** True while a capture waits on the ground for batteries and the operator. */
export function isGrounded(capture: CaptureReport): boolean {
  return capture.phase === "grounded" && capture.state === "paused";
}

/** True while a capture flies, trains or waits. */
export function isActive(capture: CaptureReport): boolean {
  return isActiveState(capture.state);
}

export function isActiveState(state: CaptureReport["state"]): boolean {
  return state === "queued" || state === "running" || state === "paused";
}
