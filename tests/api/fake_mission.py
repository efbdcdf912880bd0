"""A mission without drones: it keeps what it was asked for and publishes what it is told to."""

from __future__ import annotations

import asyncio
import shutil
import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path

import cv2
import numpy as np
from fake_camera import FakeCamera

from server.geometry.boxes import Box3
from server.geometry.cameras import TELLO_INTRINSICS, TELLO_TILT_RAD
from server.geometry.poses import camera_pose
from server.mission.board_views import GatherConfig
from server.mission.calibrations import Calibrations
from server.mission.checklist import Check
from server.mission.commands import (
    Area,
    CaptureRecord,
    CaptureRequest,
    DatagramCounts,
    DroneCommand,
    FloorPlan,
    PointedPlace,
    RefusedError,
    StartPlace,
    Sticks,
    UnknownError,
)
from server.mission.config import MissionConfig
from server.mission.events import (
    CaptureChanged,
    CaptureTaken,
    Coverage,
    DroneReported,
    Event,
    EventStream,
    FailsafeFired,
    FieldView,
    FrameAnnotated,
    NoGoVolume,
    ObjectPointedOut,
    PlanFound,
    PriorityPart,
    SeedFitted,
    SurfaceSeen,
)
from server.stages import (
    Assignment,
    CameraPose,
    Capture,
    Placement,
    SeedGeometry,
    Telemetry,
    Viewpoint,
)
from server.store.runs import is_run
from server.store.trainings import trainings_on
from server.swarm.failsafes import Failsafe, FailsafeTable

DRONES = ("drone-1", "drone-2", "drone-3", "drone-4")


def jpeg(width: int = 640, height: int = 480, grey: int = 100) -> bytes:
    ok, data = cv2.imencode(".jpg", np.full((height, width, 3), grey, np.uint8))
    if not ok:
        raise RuntimeError("no JPEG")
    return data.tobytes()


# On the circle, looking in: x, y in metres and the heading in radians.
_PLACES = ((1.8, 0.0, 3.1416), (0.0, 1.8, -1.5708), (-1.8, 0.0, 0.0), (0.0, -1.8, 1.5708))
JPEG = jpeg()
THUMBNAIL = jpeg(160, 120)


COLOURS: dict[str, str] = dict(
    zip(DRONES, ("#5aa9ff", "#f5b041", "#46c98b", "#d78bf0"), strict=True)
)


def drone_report(
    drone_id: str = "drone-1",
    battery_pct: int | None = 80,
    activity: str = "flying",
    video_age_s: float = 0.03,
    video_wanted: bool = True,
) -> DroneReported:
    return DroneReported(
        drone_id=drone_id,
        name=drone_id.title(),
        colour=COLOURS.get(drone_id, "#1f77b4"),
        activity=activity,
        held=False,
        battery_pct=battery_pct,
        temperature_c=60.0,
        height_m=1.2,
        speed_m_s=0.1,
        state_age_s=0.05,
        video_age_s=video_age_s,
        video_fps=29.7,
        position_sigma_m=0.05,
        video_wanted=video_wanted,
        link_age_s=0.4,
    )


def frame(drone_id: str = "drone-1", sequence: int = 0, data: bytes = JPEG) -> FrameAnnotated:
    return FrameAnnotated(drone_id, sequence, time.monotonic(), data, damaged=False)


def failsafe_fired(
    drone_id: str = "drone-2",
    event: str = "video_age_s",
    action: str = "hold",
    value: float = 4.2,
    threshold: float = 4.0,
    text: str = "no picture for 4.2 s",
) -> FailsafeFired:
    return FailsafeFired(drone_id, event, threshold, action, value, text)


def checklist(*failed: Check) -> list[Check]:
    """Return the checklist of the fleet, all clear but for ``failed``."""
    found = {
        "link": "answers",
        "on_ground": "ground",
        "armed": "armed",
        "state": "report 0.1 s old",
        "battery": "84 %",
        "temperature": "61 degrees Celsius",
        "video": "30 pictures per second",
        "level": "leans 1 degrees",
    }
    checks = [Check(item, d, True, text) for d in DRONES for item, text in found.items()]
    checks.append(Check("disk", None, True, "41.3 GB free for pictures"))
    failing = {check.key: check for check in failed}
    # A drone that does not answer tells nothing else.
    silent = {check.drone_id for check in failed if check.item == "link"}
    return [
        failing.get(check.key, check)
        for check in checks
        if check.drone_id not in silent or check.item == "link"
    ]


