// Generated from the server's routes by `make openapi`. Do not edit.
// Units are SI, times are seconds, moments are ISO 8601 UTC.

/** One report of the annealing: moves so far, temperature, best fitness. */
export interface AnnealingStep {
  readonly iteration: number;
  readonly temperature: number | null;
  readonly fitness: number | null;
}

/** A file of a run. */
export interface Artifact {
  readonly capture_id: string;
  readonly path: string;
  readonly size_bytes: number;
  readonly modified_at: string;
  readonly url: string;
}

/** A camera as its views have it: pixels of ``width`` x ``height``, OpenCV's distortion. ``fx_sd`` is the standard deviation of ``fx``; ``mean_px`` and ``rms_px`` are the reprojection error; ``coverage`` is the share of the picture that kept views reach, ``tilts_deg`` how far they are tilted at most, sideways and up or down; ``terms_fixed`` are distortion terms that could not be told from zero. ``toml`` is the same as a piece of a fleet file. */
export interface CalibratedCamera {
  readonly width: number;
  readonly height: number;
  readonly fx: number;
  readonly fy: number;
  readonly cx: number;
  readonly cy: number;
  readonly fx_sd: number;
  readonly distortion: readonly number[];
  readonly terms_fixed: readonly string[];
  readonly mean_px: number;
  readonly rms_px: number;
  readonly views_kept: number;
  readonly views_dropped: number;
  readonly coverage: number;
  readonly tilts_deg: readonly [number, number];
  readonly toml: string;
}

/** A result that the console uses since; ``file`` has it too, or ``problem`` says why not. ``backup`` is the file as it was before; all three are null or empty without a fleet file. */
export interface CalibrationUse {
  readonly file: string | null;
  readonly backup: string | null;
  readonly problem: string;
}

/** The newest calibration of a camera. ``coverage`` counts, row by row, the corners of kept views in each cell of the picture. ``tilted`` says how many views are tilted sideways and how many up or down, of ``tilted_wanted`` each. ``hint`` is what to do next, null while no picture comes. ``lack`` is what views of a refused one lack, ``ending`` why one ended without a result, ``reason`` either for people. ``file`` is the fleet file that a result would be written into. */
export interface CalibrationView {
  readonly drone_id: string;
  readonly state: "idle" | "collecting" | "solving" | "solved" | "refused" | "ended";
  readonly board: string;
  readonly views: number;
  readonly views_wanted: number;
  readonly views_least: number;
  readonly coverage: readonly (readonly number[])[];
  readonly tilted: readonly [number, number];
  readonly tilted_wanted: number;
  readonly hint: "show_board" | "hold_still" | "blurred" | "left" | "right" | "top" | "bottom" | "tilt_sideways" | "tilt_up_down" | "nearer" | "another" | null;
  readonly spent_s: number;
  readonly lack: "few_views" | "one_sided" | "coverage" | "flat" | "disagree" | "contradict" | "uncertain" | "undetermined" | "sizes" | null;
  readonly ending: "cancelled" | "capture" | "flight" | "offline" | "closed" | "failed" | null;
  readonly reason: string;
  readonly result: CalibratedCamera | null;
  readonly applied: CalibrationUse | null;
  readonly file: string | null;
}

/** How to begin; with ``go_on`` the views of the calibration before count, too. */
export interface CalibrationWish {
  readonly go_on?: boolean;
}

/** What to capture; every field may be left out. ``overrides`` names checklist items that shall not keep the capture on the ground, by key (``drone-2.level``) or for all drones by item (``level``), each with the reason why. */
export interface CaptureSpec {
  readonly mode?: "optimized" | "standard";
  readonly drones?: number | null;
  readonly pictures?: number;
  readonly train_seconds?: number;
  readonly name?: string;
  readonly seed?: number;
  readonly overrides?: Readonly<Record<string, string>>;
}

/** A capture as it stands. */
export interface CaptureView {
  readonly id: string;
  readonly state: "queued" | "running" | "paused" | "succeeded" | "failed" | "aborted" | "interrupted";
  readonly phase: string;
  readonly progress: number;
  readonly eta_s: number | null;
  readonly run: string;
  readonly error: string | null;
  readonly mode: string;
  readonly name: string;
  readonly round_index: number;
  readonly rounds: number;
  readonly images: number;
  readonly images_total: number;
  readonly overrides: Readonly<Record<string, string>>;
  readonly started_at: string;
  readonly updated_at: string;
  readonly metrics: Readonly<Record<string, unknown>> | null;
  readonly starred: boolean;
}

