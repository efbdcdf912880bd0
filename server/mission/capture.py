"""Taking pictures: the stills of the dataset and the key frames between them.

A still is taken from the first undamaged picture of a drone that hovers; picture, mask, pose and
telemetry are on disk before the next phase begins.
"""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime

import cv2
import numpy as np

from server.geometry.axes import wrap_angle
from server.geometry.boxes import Box3
from server.mission.config import MissionConfig
from server.mission.events import CaptureTaken, EventStream
from server.mission.eyes import Eye, Sight
from server.mission.pilot import Pilot
from server.nerf.flight import FlightPicture
from server.stages import CameraPose, Capture, Telemetry
from server.store.runs import RunFolder
from server.swarm.fleet import Fleet
from server.vision.sharpness import sharpness

_QUALITY = [cv2.IMWRITE_JPEG_QUALITY, 95]
_KEYFRAME_QUALITY = [cv2.IMWRITE_JPEG_QUALITY, 90]
_POLL_S = 0.03


@dataclass(frozen=True, slots=True, eq=False)
class _CleanSight:
    """An undamaged picture of a drone that hovers.

    Attributes:
        sight: The picture and what it shows.
        pose: Where its camera was believed to be.
        telemetry: The drone's newest state report.
        damaged_before: Damaged pictures that were passed over for it.
    """

    sight: Sight
    pose: CameraPose
    telemetry: Telemetry
    damaged_before: int


class Photographer:
    """Takes the pictures of one run.

    Attributes:
        poses: Where the stills on disk were taken, in order.
    """

    def __init__(
        self,
        run: RunFolder,
        fleet: Fleet,
        eyes: Mapping[str, Eye],
        pilot: Pilot,
        events: EventStream,
        config: MissionConfig,
    ) -> None:
        self.poses: list[CameraPose] = []
        self._run = run
        self._fleet = fleet
        self._eyes = eyes
        self._pilot = pilot
        self._events = events
        self._config = config
        self._keyframes = 0
        self._last_keyframe: dict[str, CameraPose] = {}

    @property
    def taken(self) -> int:
        """How many stills are on disk."""
        return len(self.poses)

    async def take_all(
        self, drones: list[str], round_index: int, object_box: Box3 | None
    ) -> list[str]:
        """Take one still with each drone; returns those that gave no clean picture in time."""
        sights = await asyncio.gather(*(self._clean_sight(drone_id) for drone_id in drones))
        missed: list[str] = []
        for drone_id, found in zip(drones, sights, strict=True):
            if found is None:
                missed.append(drone_id)
            else:
                # Once begun it is finished: half a picture would be taken again under its number.
                await asyncio.shield(self._keep(drone_id, found, round_index, object_box))
        return missed

    async def save_keyframes(self, drones: list[str]) -> None:
        """Save a key frame of each drone that has moved or turned far enough since its last one."""
        for drone_id in drones:
            sight = self._eyes[drone_id].sight
            if sight is None or sight.frame.damaged:
                continue
            pose = self._pilot.pose(drone_id, sight.frame.captured_s)
            if self._worth_a_keyframe(drone_id, pose):
                self._last_keyframe[drone_id] = pose
                file = f"keyframes/{self._keyframes:04d}.jpg"
                self._keyframes += 1
                await asyncio.to_thread(self._save_keyframe, file, sight, pose)

    def _worth_a_keyframe(self, drone_id: str, pose: CameraPose) -> bool:
        last = self._last_keyframe.get(drone_id)
        if last is None:
            return True
        moved_m = float(np.linalg.norm(pose.position_world - last.position_world))
        turned_rad = abs(wrap_angle(pose.yaw_rad - last.yaw_rad))
        return moved_m > self._config.keyframe_m or turned_rad > self._config.keyframe_rad

    async def _clean_sight(self, drone_id: str) -> _CleanSight | None:
        """Wait for an undamaged picture of the drone hovering; None when the time is up."""
        loop = asyncio.get_running_loop()
        deadline_s = loop.time() + self._config.picture_timeout_s
        drone, eye = self._fleet.drones[drone_id], self._eyes[drone_id]
        sequence = -1 if eye.sight is None else eye.sight.frame.sequence
        begun_s = loop.time()
        damaged = 0
        while loop.time() < deadline_s:
            await asyncio.sleep(_POLL_S)
            sight, telemetry = eye.sight, drone.telemetry
            if sight is None or telemetry is None or sight.frame.sequence <= sequence:
                continue
            sequence = sight.frame.sequence
            if sight.frame.damaged:
                damaged += 1
                # It is the radio: the next key picture may come through whole.
                deadline_s = begun_s + self._config.whole_picture_timeout_s
            slow = np.linalg.norm(telemetry.velocity_m_s) <= self._config.still_m_s
            late = loop.time() > deadline_s - self._config.picture_timeout_s / 2.0
            # A drone that gusts never let rest gives a picture all the same, if an undamaged one.
            if not sight.frame.damaged and (slow or late):
                pose = self._pilot.pose(drone_id, sight.frame.captured_s)
                return _CleanSight(sight, pose, telemetry, damaged)
        return None

    async def _keep(
        self, drone_id: str, found: _CleanSight, round_index: int, object_box: Box3 | None
    ) -> None:
        capture = Capture(
            index=self.taken,
            round_index=round_index,
            pose=found.pose,
            intrinsics=self._fleet.drones[drone_id].config.intrinsics,
            telemetry=found.telemetry,
            box=found.sight.box,
            file=f"images/{self.taken:04d}.jpg",
            captured_at=datetime.now(UTC),
            damaged_before=found.damaged_before,
        )
        taken = await asyncio.to_thread(self._save_still, capture, found.sight, object_box)
        self.poses.append(found.pose)
        self._last_keyframe[drone_id] = found.pose
        self._events.publish(taken)

    def _save_still(self, capture: Capture, sight: Sight, object_box: Box3 | None) -> CaptureTaken:
        image = sight.frame.image_bgr
        measured = replace(capture, sharpness=round(sharpness(image), 2))
        self._run.add_still(measured, _jpeg(image, _QUALITY), sight.region, object_box)
        small = cv2.resize(image, (160, 120), interpolation=cv2.INTER_AREA)
        return CaptureTaken(measured, _jpeg(small, [cv2.IMWRITE_JPEG_QUALITY, 75]))

    def _save_keyframe(self, file: str, sight: Sight, pose: CameraPose) -> None:
        picture = FlightPicture(
            file=file,
            mask=None,
            still=False,
            drone_id=pose.drone_id,
            at_s=pose.at_s,
            round_index=-1,
            T_world_cam=pose.T_world_cam,
            sigma_m=pose.position_sigma_m,
            sigma_rad=float(np.sqrt(pose.covariance[3, 3])),
        )
        self._run.add_keyframe(picture, _jpeg(sight.frame.image_bgr, _KEYFRAME_QUALITY))


def _jpeg(image_bgr: np.ndarray, options: list[int]) -> bytes:
    done, data = cv2.imencode(".jpg", image_bgr, options)
    if not done:
        raise ValueError("a picture could not be encoded as JPEG")
    return data.tobytes()
