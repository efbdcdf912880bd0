"""Gets drones to their goals: believes poses, wants velocities, avoids, limits, sends setpoints.

One loop for the whole fleet. Per drone a goal says what is wanted: nothing (hover), to see the
object whole and centred from an azimuth (``centre``), to be at a viewpoint (``fly``), or to see the
object as the viewpoint wants it (``trim``, the paper's PID). Every wish passes through reciprocal
avoidance and the safety limits. When this loop stops, setpoints expire and the drones hover.
"""

from __future__ import annotations

import asyncio
from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from server.geometry.axes import wrap_angle
from server.geometry.boxes import Box3
from server.mission.commands import AT_REST, Sticks
from server.mission.config import FlightConfig
from server.mission.events import DroneReported, EventStream, PoseEstimated
from server.mission.eyes import Eye
from server.mission.whereabouts import turned
from server.mission.wing import Centre, Fly, Steered, Trim, Wing, within
from server.planner.avoidance import Agent, Obstacle, agent_from_pose, avoid
from server.planner.errors import PlanError
from server.planner.ring import facing
from server.planner.route import route_velocity
from server.planner.tracking import box_errors, expected_box, fly_to, wanted_view, yaw_rate_to
from server.stages import Box, CameraPose, SeedGeometry, Setpoint, Viewpoint
from server.swarm.fleet import Fleet
from server.swarm.safety import fence_for, flight_readings, limit_setpoint
from server.vision.expectation import expected_region
from server.vision.target import TargetEstimate, TargetEstimator, prior_target

Array = NDArray[np.float64]

_POSE_EVENT_S = 0.1
# After so long without sticks nobody flies a drone by hand any more.
_HANDS_OFF_S = 3.0
# Lower than this a drone stands.
_DOWN_M = 0.05
# While the object is cut off by the picture's edge, step back this fast, metres per second.
_STEP_BACK_M_S = 0.35
_FULL_FRAME = 0.85
# Trimming corrects small errors: farther than this from the viewpoint the drone flies back to it,
# and a box that is this many times larger or smaller than believed is not the object.
_TRIM_REACH_M = 0.35
_TRIM_RATIO = 1.5
# How finely goals beyond a drone's fence are moved in.
_STEP_M = 0.1
# So many places where the object was believed to be are kept away from.
_PLACES_KEPT = 3
# Seed views may miss their azimuth by this much.
SEED_AZIMUTH_RAD = 0.3