/** One item of the checklist. ``key`` is the name an override has to use; ``drone_id`` is null for the console itself; a ``final`` item cannot be overridden. */
export interface CheckView {
  readonly key: string;
  readonly item: string;
  readonly drone_id: string | null;
  readonly passed: boolean;
  readonly found: string;
  readonly remedy: string;
  readonly final: boolean;
}

/** The command was handed to the drone, or to all when ``drone_id`` is null. */
export interface CommandAccepted {
  readonly command: "takeoff" | "land" | "hold" | "rearm" | "cut_motors";
  readonly drone_id: string | null;
}

/** What one drone shall do. */
export interface CommandRequest {
  readonly command: "takeoff" | "land" | "hold" | "rearm" | "cut_motors";
}

/** Shares of the object's surface that at least one and at least three pictures show. */
export interface CoverageView {
  readonly once: number;
  readonly thrice: number;
}

/** What there is to see of one drone. ``film`` is the address of its video, which begins at ``begins_s``; ``way`` its believed camera poses ``[at_s, x, y, z, heading]``, world metres and radians. */
export interface DroneReplay {
  readonly drone_id: string;
  readonly film: string | null;
  readonly begins_s: number;
  readonly way: readonly (readonly [number, number, number, number, number])[];
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

/** Part of the event log; ask again with ``since`` = ``next``. */
export interface EventLog {
  readonly events: readonly LogLine[];
  readonly next: number;
}

/** One row of the failsafe table: what happens when a measured value reaches its threshold. ``at_least`` rows fire at or above the threshold, ``at_most`` rows at or below it. */
export interface FailsafeView {
  readonly event: string;
  readonly threshold: number;
  readonly direction: "at_least" | "at_most";
  readonly unit: string;
  readonly action: string;
  readonly description: string;
}

/** Where to see the field from while it is trained. ``azimuth_rad`` is counter-clockwise from the world's +X about the object's middle, ``elevation_rad`` above it, ``distance`` a share of the pictures' median distance. */
export interface FieldViewWish {
  readonly azimuth_rad: number;
  readonly elevation_rad: number;
  readonly distance?: number;
}

/** Where everything is before a flight; the object stands in the middle. */
export interface FloorPlanView {
  readonly start_radius_m: number;
  readonly fence_radius_m: number;
  readonly ceiling_m: number;
  readonly places: readonly StartPlaceView[];
}

/** A job as it stands. ``progress`` is the share of ``phase`` done, 0 to 1; ``run`` is the folder of the run that it works for, ``capture`` the one whose pictures it trains on; ``result`` is what it ended with. */
export interface JobView {
  readonly id: string;
  readonly kind: "plan" | "reconstruct" | "render" | "export";
  readonly state: "queued" | "running" | "succeeded" | "failed" | "cancelled";
  readonly phase: string;
  readonly progress: number;
  readonly run: string;
  readonly capture: string | null;
  readonly error: string | null;
  readonly created_at: string;
  readonly updated_at: string;
  readonly result: Readonly<Record<string, unknown>> | null;
}

/** How long something really is, and where its two ends are, each in two pictures or more. */
export interface KnownLength {
  readonly length_m: number;
  readonly length_sigma_m?: number;
  readonly ends: readonly [readonly MarkedEnd[], readonly MarkedEnd[]];
}

/** A line of the event log with its place in it. */
export interface LogLine {
  readonly type: "noted";
  readonly at: string;
  readonly level: "info" | "warning" | "error";
  readonly text: string;
  readonly drone_id: string | null;
  readonly sequence: number;
}

/** One end of the known length in one picture: picture by number, x and y in its pixels. */
export interface MarkedEnd {
  readonly picture: number;
  readonly x: number;
  readonly y: number;
}

/** How many pictures more a capture under way shall take. */
export interface MorePictures {
  readonly count: number;
}

/** A token just made: the only time that ``token`` itself is told. */
export interface NewToken {
  readonly id: string;
  readonly name: string;
  readonly role: "viewer" | "operator" | "admin";
  readonly made_at: string;
  readonly token: string;
}

/** A column of the room that no drone may enter, from the floor to the ceiling. ``area`` is its rectangle, x, y of two opposite corners in world metres. */
export interface NoGoSpec {
  readonly area: readonly [number, number, number, number];
}

/** A column of the room that no drone may enter, from the floor to the ceiling. ``area`` is its rectangle: lower x, lower y, upper x, upper y, world metres. One that is ``configured`` is of the settings and is changed there. */
export interface NoGoVolume {
  readonly id: string;
  readonly area: readonly number[];
  readonly configured: boolean;
}

/** The box that the drone's search starts from, in shares 0 to 1 of the picture. */
export interface PickedObject {
  readonly drone_id: string;
  readonly box: readonly [number, number, number, number];
}

/** A placement and who flies where; ``bound`` is the most any choice could reach. ``annealing`` is how it was found, empty for the ring. ``ring`` is the standard ring around the same object, to compare with; empty where it is what was chosen, or where it does not fit. ``expected`` is what all pictures will show when those planned are taken, ``ring_expected`` what the ring would show. */
export interface PlanView {
  readonly capture_id: string | null;
  readonly at: string;
  readonly fitness: number | null;
  readonly terms: Readonly<Record<string, number | null>>;
  readonly candidates: number;
  readonly bound: number | null;
  readonly viewpoints: readonly PlannedViewpoint[];
  readonly annealing: readonly AnnealingStep[];
  readonly ring: readonly PlannedViewpoint[];
  readonly expected: CoverageView | null;
  readonly ring_expected: CoverageView | null;
}

/** Which viewpoints the 3D scene shows: those planned, the standard ring, or both. */
export interface PlanViewChoice {
  readonly shown: "planned" | "ring" | "both";
}

/** Where a drone takes a picture: world metres and radians. */
export interface PlannedViewpoint {
  readonly round_index: number;
  readonly drone_id: string;
  readonly position_world: readonly [number, number, number];
  readonly yaw_rad: number;
}

/** Where the object is: a box around it, two opposite corners x, y, x, y. In shares 0 to 1 of the picture, from its top left corner. */
export interface PointedBox {
  readonly box: readonly [number, number, number, number];
}

/** Where the object is: a point x, y on it, in shares 0 to 1 from the top left corner. */
export interface PointedPoint {
  readonly point: readonly [number, number];
}

/** A part of the object that shall have better pictures. ``drawn`` is the box drawn in that drone's picture, in shares 0 to 1; ``centre`` and ``size`` are where the part is, world metres, null until the object's geometry is known. */
export interface PriorityPart {
  readonly id: string;
  readonly drone_id: string;
  readonly drawn: readonly number[];
  readonly weight: number;
  readonly centre: readonly number[] | null;
  readonly size: readonly number[] | null;
}

/** A part of the object to have better pictures of: a box drawn in a drone's newest picture. ``weight`` says how many times as much as elsewhere a patch of surface there counts. */
export interface PrioritySpec {
  readonly drone_id: string;
  readonly box: readonly [number, number, number, number];
  readonly weight?: number;
}

/** Something that happened: a log line, or a ``picture`` with its number as ``text``. */
export interface ReplayMoment {
  readonly at_s: number;
  readonly kind: "picture" | "info" | "warning" | "error";
  readonly drone_id: string;
  readonly text: string;
}

/** How much of a recording has been read, 0 to 1; null while nobody reads it. */
export interface ReplayProgress {
  readonly share: number | null;
}

/** A recording; times ``at_s`` are seconds since its first picture. */
export interface ReplayView {
  readonly seconds: number;
  readonly drones: readonly DroneReplay[];
  readonly moments: readonly ReplayMoment[];
  readonly object_box: readonly [readonly [number, number, number], readonly [number, number, number]] | null;
}

/** What was done: all lengths times ``factor``, known to ``sigma``; it seemed ``measured_m``. */
export interface ScaleView {
  readonly factor: number;
  readonly sigma: number;
  readonly measured_m: number;
}

/** One setting as it stands. ``variable`` is the environment variable that sets it; ``default`` its value without one. ``least``, or ``more_than`` where the bound itself is not allowed, and ``most`` are the bounds while all other settings stay as they are, null where there is none or the setting is no number. */
export interface SettingView {
  readonly group: string;
  readonly name: string;
  readonly value: unknown;
  readonly default: unknown;
  readonly meaning: string;
  readonly variable: string;
  readonly least: number | null;
  readonly more_than: number | null;
  readonly most: number | null;
}

/** Where a drone is set down: metres from the middle of the start circle, and its heading. ``focal_px`` and ``tilt_deg`` are its camera's; not ``calibrated`` means a usual Tello's. */
export interface StartPlaceView {
  readonly drone_id: string;
  readonly name: string;
  readonly colour: string;
  readonly address: string;
  readonly serial: string;
  readonly x_m: number;
  readonly y_m: number;
  readonly yaw_rad: number;
  readonly focal_px: number;
  readonly tilt_deg: number;
  readonly calibrated: boolean;
}

/** Whom to make a token for. */
export interface TokenSpec {
  readonly name: string;
  readonly role: "viewer" | "operator" | "admin";
}

/** A token as it is listed; ``made_at`` of the console's own is empty. */
export interface TokenView {
  readonly id: string;
  readonly name: string;
  readonly role: "viewer" | "operator" | "admin";
  readonly made_at: string;
}

/** A training anew, on the pictures and poses of a capture that is over. Its results go into a run folder of their own, beside the capture's. */
export interface TrainingSpec {
  readonly capture: string;
  readonly seconds?: number;
  readonly object_only?: boolean;
  readonly seed?: number;
}

/** A field trained anew, as it stands. ``id`` is its run's, by which ``artifacts`` has its files; ``files`` are the first of them. ``seconds`` and ``seed`` are what was asked for, null where the run does not tell, ``metrics`` what the judgement found. ``job`` can be cancelled; it is null once it is over, and for a training that this console did not start. ``progress`` is the share of ``phase`` done, 0 to 1, as of ``updated_at``; ``ahead`` is how many trainings come before one that waits. */
export interface TrainingView {
  readonly id: string;
  readonly capture: string;
  readonly state: "queued" | "running" | "succeeded" | "failed" | "cancelled" | "interrupted";
  readonly phase: string;
  readonly progress: number;
  readonly error: string | null;
  readonly job: string | null;
  readonly ahead: number;
  readonly created_at: string;
  readonly updated_at: string;
  readonly seconds: number | null;
  readonly seed: number | null;
  readonly object_only: boolean;
  readonly metrics: Readonly<Record<string, unknown>> | null;
  readonly size_bytes: number;
  readonly files: readonly Artifact[];
}

/** Whose token or session was shown, and what it allows. */
export interface Visitor {
  readonly id: string;
  readonly name: string;
  readonly role: "viewer" | "operator" | "admin";
}

/** What each route is asked with, and what it answers; paths are below `/api/v1`. */
export interface Routes {
  /** Let all drones hover; they refuse motion until re-armed. */
  readonly "POST /fleet/hold": { readonly query: undefined; readonly body: undefined; readonly answer: CommandAccepted };
  /** Land all drones where they are. */
  readonly "POST /fleet/land": { readonly query: undefined; readonly body: undefined; readonly answer: CommandAccepted };
  /** Stop all motors at once; the drones fall. */
  readonly "POST /fleet/cut-motors": { readonly query: undefined; readonly body: undefined; readonly answer: CommandAccepted };
  /** Command one drone. */
  readonly "POST /drones/{drone_id}/commands": { readonly query: undefined; readonly body: CommandRequest; readonly answer: CommandAccepted };
  /** Return the newest report of every drone, in fleet order. */
  readonly "GET /drones": { readonly query: undefined; readonly body: undefined; readonly answer: readonly DroneReport[] };
  /** Return what the drones reported over the last quarter of an hour, every five seconds. */
  readonly "GET /drones/history": { readonly query: undefined; readonly body: undefined; readonly answer: readonly DroneReport[] };
  /** Return the newest calibration of a drone's camera, ``idle`` before the first. */
  readonly "GET /drones/{drone_id}/calibration": { readonly query: undefined; readonly body: undefined; readonly answer: CalibrationView };
  /** Begin to collect views of the board from a drone that stands, or is held by hand. */
  readonly "POST /drones/{drone_id}/calibration": { readonly query: undefined; readonly body: CalibrationWish | null; readonly answer: CalibrationView };
  /** End it without a result; of one that is over, forget the result. */
  readonly "DELETE /drones/{drone_id}/calibration": { readonly query: undefined; readonly body: undefined; readonly answer: CalibrationView };
  /** Collect no more views and work the camera out. */
  readonly "POST /drones/{drone_id}/calibration/finish": { readonly query: undefined; readonly body: undefined; readonly answer: CalibrationView };
  /** Use the result from now on, and write it into the console's fleet file if it has one. */
  readonly "POST /drones/{drone_id}/calibration/apply": { readonly query: undefined; readonly body: undefined; readonly answer: CalibrationView };
  /** Return the preflight checklist as it stands now, drone by drone, the console last. */
  readonly "GET /preflight": { readonly query: undefined; readonly body: undefined; readonly answer: readonly CheckView[] };
  /** Return the failsafe table, row by row. */
  readonly "GET /failsafes": { readonly query: undefined; readonly body: undefined; readonly answer: readonly FailsafeView[] };
  /** Say where the object is in a drone's newest picture; its search goes on from there. */
  readonly "PUT /drones/{drone_id}/object": { readonly query: undefined; readonly body: PointedBox | PointedPoint; readonly answer: PickedObject };
  /** Let a drone search the object by itself again. */
  readonly "DELETE /drones/{drone_id}/object": { readonly query: undefined; readonly body: undefined; readonly answer: undefined };
  /** Return the parts of the object that shall have better pictures. */
  readonly "GET /plans/priorities": { readonly query: undefined; readonly body: undefined; readonly answer: readonly PriorityPart[] };
  /** Want better pictures of a part; plans that are made from now on obey. */
  readonly "POST /plans/priorities": { readonly query: undefined; readonly body: PrioritySpec; readonly answer: PriorityPart };
  /** Forget all parts of priority. */
  readonly "DELETE /plans/priorities": { readonly query: undefined; readonly body: undefined; readonly answer: undefined };
  /** Forget one part of priority. */
  readonly "DELETE /plans/priorities/{part_id}": { readonly query: undefined; readonly body: undefined; readonly answer: undefined };
  /** Return the volumes that no drone may enter. */
  readonly "GET /plans/no-go": { readonly query: undefined; readonly body: undefined; readonly answer: readonly NoGoVolume[] };
  /** Let no drone enter a column of the room: it binds flying drones from now on. */
  readonly "POST /plans/no-go": { readonly query: undefined; readonly body: NoGoSpec; readonly answer: NoGoVolume };
  /** Forget all volumes but those of the settings. */
  readonly "DELETE /plans/no-go": { readonly query: undefined; readonly body: undefined; readonly answer: undefined };
  /** Give a volume another place. */
  readonly "PUT /plans/no-go/{volume_id}": { readonly query: undefined; readonly body: NoGoSpec; readonly answer: NoGoVolume };
  /** Forget one volume. */
  readonly "DELETE /plans/no-go/{volume_id}": { readonly query: undefined; readonly body: undefined; readonly answer: undefined };
  /** Return the drones and where to set each of them down. */
  readonly "GET /fleet": { readonly query: undefined; readonly body: undefined; readonly answer: FloorPlanView };
  /** Return the settings that fly; they are set when the console starts. */
  readonly "GET /settings": { readonly query: undefined; readonly body: undefined; readonly answer: readonly SettingView[] };
  /** Begin a capture; one runs at a time. */
  readonly "POST /captures": { readonly query: undefined; readonly body: CaptureSpec | null; readonly answer: CaptureView };
  /** Return the known captures, newest first. */
  readonly "GET /captures": { readonly query: { readonly state?: "queued" | "running" | "paused" | "succeeded" | "failed" | "aborted" | "interrupted" | null; readonly limit?: number; readonly cursor?: string | null }; readonly body: undefined; readonly answer: readonly CaptureView[] };
  /** Return one capture. */
  readonly "GET /captures/{capture_id}": { readonly query: undefined; readonly body: undefined; readonly answer: CaptureView };
  /** Delete a capture that is over, its files and the fields trained anew on it, for good. */
  readonly "DELETE /captures/{capture_id}": { readonly query: undefined; readonly body: undefined; readonly answer: undefined };
  /** Keep it: retention deletes no capture with a star. */
  readonly "PUT /captures/{capture_id}/star": { readonly query: undefined; readonly body: undefined; readonly answer: undefined };
  /** Let retention have it again. */
  readonly "DELETE /captures/{capture_id}/star": { readonly query: undefined; readonly body: undefined; readonly answer: undefined };
  /** Return how well held-out pictures were reproduced, once that was measured. */
  readonly "GET /captures/{capture_id}/metrics": { readonly query: undefined; readonly body: undefined; readonly answer: Readonly<Record<string, unknown>> };
  /** Hold position and stop the mission's clock. */
  readonly "POST /captures/{capture_id}/pause": { readonly query: undefined; readonly body: undefined; readonly answer: CaptureView };
  /** Go on with a paused capture. */
  readonly "POST /captures/{capture_id}/resume": { readonly query: undefined; readonly body: undefined; readonly answer: CaptureView };
  /** Take more pictures than was asked for, from where they add most to those taken. */
  readonly "POST /captures/{capture_id}/pictures": { readonly query: undefined; readonly body: MorePictures; readonly answer: CaptureView };
  /** See the field from here while it is trained; all who watch see the same. */
  readonly "PUT /captures/{capture_id}/view": { readonly query: undefined; readonly body: FieldViewWish; readonly answer: undefined };
  /** Let the view go round the object again. */
  readonly "DELETE /captures/{capture_id}/view": { readonly query: undefined; readonly body: undefined; readonly answer: undefined };
  /** Land all drones and end; what was taken stays. */
  readonly "POST /captures/{capture_id}/abort": { readonly query: undefined; readonly body: undefined; readonly answer: CaptureView };
  /** Return kept lines of the event log after number ``since``, oldest first. */
  readonly "GET /events": { readonly query: { readonly since?: number; readonly limit?: number }; readonly body: undefined; readonly answer: EventLog };
  /** Return the newest capture's newest plan; empty before there is one. */
  readonly "GET /plans": { readonly query: undefined; readonly body: undefined; readonly answer: readonly PlanView[] };
  /** Choose which viewpoints the 3D scene shows; it is one scene for all who look. */
  readonly "PUT /plans/view": { readonly query: undefined; readonly body: PlanViewChoice; readonly answer: undefined };
  /** Return the captures whose field was judged, newest first. */
  readonly "GET /reconstructions": { readonly query: { readonly limit?: number; readonly cursor?: string | null }; readonly body: undefined; readonly answer: readonly CaptureView[] };
  /** Train anew on a capture; trainings wait for each other, and never run beside a flight. */
  readonly "POST /reconstructions": { readonly query: undefined; readonly body: TrainingSpec; readonly answer: JobView };
  /** Return the files of one capture, or of all, newest capture first. */
  readonly "GET /artifacts": { readonly query: { readonly capture?: string | null; readonly limit?: number; readonly cursor?: string | null }; readonly body: undefined; readonly answer: readonly Artifact[] };
  /** Return what a capture's recording shows; the first time its films are made for it. */
  readonly "GET /captures/{capture_id}/replay": { readonly query: undefined; readonly body: undefined; readonly answer: ReplayView };
  /** Return how far the films are that somebody waits for. */
  readonly "GET /captures/{capture_id}/replay/progress": { readonly query: undefined; readonly body: undefined; readonly answer: ReplayProgress };
  /** Return the fields trained anew on a capture's pictures, newest first. */
  readonly "GET /captures/{capture_id}/trainings": { readonly query: { readonly limit?: number; readonly cursor?: string | null }; readonly body: undefined; readonly answer: readonly TrainingView[] };
  /** Delete a field trained anew, and all its files, for good; the capture stays. */
  readonly "DELETE /captures/{capture_id}/trainings/{training_id}": { readonly query: undefined; readonly body: undefined; readonly answer: undefined };
  /** Return the jobs since the console's start, newest first. */
  readonly "GET /jobs": { readonly query: { readonly state?: "queued" | "running" | "succeeded" | "failed" | "cancelled" | null; readonly limit?: number; readonly cursor?: string | null }; readonly body: undefined; readonly answer: readonly JobView[] };
  /** Return one job. */
  readonly "GET /jobs/{job_id}": { readonly query: undefined; readonly body: undefined; readonly answer: JobView };
  /** End a job; one that is over stays as it is. */
  readonly "POST /jobs/{job_id}/cancel": { readonly query: undefined; readonly body: undefined; readonly answer: JobView };
  /** Make everything that a finished capture left as large as the known length says. */
  readonly "POST /captures/{capture_id}/scale": { readonly query: undefined; readonly body: KnownLength; readonly answer: ScaleView };
  /** Return whose token or session this request shows. */
  readonly "GET /me": { readonly query: undefined; readonly body: undefined; readonly answer: Visitor };
  /** Return all tokens, the console's own first. */
  readonly "GET /tokens": { readonly query: undefined; readonly body: undefined; readonly answer: readonly TokenView[] };
  /** Make a token; only its digest is kept, so write it down. */
  readonly "POST /tokens": { readonly query: undefined; readonly body: TokenSpec; readonly answer: NewToken };
  /** Take a token back; the sessions that it opened end at once. */
  readonly "DELETE /tokens/{token_id}": { readonly query: undefined; readonly body: undefined; readonly answer: undefined };
}