def level_failed(drone_id: str = "drone-2") -> Check:
    remedy = "Set it down on a level place."
    return Check("level", drone_id, False, "leans 14 degrees", remedy)


def link_failed(drone_id: str = "drone-3") -> Check:
    remedy = f"Switch {drone_id.title()} on, wait for its light to blink yellow."
    return Check("link", drone_id, False, "does not answer at 192.168.10.1", remedy, final=True)


def capture_changed(
    capture_id: str = "run-1", state: str = "running", phase: str = "flying round 1"
) -> CaptureChanged:
    return CaptureChanged(
        id=capture_id,
        state=state,
        phase=phase,
        progress=0.25,
        eta_s=60.0,
        run=f"runs/{capture_id}",
        error=None,
        mode="optimized",
        round_index=0,
        rounds=6,
        images=4,
        images_total=24,
    )


def telemetry(drone_id: str) -> Telemetry:
    return Telemetry(
        drone_id=drone_id,
        received_s=0.0,
        yaw_rad=0.0,
        pitch_rad=0.0,
        roll_rad=0.0,
        velocity_m_s=np.zeros(3),
        acceleration_m_s2=np.array([0.0, 0.0, 9.81]),
        height_m=1.0,
        tof_m=1.0,
        baro_m=0.0,
        battery_pct=80,
        temperature_c=60.0,
        motor_time_s=10.0,
    )


def picture_taken(index: int = 0, drone_id: str = "drone-1") -> CaptureTaken:
    T_world_cam = camera_pose(np.array([2.0, 0.0, 1.0]), np.pi, TELLO_TILT_RAD)
    capture = Capture(
        index=index,
        round_index=index // 4,
        pose=CameraPose(drone_id, 0.0, T_world_cam, np.eye(4) * 1e-3),
        intrinsics=TELLO_INTRINSICS,
        telemetry=telemetry(drone_id),
        box=None,
        file=f"images/{index:03d}.jpg",
        captured_at=datetime.now(UTC),
    )
    return CaptureTaken(capture, THUMBNAIL)


def seed_fitted() -> SeedFitted:
    outer = Box3(np.array([-0.5, -0.4, 0.0]), np.array([0.5, 0.4, 1.6]))
    lower = Box3(outer.lower, np.array([0.5, 0.4, 0.8]))
    upper = Box3(np.array([-0.3, -0.3, 0.8]), np.array([0.3, 0.3, 1.6]))
    return SeedFitted(SeedGeometry(outer, (lower, upper), views=4))


def surface_seen() -> SurfaceSeen:
    points = np.array([[0.5, 0.0, 0.4], [-0.5, 0.0, 0.4], [0.0, 0.4, 1.2], [0.0, 0.0, 1.6]])
    return SurfaceSeen(points, np.array([0, 1, 3, 7]), 0.1, Coverage(0.75, 0.5))


def plan_found(rounds: int = 2) -> PlanFound:
    viewpoints = [
        Viewpoint(np.array([2.0 * np.cos(a), 2.0 * np.sin(a), 1.0]), float(a + np.pi))
        for a in np.linspace(0.0, 2.0 * np.pi, 4 * rounds, endpoint=False)
    ]
    assigned = tuple(
        {d: viewpoints[r * 4 + i] for i, d in enumerate(DRONES)} for r in range(rounds)
    )
    placement = Placement(
        tuple(viewpoints), 0.8, {"coverage": 0.9, "overlap": float("nan")}, 500, bound=0.85
    )
    return PlanFound(placement, Assignment(assigned), Coverage(0.96, 0.81))


