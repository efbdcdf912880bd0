"""The wire schema of the websocket ``/api/v1/stream``: two tagged unions.

Text messages are JSON objects with a ``type``. A binary message is one annotated picture: four
bytes of header length (big endian), a JSON header (``TileHeader``), then the JPEG. Who asks for
``h264`` also gets pictures as the drone sent them, with what is to be drawn on them in the header
(``CodedTileHeader``): each can be decoded after the one before it, or is a key picture.
``make messages`` writes the TypeScript twin, ``web/src/protocol/messages.gen.ts``.

Units are SI, times are seconds, ``at`` is ISO 8601 UTC.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field


class _Message(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class DroneReport(_Message):
    """One drone as it stands, about five times a second."""

    type: Literal["drone_reported"] = "drone_reported"
    at: str
    drone_id: str
    name: str
    colour: str
    activity: str
    held: bool
    battery_pct: int | None
    temperature_c: float | None
    height_m: float | None
    speed_m_s: float | None
    state_age_s: float | None
    video_age_s: float | None
    video_fps: float
    position_sigma_m: float | None
    video_wanted: bool
    link_age_s: float | None
    object_age_s: float | None
    velocity_age_s: float | None


class CaptureReport(_Message):
    """The capture as it stands, whenever it changes.

    ``entered`` is by phase when it was entered for the first time, in that order.
    """

    type: Literal["capture_changed"] = "capture_changed"
    at: str
    id: str
    state: Literal["queued", "running", "paused", "succeeded", "failed", "aborted", "interrupted"]
    phase: str
    progress: float
    eta_s: float | None
    run: str
    error: str | None
    mode: str
    round_index: int
    rounds: int
    images: int
    images_total: int
    commanded: int
    entered: dict[str, str]


class PictureReport(_Message):
    """A picture is on disk; the thumbnail is a data URL.

    ``sharpness`` is for comparison with other pictures of the capture alone. ``damaged_before``
    counts the damaged pictures of the drone that were passed over for this one.
    """

    type: Literal["capture_taken"] = "capture_taken"
    at: str
    index: int
    round_index: int
    drone_id: str
    thumbnail: str
    sharpness: float | None
    damaged_before: int


class PlanProgress(_Message):
    """The annealing as it runs."""

    type: Literal["plan_progressed"] = "plan_progressed"
    at: str
    iteration: int
    iterations: int
    temperature: float
    fitness: float


class PlanReport(_Message):
    """The placement that was chosen; ``bound`` is the most any choice could reach."""

    type: Literal["plan_found"] = "plan_found"
    at: str
    fitness: float
    terms: dict[str, float]
    candidates: int
    viewpoints: int
    bound: float | None


class SeedReport(_Message):
    """The object's crude geometry: sizes in metres."""

    type: Literal["seed_fitted"] = "seed_fitted"
    at: str
    centre: list[float]
    size: list[float]
    boxes: int
    views: int


class CoverageReport(_Message):
    """Shares of the object's surface that at least one and at least three pictures show."""

    type: Literal["surface_seen"] = "surface_seen"
    at: str
    share_once: float
    share_thrice: float


class TrainingReport(_Message):
    """The field's training as it runs."""

    type: Literal["training_progressed"] = "training_progressed"
    at: str
    stage: str
    step: int
    seconds: float
    seconds_total: float | None
    loss: float | None
    psnr_db: float | None
    held_out_psnr_db: float | None
    held_out_ssim: float | None
    samples_per_s: float
    images: int


class PosesReport(_Message):
    """How many pictures' poses were refined after the flight.

    ``unrefined`` are the indices of those that kept their pose from the flight.
    """

    type: Literal["poses_refined"] = "poses_refined"
    at: str
    images: int
    refined: int
    unrefined: list[int]


class PreviewReport(_Message):
    """The newest rendering of the field, as a data URL, and where it was seen from.

    Azimuth and elevation are about the object's middle, the distance is a share of the pictures'.
    """

    type: Literal["preview_rendered"] = "preview_rendered"
    at: str
    image: str
    azimuth_rad: float
    elevation_rad: float
    distance: float


class MetricsReport(_Message):
    """The judgement on held-out pictures."""

    type: Literal["metrics_measured"] = "metrics_measured"
    at: str
    images: int
    images_held_out: int
    psnr_db: float
    ssim: float
    flip: float
    psnr_db_object: float | None


class FailsafeReport(_Message):
    """A row of the failsafe table began to fire; ``value`` is null where it is not a number."""

    type: Literal["failsafe_fired"] = "failsafe_fired"
    at: str
    drone_id: str
    event: str
    threshold: float
    action: Literal["hold", "land", "land_all", "cut"]
    value: float | None
    text: str


class PickReport(_Message):
    """Where the operator pointed the object out in a drone's picture; null: not any more.

    The box is left, top, right, bottom in shares 0 to 1 of the picture.
    """

    type: Literal["object_pointed_out"] = "object_pointed_out"
    at: str
    drone_id: str
    box: list[float] | None


class DisagreementReport(_Message):
    """Drones that see something else than the others do; none: all agree again."""

    type: Literal["views_disagree"] = "views_disagree"
    at: str
    drone_ids: list[str]
    reason: str


