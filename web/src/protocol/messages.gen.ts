// Generated from server/api/messages.py by `make messages`. Do not edit.
// Units are SI, times are seconds, `at` is ISO 8601 UTC.

/** A part of the object that shall have better pictures. ``drawn`` is the box drawn in that drone's picture, in shares 0 to 1; ``centre`` and ``size`` are where the part is, world metres, null until the object's geometry is known. */
export interface PriorityPart {
  readonly id: string;
  readonly drone_id: string;
  readonly drawn: readonly number[];
  readonly weight: number;
  readonly centre: readonly number[] | null;
  readonly size: readonly number[] | null;
}

/** A column of the room that no drone may enter, from the floor to the ceiling. ``area`` is its rectangle: lower x, lower y, upper x, upper y, world metres. One that is ``configured`` is of the settings and is changed there. */
export interface NoGoVolume {
  readonly id: string;
  readonly area: readonly number[];
  readonly configured: boolean;
}

/** One drone as it stands, about five times a second. */
export interface DroneReport {
  readonly type: "drone_reported";
  readonly at: string;
  readonly drone_id: string;
  readonly name: string;
  readonly colour: string;
  readonly activity: string;
  readonly held: boolean;
  readonly battery_pct: number | null;
  readonly temperature_c: number | null;
  readonly height_m: number | null;
  readonly speed_m_s: number | null;
  readonly state_age_s: number | null;
  readonly video_age_s: number | null;
  readonly video_fps: number;
  readonly position_sigma_m: number | null;
  readonly video_wanted: boolean;
  readonly link_age_s: number | null;
  readonly object_age_s: number | null;
  readonly velocity_age_s: number | null;
}

/** The capture as it stands, whenever it changes. ``entered`` is by phase when it was entered for the first time, in that order. */
export interface CaptureReport {
  readonly type: "capture_changed";
  readonly at: string;
  readonly id: string;
  readonly state: "queued" | "running" | "paused" | "succeeded" | "failed" | "aborted" | "interrupted";
  readonly phase: string;
  readonly progress: number;
  readonly eta_s: number | null;
  readonly run: string;
  readonly error: string | null;
  readonly mode: string;
  readonly round_index: number;
  readonly rounds: number;
  readonly images: number;
  readonly images_total: number;
  readonly commanded: number;
  readonly entered: Readonly<Record<string, string>>;
}

/** A picture is on disk; the thumbnail is a data URL. ``sharpness`` is for comparison with other pictures of the capture alone. ``damaged_before`` counts the damaged pictures of the drone that were passed over for this one. */
export interface PictureReport {
  readonly type: "capture_taken";
  readonly at: string;
  readonly index: number;
  readonly round_index: number;
  readonly drone_id: string;
  readonly thumbnail: string;
  readonly sharpness: number | null;
  readonly damaged_before: number;
}

/** The annealing as it runs. */
export interface PlanProgress {
  readonly type: "plan_progressed";
  readonly at: string;
  readonly iteration: number;
  readonly iterations: number;
  readonly temperature: number;
  readonly fitness: number;
}

/** The placement that was chosen; ``bound`` is the most any choice could reach. */
export interface PlanReport {
  readonly type: "plan_found";
  readonly at: string;
  readonly fitness: number;
  readonly terms: Readonly<Record<string, number>>;
  readonly candidates: number;
  readonly viewpoints: number;
  readonly bound: number | null;
}

/** The object's crude geometry: sizes in metres. */
export interface SeedReport {
  readonly type: "seed_fitted";
  readonly at: string;
  readonly centre: readonly number[];
  readonly size: readonly number[];
  readonly boxes: number;
  readonly views: number;
}

/** Shares of the object's surface that at least one and at least three pictures show. */
export interface CoverageReport {
  readonly type: "surface_seen";
  readonly at: string;
  readonly share_once: number;
  readonly share_thrice: number;
}

/** The field's training as it runs. */
export interface TrainingReport {
  readonly type: "training_progressed";
  readonly at: string;
  readonly stage: string;
  readonly step: number;
  readonly seconds: number;
  readonly seconds_total: number | null;
  readonly loss: number | null;
  readonly psnr_db: number | null;
  readonly held_out_psnr_db: number | null;
  readonly held_out_ssim: number | null;
  readonly samples_per_s: number;
  readonly images: number;
}

/** How many pictures' poses were refined after the flight. ``unrefined`` are the indices of those that kept their pose from the flight. */
export interface PosesReport {
  readonly type: "poses_refined";
  readonly at: string;
  readonly images: number;
  readonly refined: number;
  readonly unrefined: readonly number[];
}

/** The newest rendering of the field, as a data URL, and where it was seen from. Azimuth and elevation are about the object's middle, the distance is a share of the pictures'. */
export interface PreviewReport {
  readonly type: "preview_rendered";
  readonly at: string;
  readonly image: string;
  readonly azimuth_rad: number;
  readonly elevation_rad: number;
  readonly distance: number;
}

/** The judgement on held-out pictures. */
export interface MetricsReport {
  readonly type: "metrics_measured";
  readonly at: string;
  readonly images: number;
  readonly images_held_out: number;
  readonly psnr_db: number;
  readonly ssim: number;
  readonly flip: number;
  readonly psnr_db_object: number | null;
}

/** A row of the failsafe table began to fire; ``value`` is null where it is not a number. */
export interface FailsafeReport {
  readonly type: "failsafe_fired";
  readonly at: string;
  readonly drone_id: string;
  readonly event: string;
  readonly threshold: number;
  readonly action: "hold" | "land" | "land_all" | "cut";
  readonly value: number | null;
  readonly text: string;
}