@dataclass
class FakeMission:
    """Keeps every call; with ``hangs`` its coroutines return only once ``released``."""

    runs: Path
    events: EventStream = field(default_factory=EventStream)
    hangs: bool = False
    released: asyncio.Event = field(default_factory=asyncio.Event)
    calls: list[tuple[str, object]] = field(default_factory=list)
    records: dict[str, CaptureRecord] = field(default_factory=dict)
    frames: dict[str, FrameAnnotated] = field(default_factory=dict)
    kept: list[Event] = field(default_factory=list)
    reports: dict[str, DroneReported] = field(default_factory=dict)
    checks: list[Check] = field(default_factory=checklist)
    table: FailsafeTable = field(default_factory=FailsafeTable)
    operator: list[str] = field(default_factory=list)
    mission_config: MissionConfig = field(default_factory=MissionConfig)
    parts: dict[str, PriorityPart] = field(default_factory=dict)
    volumes: dict[str, NoGoVolume] = field(default_factory=dict)
    drawn: int = 0
    stops_told: list[tuple[str, str | None]] = field(default_factory=list)
    speechless: bool = False
    cameras: dict[str, FakeCamera] = field(
        default_factory=lambda: {drone_id: FakeCamera(drone_id) for drone_id in DRONES}
    )
    fleet_file: Path | None = None

    def __post_init__(self) -> None:
        self._calibrations: Calibrations | None = None

    @property
    def calibrations(self) -> Calibrations:
        # Made when first asked for: tests say before whether there is a fleet file.
        if self._calibrations is None:
            gathering = GatherConfig(views=12, patience_s=60.0)
            self._calibrations = Calibrations(
                self.cameras, self._capture_runs, self.events, self.fleet_file, gathering
            )
        return self._calibrations

    def _capture_runs(self) -> bool:
        return any(record.status.state == "running" for record in self.records.values())

    def drones(self) -> list[DroneReported]:
        return [self.reports.get(drone_id) or drone_report(drone_id) for drone_id in DRONES]

    def preflight(self) -> list[Check]:
        return list(self.checks)

    def failsafes(self) -> tuple[Failsafe, ...]:
        return self.table.rows()

    def point_out(self, drone_id: str, place: PointedPlace) -> ObjectPointedOut:
        self._needs_picture(drone_id)
        self.calls.append(("point_out", (drone_id, place)))
        x, y = place[:2]
        return ObjectPointedOut(drone_id, place if len(place) == 4 else (x, y, x + 0.1, y + 0.1))

    def search_object(self, drone_id: str) -> None:
        self._check(drone_id)
        self.calls.append(("search", drone_id))

    def priorities(self) -> list[PriorityPart]:
        return list(self.parts.values())

    def add_priority(
        self, drone_id: str, drawn: tuple[float, float, float, float], weight: float
    ) -> PriorityPart:
        self._needs_picture(drone_id)
        part = PriorityPart(f"part-{len(self.parts) + 1}", drone_id, drawn, weight)
        self.parts[part.id] = part
        return part

    def drop_priorities(self, part_id: str | None = None) -> None:
        if part_id is None:
            self.parts.clear()
        elif self.parts.pop(part_id, None) is None:
            raise UnknownError(f"there is no part of priority {part_id!r}")

    def no_go(self) -> list[NoGoVolume]:
        return list(self.volumes.values())

    async def add_no_go(self, area: Area) -> NoGoVolume:
        self.drawn += 1
        return self._volume(f"no-go-{self.drawn}", area)

    async def change_no_go(self, volume_id: str, area: Area) -> NoGoVolume:
        if volume_id not in self.volumes:
            raise UnknownError(f"there is no no-go volume {volume_id!r}")
        return self._volume(volume_id, area)

    async def drop_no_go(self, volume_id: str | None = None) -> None:
        if volume_id is None:
            self.volumes.clear()
        elif self.volumes.pop(volume_id, None) is None:
            raise UnknownError(f"there is no no-go volume {volume_id!r}")

    def _volume(self, volume_id: str, area: Area) -> NoGoVolume:
        x_0, y_0, x_1, y_1 = area
        if x_0 == x_1 or y_0 == y_1:
            raise RefusedError("a no-go volume needs sides of at least 0.05 m")
        lower = np.array([min(x_0, x_1), min(y_0, y_1), 0.0])
        upper = np.array([max(x_0, x_1), max(y_0, y_1), 3.0])
        self.volumes[volume_id] = NoGoVolume(volume_id, Box3(lower, upper))
        return self.volumes[volume_id]

    def disk_free_mb(self) -> float | None:
        return 2500.0

    def datagram_counts(self) -> dict[str, DatagramCounts]:
        return {"drone-1": DatagramCounts({"garbage": 3, "bad_state": 0}, 5, 2)}

    def note_stop(self, command: str, drone_id: str | None) -> None:
        if self.speechless:
            raise RuntimeError("nothing can be told")
        self.stops_told.append((command, drone_id))

    def note_operator(self) -> None:
        self.operator.append("here")

    def release_operator(self) -> None:
        self.operator.append("left")

    def newest_frame(self, drone_id: str) -> FrameAnnotated | None:
        self._check(drone_id)
        return self.frames.get(drone_id)

    def standing(self) -> list[Event]:
        return list(self.kept)

    async def command_drone(self, drone_id: str, command: DroneCommand) -> None:
        self.calls.append((command, drone_id))
        self._check(drone_id)
        await self._perhaps_hang()
        if command == "rearm":
            raise RefusedError(f"{drone_id} is not held")

    async def start_capture(self, request: CaptureRequest) -> CaptureRecord:
        self.calls.append(("start", request))
        await self._perhaps_hang()
        if request.drones is not None and request.drones > len(DRONES):
            raise ValueError(f"drones must be 1 to {len(DRONES)}, not {request.drones}")
        if self._capture_runs():
            raise RefusedError("a capture is running")
        return self.keep(capture_changed(f"run-{len(self.records) + 1}"), request)

    def captures(self) -> list[CaptureRecord]:
        return list(reversed(self.records.values()))

    def capture(self, capture_id: str) -> CaptureRecord:
        if capture_id not in self.records:
            raise UnknownError(f"there is no capture {capture_id!r}")
        return self.records[capture_id]

    async def pause_capture(self, capture_id: str) -> CaptureRecord:
        return await self._change(capture_id, "running", "paused")

    async def resume_capture(self, capture_id: str) -> CaptureRecord:
        return await self._change(capture_id, "paused", "running")

    def steer(self, drone_id: str, sticks: Sticks) -> None:
        self._check(drone_id)
        self.calls.append(("steer", (drone_id, sticks)))

    async def add_pictures(self, capture_id: str, count: int) -> CaptureRecord:
        record = self.capture(capture_id)
        if record.status.state != "running":
            raise RefusedError(f"it is {record.status.state}")
        wanted = record.status.images_total + count
        return self.keep(replace(record.status, images_total=wanted), record.request)

    async def view_field(self, capture_id: str, view: FieldView | None) -> None:
        if self.capture(capture_id).status.phase != "train":
            raise RefusedError("its field is not being trained")
        self.calls.append(("view", view))

    async def abort_capture(self, capture_id: str) -> CaptureRecord:
        return await self._change(capture_id, "running", "aborted")

    async def delete_capture(self, capture_id: str) -> None:
        if self.capture(capture_id).status.state == "running":
            raise RefusedError("this capture is not over; abort it first")
        del self.records[capture_id]
        run = self.runs / capture_id
        for folder in (*trainings_on(run), run):
            shutil.rmtree(folder, ignore_errors=True)

    def floor_plan(self) -> FloorPlan:
        places = tuple(
            StartPlace(
                d,
                d.title(),
                COLOURS[d],
                f"192.0.2.{n}",
                "",
                *place,
                focal_px=self.cameras[d].config.intrinsics.fx,
                calibrated=self.cameras[d].config.intrinsics != TELLO_INTRINSICS,
            )
            for n, (d, place) in enumerate(zip(DRONES, _PLACES, strict=True), start=1)
        )
        return FloorPlan(1.8, 4.5, 3.0, places)

    def configuration(self) -> Mapping[str, object]:
        return {"mission": self.mission_config}

    def run_folder(self, capture_id: str) -> Path:
        if capture_id in self.records or not is_run(self.runs, capture_id):
            self.capture(capture_id)
        return self.runs / capture_id

    def keep(
        self,
        status: CaptureChanged,
        request: CaptureRequest | None = None,
        metrics: dict[str, object] | None = None,
    ) -> CaptureRecord:
        record = CaptureRecord(request or CaptureRequest(), status, datetime.now(UTC), metrics)
        self.records[status.id] = record
        return record

    async def _change(self, capture_id: str, before: str, after: str) -> CaptureRecord:
        record = self.capture(capture_id)
        await self._perhaps_hang()
        if record.status.state != before:
            raise RefusedError(f"it is {record.status.state}")
        return self.keep(replace(record.status, state=after), record.request)

    async def _perhaps_hang(self) -> None:
        if self.hangs:
            await self.released.wait()

    def _needs_picture(self, drone_id: str) -> None:
        self._check(drone_id)
        if drone_id not in self.frames:
            raise RefusedError(f"{drone_id} has no live picture to point at")

    def _check(self, drone_id: str) -> None:
        if drone_id not in DRONES:
            raise UnknownError(f"there is no drone {drone_id!r}")


@dataclass
class FakeStops:
    """Keeps every stop; knows the four drones only."""

    calls: list[tuple[str, str | None]] = field(default_factory=list)

    def hold(self, drone_id: str | None = None) -> None:
        self._keep("hold", drone_id)

    def land(self, drone_id: str | None = None) -> None:
        self._keep("land", drone_id)

    def cut_motors(self, drone_id: str | None = None) -> None:
        self._keep("cut_motors", drone_id)

    def _keep(self, name: str, drone_id: str | None) -> None:
        if drone_id is not None and drone_id not in DRONES:
            raise KeyError(drone_id)
        self.calls.append((name, drone_id))