class PriorityPart(_Message):
    """A part of the object that shall have better pictures.

    ``drawn`` is the box drawn in that drone's picture, in shares 0 to 1; ``centre`` and ``size``
    are where the part is, world metres, null until the object's geometry is known.
    """

    id: str
    drone_id: str
    drawn: list[float]
    weight: float
    centre: list[float] | None
    size: list[float] | None


class PrioritiesReport(_Message):
    """All parts of priority as they stand now."""

    type: Literal["priorities_changed"] = "priorities_changed"
    at: str
    parts: list[PriorityPart]


class NoGoVolume(_Message):
    """A column of the room that no drone may enter, from the floor to the ceiling.

    ``area`` is its rectangle: lower x, lower y, upper x, upper y, world metres. One that is
    ``configured`` is of the settings and is changed there.
    """

    id: str
    area: list[float]
    configured: bool


class NoGoReport(_Message):
    """All no-go volumes as they stand now."""

    type: Literal["no_go_changed"] = "no_go_changed"
    at: str
    volumes: list[NoGoVolume]


class PlanView(_Message):
    """Which viewpoints the 3D scene shows, in every browser."""

    type: Literal["plan_view_changed"] = "plan_view_changed"
    at: str
    shown: Literal["planned", "ring", "both"]


class CommandReport(_Message):
    """Which browser is in command and which one asks for it, by their ids; null for nobody."""

    type: Literal["command_changed"] = "command_changed"
    at: str
    holder: str | None
    asking: str | None


class Note(_Message):
    """A line of the event log."""

    type: Literal["noted"] = "noted"
    at: str
    level: Literal["info", "warning", "error"]
    text: str
    drone_id: str | None


class Missed(_Message):
    """This client was too slow and lost ``events`` messages; later state messages are whole."""

    type: Literal["missed"] = "missed"
    events: int


ServerMessage = Annotated[
    DroneReport
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
    | Missed,
    Field(discriminator="type"),
]


class ShowTiles(_Message):
    """Which drones' pictures to send; the others pause. Default: all, as JPEG.

    With ``h264`` a JPEG still comes where no coded picture can be decoded: before the first key
    picture, and after a gap.
    """

    type: Literal["show_tiles"] = "show_tiles"
    drone_ids: list[str]
    coding: Literal["jpeg", "h264"] = "jpeg"


class TileShown(_Message):
    """Acknowledges one picture, and the coded ones before it.

    A drone's next JPEG is sent only then; of coded pictures a few may be under way. ``decoded`` is
    false when a coded one could not be: JPEGs then come until the next key picture.
    """

    type: Literal["tile_shown"] = "tile_shown"
    drone_id: str
    sequence: int
    decoded: bool = True


# A browser's id, of its own making. Programs that share the command with nobody name none.
Client = Annotated[str, Field(max_length=64)]


class Heartbeat(_Message):
    """The operator in command is there; sent every two seconds. Its absence is a failsafe.

    While another browser is in command it counts for nothing.
    """

    type: Literal["heartbeat"] = "heartbeat"
    client: Client = ""


class ReleaseCommand(_Message):
    """The operator leaves and the flight goes on: silence counts no longer."""

    type: Literal["release_command"] = "release_command"
    client: Client = ""


class TakeCommand(_Message):
    """This browser is in command from now on, whoever was before."""

    type: Literal["take_command"] = "take_command"
    client: Client


class AskCommand(_Message):
    """This browser asks the one in command for it."""

    type: Literal["ask_command"] = "ask_command"
    client: Client


class AnswerCommand(_Message):
    """The browser in command hands it over to the one that asks, or keeps it."""

    type: Literal["answer_command"] = "answer_command"
    client: Client
    grant: bool


Push = Annotated[float, Field(ge=-1.0, le=1.0, allow_inf_nan=False)]


class Steer(_Message):
    """How the sticks of a drone flown by hand are pushed, sent ten times a second.

    Counts only from the browser in command, for a drone that flies and while no capture does.
    Without the next one the drone hovers: a line that is cut is a hand taken away.
    """

    type: Literal["steer"] = "steer"
    client: Client
    drone_id: str
    forward: Push
    left: Push
    up: Push
    turn: Push


ClientMessage = Annotated[
    ShowTiles
    | TileShown
    | Heartbeat
    | ReleaseCommand
    | TakeCommand
    | AskCommand
    | AnswerCommand
    | Steer,
    Field(discriminator="type"),
]


class TileHeader(_Message):
    """The header of a binary message; ``age_s`` is the picture's age when it was sent."""

    drone_id: str
    sequence: int
    age_s: float
    damaged: bool


class TileMarks(_Message):
    """What was seen in a picture, in pixels of one of ``size`` (width, height).

    ``box`` is left, top, right, bottom; each outline is x, y, x, y and so on.
    """

    size: list[int]
    box: list[float]
    confidence: float
    touches_edge: bool
    outlines: list[list[int]]
    yaw_error_rad: float


class CodedTileHeader(TileHeader):
    """The header of a picture as the drone sent it: H.264, access units in Annex B.

    Mostly one. Where the search left pictures out, those come before it: ``sizes`` are the bytes of
    each, ``key`` is that of the first, all else is of the last. ``note`` is what else there is to
    say of the picture, mostly nothing.
    """

    coding: Literal["h264"] = "h264"
    key: bool
    sizes: list[int]
    marks: TileMarks | None
    note: str