class Pilot:
    """Flies the fleet towards goals.

    Attributes:
        paused: While True every drone hovers, still avoiding.
        seed: The seed geometry once known: an obstacle, and what trimming aims at.
        no_go: Columns of the room that no drone may enter, world.
    """

    def __init__(
        self, fleet: Fleet, eyes: Mapping[str, Eye], config: FlightConfig, events: EventStream
    ) -> None:
        self.paused = False
        self.seed: SeedGeometry | None = None
        self.no_go: tuple[Box3, ...] = ()
        self._config = config
        self._events = events
        self._target = TargetEstimator(config.vision.localization)
        # Where the object was believed to be before the operator pointed elsewhere: something
        # stands there, so until the geometry is known drones keep away from these places too.
        self._left_behind: list[Box3] = []
        self._dt_s = 1.0 / config.mission.control_rate_hz
        self._wings: dict[str, Wing] = {}
        for number, (drone_id, drone) in enumerate(fleet.drones.items()):
            azimuth_rad = float(np.deg2rad(drone.config.azimuth_deg))
            start = facing(np.zeros(3), azimuth_rad, fleet.config.start_radius_m, 0.0)
            self._wings[drone_id] = Wing(drone, eyes[drone_id], start, config, number)

    def begin_capture(self) -> None:
        """Forget the object of the capture before: it may be another one, elsewhere."""
        self.paused = False
        self.seed = None
        if self._left_behind:
            self._begin_target(prior_target(self._config.vision.localization))
        self._left_behind.clear()
        self._target = TargetEstimator(self._config.vision.localization)
        for wing in self._wings.values():
            wing.begin_capture()

    def move_target(self, target: TargetEstimate) -> None:
        """Believe the object to be where ``target`` has it, and forget what boxes said of it.

        Moves no drone by itself: goals stay, and every limit holds. Until the seed geometry is
        known the drones also keep away from where the object was believed to be.
        """
        self._left_behind.append(self._obstacle(self._target.estimate()))
        del self._left_behind[:-_PLACES_KEPT]
        self._begin_target(target)

    def _begin_target(self, target: TargetEstimate) -> None:
        self._target = TargetEstimator(self._config.vision.localization, target)
        for wing in self._wings.values():
            wing.begin_target(target)

    # -- goals --------------------------------------------------------------------------------

    def place_at_start(self, drone_id: str) -> None:
        """Believe a drone at its start place; one that has flown stands where it landed."""
        wing = self._wings[drone_id]
        if not wing.flown:
            wing.place_at_start()
        wing.begin_flight()
        wing.goal = None

    def start_azimuth_rad(self, drone_id: str) -> float:
        """Return the nominal azimuth of a drone's start place."""
        return float(np.deg2rad(self._wings[drone_id].drone.config.azimuth_deg))

    def centre(self, drone_id: str, azimuth_rad: float) -> None:
        """Want the object whole and centred, seen from ``azimuth_rad``."""
        self._wings[drone_id].goal = Centre(azimuth_rad)

    def fly(self, drone_id: str, viewpoint: Viewpoint) -> None:
        """Want the drone at ``viewpoint``."""
        self._wings[drone_id].goal = Fly(viewpoint)

    def trim(self, drone_id: str, viewpoint: Viewpoint) -> None:
        """Want the object to appear as from ``viewpoint``; needs the seed geometry."""
        assert self.seed is not None
        wing = self._wings[drone_id]
        camera = wing.drone.config.intrinsics
        wing.tracker.reset()
        wing.goal = Trim(viewpoint, wanted_view(self.seed, viewpoint, camera, wing.tilt_rad))

    def steer(self, drone_id: str, sticks: Sticks) -> None:
        """Want the drone to fly as ``sticks`` say, until the next ones or until they are too old.

        It is a wish like any other: avoidance, fence, standoff and the coasting rule hold. Sticks
        that were pushed already when the drone began to fly freely must come to rest first.
        """
        config, wing = self._config.mission, self._wings[drone_id]
        wing.sticks_free = wing.sticks_free or sticks == AT_REST
        if not wing.sticks_free:
            return
        pushed = np.array([sticks.forward, sticks.left, sticks.up])
        wing.goal = Steered(
            config.manual_speed_m_s * within(pushed, 1.0),
            config.manual_turn_rad_s * sticks.turn,
            asyncio.get_running_loop().time() + config.manual_keep_s,
        )

    def release(self, drones: list[str]) -> None:
        """Want nothing any more."""
        for drone_id in drones:
            self._wings[drone_id].goal = None

    # -- what is believed ---------------------------------------------------------------------

    def pose(self, drone_id: str, at_s: float | None = None) -> CameraPose:
        """Return the believed camera pose of a drone, now or at a recent time."""
        if at_s is None:
            return self._wings[drone_id].pose(asyncio.get_running_loop().time())
        return self._wings[drone_id].filter.pose(at_s)

    def standing_places(self) -> dict[str, Array]:
        """Return where drones that are not in the air are believed to stand, ``(3,)`` world."""
        now_s = asyncio.get_running_loop().time()
        return {
            drone_id: wing.pose(now_s).position_world
            for drone_id, wing in self._wings.items()
            if not wing.drone.airborne
        }

    def wind(self, drone_id: str) -> Array:
        """Return the world velocity ``(3,)``, m/s, that a drone has beyond what it is told."""
        return self._wings[drone_id].wind

    def is_heard(self, drone_id: str) -> bool:
        """Return whether a drone's state reports are fresh."""
        return self._wings[drone_id].is_heard(asyncio.get_running_loop().time())

    def target(self) -> TargetEstimate:
        """Return what is believed of the object."""
        return self._target.estimate()

    def arrived(self, drone_id: str) -> bool:
        """Return whether the drone believes to be at its viewpoint, or as near as it may."""
        goal = self._wings[drone_id].goal
        if not isinstance(goal, Fly):
            return False
        pose, config = self.pose(drone_id), self._config.mission
        place = self._within_fence(goal.viewpoint.position_world, pose)
        offset_m = float(np.linalg.norm(place - pose.position_world))
        turn_rad = abs(wrap_angle(goal.viewpoint.yaw_rad - pose.yaw_rad))
        return offset_m < config.arrive_m and turn_rad < config.arrive_rad

    def centred(self, drone_id: str) -> bool:
        """Return whether the object appears where the goal wants it."""
        wing = self._wings[drone_id]
        now_s = asyncio.get_running_loop().time()
        box = wing.fresh_box(now_s)
        if box is None:
            return False
        if isinstance(wing.goal, Trim):
            errors = box_errors(box, self.pose(drone_id), wing.goal.wanted, 1.0)
            moves = np.array([errors.left_m, errors.up_m])
            config = self._config.mission
            return bool(np.abs(moves).max() < config.arrive_m) and (
                abs(errors.yaw_rad) < config.arrive_rad
            )
        if isinstance(wing.goal, Centre):
            camera = wing.drone.config.intrinsics
            off_px = np.abs(box.centroid_px - np.array([camera.cx, camera.cy])).max()
            seen_from = self.pose(drone_id).position_world - self._target.estimate().centre
            azimuth_rad = float(np.arctan2(seen_from[1], seen_from[0]))
            there = abs(wrap_angle(azimuth_rad - wing.goal.azimuth_rad)) < SEED_AZIMUTH_RAD
            near = off_px < 2.0 * self._config.mission.centred_px
            return there and near and not box.touches_edge
        return False

    def report(self, drone_id: str) -> DroneReported:
        """Return everything a person wants to know about one drone."""
        wing = self._wings[drone_id]
        drone, telemetry = wing.drone, wing.drone.telemetry
        now_s = asyncio.get_running_loop().time()
        pose = wing.filter.pose(now_s)
        frame, ages = drone.newest_frame, wing.ages(now_s)
        return DroneReported(
            drone_id=drone_id,
            name=drone.config.label,
            colour=drone.config.colour,
            activity=drone.activity,
            held=drone.held,
            battery_pct=None if telemetry is None else telemetry.battery_pct,
            temperature_c=None if telemetry is None else telemetry.temperature_c,
            height_m=None if telemetry is None else float(pose.position_world[2]),
            speed_m_s=None if telemetry is None else float(np.linalg.norm(telemetry.velocity_m_s)),
            state_age_s=None if telemetry is None else now_s - telemetry.received_s,
            video_age_s=None if frame is None else now_s - frame.captured_s,
            video_fps=drone.video_fps,
            position_sigma_m=pose.position_sigma_m,
            video_wanted=drone.video_wanted,
            link_age_s=drone.link_age_s,
            object_age_s=ages.object_age_s,
            velocity_age_s=ages.velocity_age_s,
        )

    # -- the loop -----------------------------------------------------------------------------

    async def run(self) -> None:
        """Fly for ever."""
        loop = asyncio.get_running_loop()
        told_s = 0.0
        while True:
            begun_s = loop.time()
            self._tick(begun_s)
            if begun_s - told_s > _POSE_EVENT_S:
                told_s = begun_s
                self._tell_poses(begun_s)
            await asyncio.sleep(max(0.005, self._dt_s - (loop.time() - begun_s)))

    def observe(self, now_s: float) -> TargetEstimate:
        """Take what drones and eyes have new, tell the eyes what to expect; return the target."""
        for wing in self._wings.values():
            wing.observe(self._target, self.seed)
        target = self._target.estimate()
        for wing in self._wings.values():
            camera = wing.drone.config.intrinsics
            wing.eye.expect(expected_region(wing.pose(now_s), target, camera, self.seed))
        return target

    def _tick(self, now_s: float) -> None:
        target = self.observe(now_s)
        flying: list[tuple[Wing, CameraPose, float]] = []
        agents: list[Agent] = []
        for wing in self._wings.values():
            pose = wing.pose(now_s)
            wing.sticks_free = wing.sticks_free and wing.drone.activity == "flying"
            if not wing.drone.airborne:
                continue
            wish = np.zeros(3), 0.0
            # A drone that a failsafe makes hover wants nothing, but still evades the others.
            if not self.paused and wing.drone.activity == "flying":
                wish = self._wish(wing, pose, target, now_s)
            flying.append((wing, pose, wish[1]))
            wing.feel_wind(now_s, self._dt_s)
            # Who climbs, sinks, is held, silent or deaf makes no room: the others do.
            yields = wing.is_heard(now_s) and wing.drone.hears and not wing.drone.held
            yields = yields and wing.drone.activity in ("flying", "holding")
            agents.append(agent_from_pose(pose, wing.velocity(now_s), wish[0], yields))
        if not flying:
            return
        planner = self._config.planner
        obstacle = self._obstacle(target)
        objects = [*(self._left_behind if self.seed is None else ()), obstacle]
        # Of two that contradict one another the later wins: where the object is, is a belief.
        shunned = [*objects, *self.no_go]
        velocities = avoid(
            [*agents, *self._ghosts([wing for wing, _, _ in flying], now_s)],
            [Obstacle(box, self._config.safety.standoff_m) for box in shunned],
            planner.space,
            planner.avoidance,
            self._dt_s,
        )
        poses = [pose for _, pose, _ in flying]
        for (wing, pose, yaw_rate), velocity in zip(flying, velocities[: len(flying)], strict=True):
            steered = wing.drone.activity == "flying"
            setpoint = Setpoint(turned(velocity, -pose.yaw_rad), yaw_rate)
            setpoint = limit_setpoint(setpoint, pose, shunned, self._config.safety)
            if steered:
                # Limits hold with the wind that is believed in, and with its doubtful part away.
                velocity = turned(setpoint.velocity_m_s, pose.yaw_rad) - wing.doubtful_wind
                setpoint = replace(setpoint, velocity_m_s=turned(velocity, -pose.yaw_rad))
                setpoint = limit_setpoint(setpoint, pose, shunned, self._config.safety)
                velocity = wing.against_wind(turned(setpoint.velocity_m_s, pose.yaw_rad))
                setpoint = replace(setpoint, velocity_m_s=turned(velocity, -pose.yaw_rad))
            others = [other for other in poses if other is not pose]
            readings = flight_readings(pose, others, [obstacle, *self.no_go], self._config.safety)
            ages = wing.ages(now_s)
            readings = replace(
                readings,
                object_age_s=ages.object_age_s,
                velocity_age_s=ages.velocity_age_s,
                floor_m=readings.floor_m if wing.minds_floor else None,
            )
            wing.drone.observe_flight(readings, now_s)
            taken = wing.drone.set_setpoint(setpoint, now_s) and steered
            told = turned(setpoint.velocity_m_s, pose.yaw_rad) if taken else np.zeros(3)
            turn_rad_s = setpoint.yaw_rate_rad_s if taken else 0.0
            wing.was_told(told, turn_rad_s, now_s, self._dt_s)

    @staticmethod
    def _ghosts(wings: Iterable[Wing], now_s: float) -> list[Agent]:
        """Return where silent drones may be besides where they are believed; nobody steers them."""
        ghosts: list[Agent] = []
        for wing in wings:
            if wing.is_heard(now_s):
                continue
            name = wing.drone.config.id
            for position, velocity in wing.whereabouts(now_s)[1:]:
                if position[2] > _DOWN_M:
                    ghosts.append(Agent(name, position, velocity, np.zeros(3), 0.0, yields=False))
        return ghosts

    def whereabouts(self, drone_id: str) -> list[Array]:
        """Return the places ``(3,)`` where a drone may be; several only for a silent one."""
        now_s = asyncio.get_running_loop().time()
        return [position for position, _ in self._wings[drone_id].whereabouts(now_s)]

    def _wish(
        self, wing: Wing, pose: CameraPose, target: TargetEstimate, now_s: float
    ) -> tuple[Array, float]:
        """Return the velocity ``(3,)``, world m/s, and yaw rate the goal asks for."""
        tracking = self._config.planner.tracking
        match wing.goal:
            case Centre(azimuth_rad):
                viewpoint = self._centring_viewpoint(wing, azimuth_rad, target, now_s)
                return self._towards(wing, pose, viewpoint, target, now_s)
            case Fly(viewpoint):
                return self._towards(wing, pose, viewpoint, target, now_s)
            case Trim(viewpoint, wanted):
                place = self._within_fence(viewpoint.position_world, pose)
                if np.linalg.norm(place - pose.position_world) > _TRIM_REACH_M:
                    return self._towards(wing, pose, viewpoint, target, now_s)
                box = wing.fresh_box(now_s)
                if box is not None and not self._plausible(wing, box, pose):
                    box = None
                setpoint = wing.tracker.update(box, pose, wanted, self._dt_s)
                return turned(setpoint.velocity_m_s, pose.yaw_rad), setpoint.yaw_rate_rad_s
            case Steered(velocity, yaw_rate, until_s):
                if now_s > until_s + _HANDS_OFF_S:
                    wing.goal = None  # It turns to the object again, which bounds its drift.
                if now_s > until_s:
                    return np.zeros(3), 0.0
                return turned(velocity, pose.yaw_rad), yaw_rate
            case None:
                # Keep looking at the object: it bounds the drift of the believed pose.
                bearing = target.centre[:2] - pose.position_world[:2]
                wanted_yaw = float(np.arctan2(bearing[1], bearing[0]))
                return np.zeros(3), yaw_rate_to(pose.yaw_rad, wanted_yaw, tracking)

    def _plausible(self, wing: Wing, box: Box, pose: CameraPose) -> bool:
        """Return whether a box looks like the seed geometry from where the drone believes to be.

        Trimming on something else, or on a part of the object, would fly into the object.
        """
        assert self.seed is not None
        here = Viewpoint(pose.position_world, pose.yaw_rad)
        try:
            expected = expected_box(self.seed, here, wing.drone.config.intrinsics, wing.tilt_rad)
        except PlanError:
            return False
        overlap = np.minimum(box.xyxy_px[2:], expected[2:]) - np.maximum(
            box.xyxy_px[:2], expected[:2]
        )
        ratio = float(np.sqrt(np.prod(box.size_px) / np.prod(expected[2:] - expected[:2])))
        return bool((overlap > 0.0).all()) and 1.0 / _TRIM_RATIO < ratio < _TRIM_RATIO

    def _towards(
        self,
        wing: Wing,
        pose: CameraPose,
        viewpoint: Viewpoint,
        target: TargetEstimate,
        now_s: float,
    ) -> tuple[Array, float]:
        tracking, obstacle = self._config.planner.tracking, self._obstacle(target)
        place = self._within_fence(viewpoint.position_world, pose)
        velocity = route_velocity(
            pose.position_world,
            place,
            obstacle,
            self._config.planner,
            wing.turning(viewpoint.position_world, pose, obstacle, now_s),
        )
        _, yaw_rate = fly_to(pose, viewpoint, tracking)
        offset = place - pose.position_world
        if np.linalg.norm(offset[:2]) > 0.5:
            # On the way, look at the object rather than where the viewpoint will look.
            bearing = target.centre[:2] - pose.position_world[:2]
            wanted_yaw = float(np.arctan2(bearing[1], bearing[0]))
            yaw_rate = yaw_rate_to(pose.yaw_rad, wanted_yaw, tracking)
            # Going past the object turns the bearing to it, and the drone has to turn along.
            across = bearing[1] * velocity[0] - bearing[0] * velocity[1]
            limit = tracking.yaw_rate_max_rad_s
            yaw_rate += across / max(float(bearing @ bearing), 0.25)
            yaw_rate = float(np.clip(yaw_rate, -limit, limit))
        return velocity, yaw_rate

    def _within_fence(self, place: Array, pose: CameraPose) -> Array:
        """Return ``place``, or where a drone as unsure as this one has to stop before it."""
        # In steps, as whoever goes to a place that moves begins its way round the object again.
        fence_m = _STEP_M * np.floor(fence_for(pose, self._config.safety) / _STEP_M)
        share = min(1.0, fence_m / max(float(np.hypot(place[0], place[1])), 1e-9))
        return place * [share, share, 1.0]

    def _centring_viewpoint(
        self, wing: Wing, azimuth_rad: float, target: TargetEstimate, now_s: float
    ) -> Viewpoint:
        """Return where to see the object whole from: further out while it is cut off."""
        space = self._config.planner.space
        box = wing.fresh_box(now_s)
        if box is not None:
            camera = wing.drone.config.intrinsics
            fill = float((box.size_px / np.array([camera.width, camera.height])).max())
            if box.touches_edge or fill > _FULL_FRAME:
                wing.radius_m += _STEP_BACK_M_S * self._dt_s
        reach_m = space.fence_radius_m - float(np.hypot(*target.centre[:2])) - 0.2
        wing.radius_m = min(wing.radius_m, reach_m)
        height_m = float(target.centre[2] + wing.radius_m * np.tan(wing.tilt_rad))
        height_m = float(np.clip(height_m, space.floor_m, space.ceiling_m))
        return facing(target.centre, azimuth_rad, wing.radius_m, height_m)

    def _obstacle(self, target: TargetEstimate) -> Box3:
        """Return the box to keep away from: the seed's, or a guess around the object's place."""
        if self.seed is not None:
            return self.seed.outer
        half = np.full(3, 0.25)
        half[2] = max(0.25, target.height_m / 2.0)
        return Box3(target.centre - half, target.centre + half)

    def _tell_poses(self, now_s: float) -> None:
        for wing in self._wings.values():
            self._events.publish(
                PoseEstimated(
                    wing.filter.pose(now_s), wing.drone.config.intrinsics, wing.drone.config.colour
                )
            )