/** Where the operator pointed the object out in a drone's picture; null: not any more. The box is left, top, right, bottom in shares 0 to 1 of the picture. */
export interface PickReport {
  readonly type: "object_pointed_out";
  readonly at: string;
  readonly drone_id: string;
  readonly box: readonly number[] | null;
}

/** Drones that see something else than the others do; none: all agree again. */
export interface DisagreementReport {
  readonly type: "views_disagree";
  readonly at: string;
  readonly drone_ids: readonly string[];
  readonly reason: string;
}

/** All parts of priority as they stand now. */
export interface PrioritiesReport {
  readonly type: "priorities_changed";
  readonly at: string;
  readonly parts: readonly PriorityPart[];
}

/** All no-go volumes as they stand now. */
export interface NoGoReport {
  readonly type: "no_go_changed";
  readonly at: string;
  readonly volumes: readonly NoGoVolume[];
}

/** Which viewpoints the 3D scene shows, in every browser. */
export interface PlanView {
  readonly type: "plan_view_changed";
  readonly at: string;
  readonly shown: "planned" | "ring" | "both";
}

/** Which browser is in command and which one asks for it, by their ids; null for nobody. */
export interface CommandReport {
  readonly type: "command_changed";
  readonly at: string;
  readonly holder: string | null;
  readonly asking: string | null;
}

/** A line of the event log. */
export interface Note {
  readonly type: "noted";
  readonly at: string;
  readonly level: "info" | "warning" | "error";
  readonly text: string;
  readonly drone_id: string | null;
}

/** This client was too slow and lost ``events`` messages; later state messages are whole. */
export interface Missed {
  readonly type: "missed";
  readonly events: number;
}

export type ServerMessage =
  | DroneReport
  | CaptureReport
  | PictureReport
  | PlanProgress
  | PlanReport
  | SeedReport
  | CoverageReport
  | TrainingReport
  | PosesReport
  | PreviewReport
  | MetricsReport
  | FailsafeReport
  | PickReport
  | DisagreementReport
  | PrioritiesReport
  | NoGoReport
  | PlanView
  | CommandReport
  | Note
  | Missed;

/** Which drones' pictures to send; the others pause. Default: all, as JPEG. With ``h264`` a JPEG still comes where no coded picture can be decoded: before the first key picture, and after a gap. */
export interface ShowTiles {
  readonly type: "show_tiles";
  readonly drone_ids: readonly string[];
  readonly coding: "jpeg" | "h264";
}

/** Acknowledges one picture, and the coded ones before it. A drone's next JPEG is sent only then; of coded pictures a few may be under way. ``decoded`` is false when a coded one could not be: JPEGs then come until the next key picture. */
export interface TileShown {
  readonly type: "tile_shown";
  readonly drone_id: string;
  readonly sequence: number;
  readonly decoded: boolean;
}

/** The operator in command is there; sent every two seconds. Its absence is a failsafe. While another browser is in command it counts for nothing. */
export interface Heartbeat {
  readonly type: "heartbeat";
  readonly client: string;
}

/** The operator leaves and the flight goes on: silence counts no longer. */
export interface ReleaseCommand {
  readonly type: "release_command";
  readonly client: string;
}

/** This browser is in command from now on, whoever was before. */
export interface TakeCommand {
  readonly type: "take_command";
  readonly client: string;
}

/** This browser asks the one in command for it. */
export interface AskCommand {
  readonly type: "ask_command";
  readonly client: string;
}

/** The browser in command hands it over to the one that asks, or keeps it. */
export interface AnswerCommand {
  readonly type: "answer_command";
  readonly client: string;
  readonly grant: boolean;
}

/** How the sticks of a drone flown by hand are pushed, sent ten times a second. Counts only from the browser in command, for a drone that flies and while no capture does. Without the next one the drone hovers: a line that is cut is a hand taken away. */
export interface Steer {
  readonly type: "steer";
  readonly client: string;
  readonly drone_id: string;
  readonly forward: number;
  readonly left: number;
  readonly up: number;
  readonly turn: number;
}

export type ClientMessage =
  | ShowTiles
  | TileShown
  | Heartbeat
  | ReleaseCommand
  | TakeCommand
  | AskCommand
  | AnswerCommand
  | Steer;

/** The header of a binary message; ``age_s`` is the picture's age when it was sent. */
export interface TileHeader {
  readonly drone_id: string;
  readonly sequence: number;
  readonly age_s: number;
  readonly damaged: boolean;
}

/** What was seen in a picture, in pixels of one of ``size`` (width, height). ``box`` is left, top, right, bottom; each outline is x, y, x, y and so on. */
export interface TileMarks {
  readonly size: readonly number[];
  readonly box: readonly number[];
  readonly confidence: number;
  readonly touches_edge: boolean;
  readonly outlines: readonly (readonly number[])[];
  readonly yaw_error_rad: number;
}

/** The header of a picture as the drone sent it: H.264, access units in Annex B. Mostly one. Where the search left pictures out, those come before it: ``sizes`` are the bytes of each, ``key`` is that of the first, all else is of the last. ``note`` is what else there is to say of the picture, mostly nothing. */
export interface CodedTileHeader {
  readonly drone_id: string;
  readonly sequence: number;
  readonly age_s: number;
  readonly damaged: boolean;
  readonly coding: "h264";
  readonly key: boolean;
  readonly sizes: readonly number[];
  readonly marks: TileMarks | null;
  readonly note: string;
}
