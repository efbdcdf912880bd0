"""What the operator pointed out in the drones' pictures, and what is made of it.

A pick goes to the drone's own eye at once. In the air its ray also says where the object stands:
where the mission believes it to be elsewhere, the picks of all drones together move that belief
(``server.vision.picks``), and the other eyes search anew around the new place. A pick moves no
drone: the running phase flies by its boxes and its target as before, within the same limits.

Picks stand until they are taken back or the capture ends.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from server.mission.commands import PointedPlace, RefusedError
from server.mission.config import FlightConfig
from server.mission.events import Event, EventStream, Noted, ObjectPointedOut
from server.mission.eyes import Eye, Sight
from server.mission.pilot import Pilot
from server.swarm.drone import Drone
from server.vision.picks import Pick, box_around, expected_size, picked_target, shows
from server.vision.target import TargetEstimate, prior_target

Array = NDArray[np.float64]

# A picture older than this shows where the object was.
_LIVE_S = 3.0
# Smaller than this share of the picture's side, a drawn box was meant as a click or not at all.
_SMALLEST_SHARE = 0.02
# Room that must be left between a pointed-out object's standoff and the fence, metres.
_ROOM_M = 0.5
_LOWEST_CENTRE_M = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class _Pointed:
    """A standing pick; ``pick`` is None for one that was made on the ground."""

    event: ObjectPointedOut
    pick: Pick | None


class Pointing:
    """Takes the operator's picks to eyes and pilot, and remembers them."""

    def __init__(
        self,
        drones: Mapping[str, Drone],
        eyes: Mapping[str, Eye],
        pilot: Pilot,
        config: FlightConfig,
        events: EventStream,
        clock: Callable[[], float],
    ) -> None:
        """Build it; ``clock`` is that of the frames' times."""
        self._drones = drones
        self._eyes = eyes
        self._pilot = pilot
        self._config = config
        self._events = events
        self._clock = clock
        self._pointed: dict[str, _Pointed] = {}

    def standing(self) -> list[Event]:
        """Return the picks that stand."""
        return [pointed.event for pointed in self._pointed.values()]

    def live_sight(self, drone_id: str) -> Sight:
        """Return what a drone sees now; raises RefusedError when it has no usable picture."""
        sight = self._eyes[drone_id].sight
        if sight is None or self._clock() - sight.frame.captured_s > _LIVE_S:
            raise RefusedError(f"{drone_id} has no live picture to point at")
        camera = self._drones[drone_id].config.intrinsics
        if sight.frame.size_px != (camera.width, camera.height):
            raise RefusedError(
                f"{drone_id} is calibrated for {camera.width}x{camera.height}: its pictures of"
                f" {sight.frame.size_px[0]}x{sight.frame.size_px[1]} are not searched"
            )
        return sight

    def point_out(self, drone_id: str, place: PointedPlace) -> ObjectPointedOut:
        """Say where the object is in a drone's picture.

        Raises:
            RefusedError: If the drone has no live picture, or the box is too small to mean one.
        """
        sight = self.live_sight(drone_id)
        pick = self._pick(drone_id, place, sight)
        camera = pick.intrinsics
        shares = pick.xyxy_px / np.tile([camera.width, camera.height], 2)
        left, top, right, bottom = (float(share) for share in shares)
        if min(right - left, bottom - top) < _SMALLEST_SHARE:
            raise RefusedError("the box is too small; draw it around the whole object, or click")
        event = ObjectPointedOut(drone_id, (left, top, right, bottom))
        airborne = self._drones[drone_id].activity in ("flying", "holding")
        self._pointed.pop(drone_id, None)  # The newest pick is the last one.
        self._pointed[drone_id] = _Pointed(event, pick if airborne else None)
        self._eyes[drone_id].point_out(pick.xyxy_px)
        self._tell(event, "The operator picked the object in its picture.")
        if airborne:
            self._move_target(drone_id, pick)
        return event

    def search(self, drone_id: str) -> None:
        """Let a drone search the object without help again."""
        self._eyes[drone_id].point_out(None)
        if self._pointed.pop(drone_id, None) is not None:
            self._tell(ObjectPointedOut(drone_id, None), "It searches the object by itself again.")

    def begin_capture(self) -> None:
        """Keep what the eyes follow, but no ray of an earlier flight."""
        for drone_id, pointed in self._pointed.items():
            self._pointed[drone_id] = _Pointed(pointed.event, None)

    def end_capture(self) -> None:
        """Take all picks back."""
        for drone_id in list(self._pointed):
            del self._pointed[drone_id]
            self._eyes[drone_id].point_out(None)
            self._events.publish(ObjectPointedOut(drone_id, None))

    # -- parts --------------------------------------------------------------------------------

    def _pick(self, drone_id: str, place: PointedPlace, sight: Sight) -> Pick:
        camera = self._drones[drone_id].config.intrinsics
        pose = self._pilot.pose(drone_id, sight.frame.captured_s)
        scale = np.array([camera.width, camera.height], float)
        if len(place) == 4:
            # Shares count from the picture's edge, pixels from the first one's centre.
            corners = np.array(place) * np.tile(scale, 2) - 0.5
            xyxy_px = np.clip(corners, 0.0, np.tile(scale - 1.0, 2))
            return Pick(xyxy_px, pose, camera)
        return Pick(
            box_around(np.array(place) * scale - 0.5, self._size(drone_id, sight), camera),
            pose,
            camera,
            sized=False,
        )

    def _size(self, drone_id: str, sight: Sight) -> Array | None:
        """Return the expected size of the object in pixels, else that of the last box."""
        if self._drones[drone_id].activity in ("flying", "holding"):
            camera = self._drones[drone_id].config.intrinsics
            pose = self._pilot.pose(drone_id, sight.frame.captured_s)
            size_px = expected_size(pose, self._pilot.target(), camera, self._pilot.seed)
            if size_px is not None:
                return size_px
        return None if sight.box is None else sight.box.size_px

    def _move_target(self, drone_id: str, pick: Pick) -> None:
        """Move the mission's target where the picks show it to be elsewhere."""
        seed = self._pilot.seed
        if seed is not None:
            # What stands is measured already, and the drones fly around that.
            known = TargetEstimate(seed.outer.centre, float(seed.outer.size[2]), np.eye(4) * 1e-4)
            if not shows(pick, known):
                self._warn(
                    drone_id,
                    "The picked place is not where the measured object stands: the drones go on"
                    " around that. If it is the wrong object, abort and capture anew.",
                )
            return
        if shows(pick, self._pilot.target()):
            return
        target = self._target_of_all(drone_id, pick)
        reach_m = float(np.hypot(*target.centre[:2]))
        safety = self._config.safety
        farthest_m = safety.fence_radius_m - safety.standoff_m - _ROOM_M
        if reach_m > farthest_m:
            self._warn(
                drone_id,
                f"The picked place is {reach_m:.1f} m from the middle; the drones can go around"
                f" an object up to {farthest_m:.1f} m from it. The others go on as before.",
            )
            return
        self._pilot.move_target(target)
        for other, eye in self._eyes.items():
            if other not in self._pointed:
                # It may hold on to the wrong thing: it searches anew, around the new place.
                eye.point_out(None)

    def _target_of_all(self, drone_id: str, pick: Pick) -> TargetEstimate:
        """Return the target by all picks; by the newest alone where they contradict each other."""
        prior = prior_target(self._config.vision.localization)
        picks = [pointed.pick for pointed in self._pointed.values() if pointed.pick is not None]
        target = picked_target(picks, prior)
        if len(picks) > 1 and not all(shows(each, target) for each in picks):
            self._warn(
                drone_id,
                "The picks of the drones do not meet in one place: the newest one counts. Pick the"
                " object on the other tiles again, or let them search.",
            )
            target = picked_target([pick], prior)
        target.centre[2] = max(float(target.centre[2]), _LOWEST_CENTRE_M)
        return target

    def _tell(self, event: ObjectPointedOut, text: str) -> None:
        self._events.publish(event)
        self._events.publish(Noted("info", text, event.drone_id))

    def _warn(self, drone_id: str, text: str) -> None:
        self._events.publish(Noted("warning", text, drone_id))
