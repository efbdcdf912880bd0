"""One drone as the pilot knows it: what is believed of it, and what is wanted of it."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from server.geometry.boxes import Box3
from server.mission.config import FlightConfig
from server.mission.eyes import Eye, Sight
from server.mission.standing import StandingWatch
from server.mission.whereabouts import LastHeard, coasted, turned, whereabouts
from server.planner.route import Detour, next_detour
from server.planner.tracking import BoxTracker, WantedView
from server.stages import Box, CameraPose, SeedGeometry, Telemetry, Viewpoint
from server.swarm.connection import OVERTAKEN_S
from server.swarm.drone import Drone
from server.swarm.failsafes import FlightReadings
from server.vision.localization import PoseFilter
from server.vision.target import TargetEstimate, TargetEstimator

Array = NDArray[np.float64]

# A box older than this says nothing about where the drone is now.
_STALE_S = 0.6
# Wind is what a drone does beyond what it was told: averaged over this time, and at most so much.
_WIND_TAU_S = 1.5
_WIND_MAX_M_S = 0.45
# Holding its place against wind may take at most this share of the greatest speed.
_WIND_SHARE = 0.9
# In still air a hovering Tello drifts as fast, now here, now there: so weak a wind may be none.
_DOUBTFUL_WIND_M_S = 0.05
# Gusts end: how soon wind is no longer believed in that is not felt.
_CALM_TAU_S = 4.0
# How fast a Tello follows its sticks.
_LAG_S = 0.35
# A drone that reports nothing flies on as it last did, and is ever less sure to be there until it
# must have landed.
_STALE_STATE_S = 0.5
_COAST_S = 20.0
_COAST_SIGMA_M_S = 0.1
# What it was told is remembered for a little longer than it takes to notice that it is silent.
_ORDERS_KEPT = 32
# Told to move faster than this, a drone must feel that it moves.
_FELT_M_S = 0.1
# So many reports may be late with that, and so far beyond that speed it may come unfelt, metres:
# the nearer to it, the longer it may be that it really stands.
_UNFELT_REPORTS = 6
_UNFELT_M = 0.06
# For so long a drone flies on that has lost its power, and how well it is known where it fell.
_FALL_S = 0.3
_FELL_SIGMA_M = 0.4
# Boxes of less confidence are shown but correct no pose.
_SURE_ENOUGH = 0.4


@dataclass(frozen=True, slots=True, eq=False)
class Centre:
    """See the object whole and centred from an azimuth about it."""

    azimuth_rad: float


@dataclass(frozen=True, slots=True, eq=False)
class Fly:
    """Be at a viewpoint."""

    viewpoint: Viewpoint


@dataclass(frozen=True, slots=True, eq=False)
class Trim:
    """See the object as the viewpoint wants it seen."""

    viewpoint: Viewpoint
    wanted: WantedView


@dataclass(frozen=True, slots=True, eq=False)
class Steered:
    """Fly as somebody's sticks said last; once they are silent, hover.

    Attributes:
        velocity_m_s: Body FLU velocity ``(3,)``.
        yaw_rate_rad_s: Yaw rate, counter-clockwise positive.
        until_s: When these sticks are too old.
    """

    velocity_m_s: Array
    yaw_rate_rad_s: float
    until_s: float


class Wing:
    """One drone with its beliefs and its goal.

    Attributes:
        drone: The drone.
        eye: What it sees.
        start: Its nominal start place.
        tilt_rad: How far its camera looks down.
        goal: What is wanted of it, None for nothing.
        sticks_free: True once its sticks were seen at rest since it began to fly freely: before,
            they may be pushed by a hand that does not know.
        radius_m: How far out it centres the object.
        tracker: Its PID loops.
        flown: True once it has taken off since it was last set down at its start place.
        filter: What is believed of its pose.
        wind: World velocity ``(3,)`` that it has beyond what it was told, m/s.
    """

    def __init__(
        self, drone: Drone, eye: Eye, start: Viewpoint, config: FlightConfig, number: int
    ) -> None:
        """Build it; ``number`` is the drone's place in the fleet."""
        self._number = number
        self.drone = drone
        self.eye = eye
        self.start = start
        self.tilt_rad = float(np.deg2rad(drone.config.tilt_deg))
        self.goal: Centre | Fly | Trim | Steered | None = None
        self.sticks_free = False
        self.radius_m = float(np.hypot(*start.position_world[:2]))
        self.tracker = BoxTracker(config.planner.tracking)
        self.flown = False
        self._config = config
        self._sequence = -1
        self.wind = np.zeros(3)
        self._told = np.zeros(3)  # World velocity it was told, as a lagging drone follows it.
        # When which world velocity and turn were sent while it could be heard.
        self._orders: deque[tuple[float, Array, float]] = deque(maxlen=_ORDERS_KEPT)
        self._detour: Detour | None = None
        self._target_prior: TargetEstimate | None = None
        self._seen_s: float | None = None
        self._heard: Telemetry | None = None
        self._was_up = False
        self._moves = False
        self._unfelt, self._unfelt_m = 0, 0.0
        self._felt_s = 0.0
        self._standing = StandingWatch()
        self._rose = False
        self.place_at_start()

    def begin_capture(self) -> None:
        """Want nothing, and centre the object from the start circle."""
        self.goal = None
        self.radius_m = float(np.hypot(*self.start.position_world[:2]))

    def begin_flight(self) -> None:
        """Forget what was felt and seen in the flight before."""
        self.wind, self._told = np.zeros(3), np.zeros(3)
        self._orders.clear()
        self._seen_s = None
        self._rose = False
        self._unfelt, self._unfelt_m = 0, 0.0
        self._felt_s = 0.0 if self._heard is None else self._heard.received_s
        self._standing.reset()

    def place_at_start(self) -> None:
        """Believe the drone to stand at its nominal start place."""
        self.filter = PoseFilter(
            self.drone.config.id,
            self.start.position_world,
            self.start.yaw_rad,
            self._config.vision.localization,
            self.drone.config.intrinsics,
            self.tilt_rad,
        )
        if self._target_prior is not None:
            self.filter.begin_target(self._target_prior)

    def begin_target(self, prior: TargetEstimate) -> None:
        """Believe ``prior`` of the object from now on, and in later flights of this capture."""
        self._target_prior = prior
        self.filter.begin_target(prior)

    def fresh_sight(self, now_s: float) -> Sight | None:
        """Return the newest sight unless it is stale."""
        sight = self.eye.sight
        if sight is None or now_s - sight.frame.captured_s > _STALE_S:
            return None
        return sight

    def fresh_box(self, now_s: float) -> Box | None:
        """Return the box of the newest sight unless that is stale."""
        sight = self.fresh_sight(now_s)
        return None if sight is None else sight.box

    def observe(self, target: TargetEstimator, seed: SeedGeometry | None) -> None:
        """Take new telemetry and a new box, and share what they tell about the object."""
        telemetry = self.drone.telemetry
        if self.drone.activity == "flying":
            self.flown = True
        if telemetry is not None and telemetry is not self._heard:
            self._observe_telemetry(telemetry)
        sight = self.eye.sight
        if sight is None or sight.frame.sequence <= self._sequence:
            return
        self._sequence = sight.frame.sequence
        # Near the floor the object fills the picture or hides behind its edge.
        usable = sight.box is not None and sight.box.confidence > _SURE_ENOUGH
        if usable and self.drone.activity in ("flying", "holding"):
            others = target.estimate(excluding=self.drone.config.id)
            assert sight.box is not None
            if self.filter.observe_box(sight.box, sight.frame.captured_s, others, seed):
                self._seen_s = sight.frame.captured_s
                self._watch_standing(sight.box, sight.frame.captured_s)
            target.observe(self.drone.config.id, self.filter.target_belief())

    def _watch_standing(self, box: Box, at_s: float) -> None:
        """Lose trust in a drone that reports to stand while what it sees goes away."""
        if self._heard is None or self._moves:
            return
        self._standing.observe(box, at_s, self._heard.yaw_rad, self.drone.config.intrinsics)
        offset = self.filter.target_belief().centre - self.filter.pose(at_s).position_world
        since_s = self._standing.drifts_since_s(float(np.linalg.norm(offset)))
        if since_s is not None:
            self._unfelt, self._unfelt_m = _UNFELT_REPORTS, _UNFELT_M
            self._felt_s = min(self._felt_s, since_s)

    def _observe_telemetry(self, telemetry: Telemetry) -> None:
        """Take a new report."""
        before, self._heard = self._heard, telemetry
        restarted = before is not None and (
            telemetry.motor_time_s < before.motor_time_s - OVERTAKEN_S
        )
        if restarted:
            # It was switched off: somebody sets it down at its start place again.
            self.flown = False
        was_up, self._was_up = self._was_up, self.drone.airborne
        self._feel(telemetry, before)
        if before is not None and was_up:
            silent_s = telemetry.received_s - before.received_s
            if restarted or silent_s > _STALE_STATE_S:
                self._find_again(telemetry, self._last_heard(before), silent_s, restarted)
                return
        felt = not (self._blind and self.drone.airborne)
        if not felt:
            # It reports that it stands, but there is nothing it could tell that by.
            yaw_rad = self.filter.pose(telemetry.received_s).yaw_rad
            telemetry = replace(telemetry, velocity_m_s=turned(self._told, -yaw_rad))
        self.filter.observe_telemetry(telemetry, felt=felt)
        height_m = float(self.filter.pose(telemetry.received_s).position_world[2])
        self._rose = self._rose or height_m > self._config.safety.floor_m

    def _feel(self, telemetry: Telemetry, before: Telemetry | None) -> None:
        """Judge by a new report whether the drone feels itself move when it should."""
        self._moves = bool(np.any(telemetry.velocity_m_s[:2]))
        if self._moves:
            self._standing.reset()
        # What it is told beyond its wind is what it should fly.
        beyond_m_s = float(np.hypot(*(self._told + self.wind)[:2])) - _FELT_M_S
        if not self._moves and beyond_m_s > 0.0:
            late_s = 0.0 if before is None else telemetry.received_s - before.received_s
            self._unfelt += 1
            self._unfelt_m += beyond_m_s * min(late_s, _STALE_STATE_S)
        elif self._moves or not self._blind:
            # One that has lost its hold has it again when it feels itself move, not when it stops.
            self._unfelt, self._unfelt_m = 0, 0.0
        if self._unfelt == 0:
            self._felt_s = telemetry.received_s

    @property
    def _blind(self) -> bool:
        """True while it does not know its velocity: it has lost its hold on the floor."""
        return self._unfelt >= _UNFELT_REPORTS and self._unfelt_m >= _UNFELT_M

    def _find_again(
        self, telemetry: Telemetry, last: LastHeard, silent_s: float, restarted: bool
    ) -> None:
        """Believe a drone where it may be that was silent in the air and reports again."""
        if restarted:
            # Without power it fell where it was.
            place, sigma_m = last.position + _FALL_S * last.velocity, _FELL_SIGMA_M
        elif self.drone.airborne:
            place, _ = coasted(last, silent_s)
            sigma_m = _COAST_SIGMA_M_S * silent_s
        else:
            others = self._else_heard(last, telemetry.received_s - silent_s)
            places = np.array([position for position, _ in whereabouts(last, silent_s, others)])
            place = places.mean(axis=0)
            sigma_m = _FELL_SIGMA_M + float(np.linalg.norm(places - place, axis=1).max())
        if not self.drone.airborne:
            place = np.array([place[0], place[1], self._config.vision.localization.start_height_m])
        self.filter.resume(telemetry, place, sigma_m, restarted=restarted)

    def pose(self, now_s: float) -> CameraPose:
        """Return the believed pose; without reports it goes on as it was flying, ever less sure."""
        pose, silent_s = self.filter.pose(now_s), self._silent_s(now_s)
        if silent_s < _STALE_STATE_S:
            return pose
        T_world_cam, covariance = pose.T_world_cam.copy(), pose.covariance.copy()
        assert self._heard is not None
        T_world_cam[:3, 3], _ = coasted(self._last_heard(self._heard), silent_s)
        drifted_m = _COAST_SIGMA_M_S * min(silent_s, _COAST_S)
        covariance[:3, :3] += np.eye(3) * drifted_m**2
        return replace(pose, T_world_cam=T_world_cam, covariance=covariance)

    def velocity(self, now_s: float) -> Array:
        """Return the believed velocity ``(3,)``, world m/s; a silent one flies on as it was."""
        silent_s = self._silent_s(now_s)
        if silent_s < _STALE_STATE_S:
            return self.filter.velocity()
        assert self._heard is not None
        return coasted(self._last_heard(self._heard), silent_s)[1]

    def whereabouts(self, now_s: float) -> list[tuple[Array, Array]]:
        """Return the positions and velocities, each ``(3,)``, world, that it may have.

        There are several only for a drone that has fallen silent in the air.
        """
        silent_s = self._silent_s(now_s)
        if silent_s < _STALE_STATE_S:
            return [(self.pose(now_s).position_world, self.velocity(now_s))]
        assert self._heard is not None
        last = self._last_heard(self._heard)
        return whereabouts(last, silent_s, self._else_heard(last, self._heard.received_s))

    def _else_heard(self, last: LastHeard, heard_s: float) -> list[LastHeard]:
        """Return how else it may have flown on: any order after its report may be its last."""
        return [
            replace(last, velocity=velocity, turn_rad_s=turn_rad_s)
            for sent_s, velocity, turn_rad_s in self._orders
            if sent_s > heard_s
        ]

    def _silent_s(self, now_s: float) -> float:
        """Return for how long a drone in the air has reported nothing."""
        if self._heard is None or not self.drone.airborne:
            return 0.0
        return max(0.0, now_s - self._heard.received_s)

    def _last_heard(self, report: Telemetry) -> LastHeard:
        """Return how it flew at ``report``, the newest that the filter has taken."""
        heard_s = report.received_s
        # Whatever was sent later may never have arrived.
        sent = [order for order in self._orders if order[0] <= heard_s]
        _, velocity, turn_rad_s = sent[-1] if sent else (heard_s, np.zeros(3), 0.0)
        return LastHeard(self.filter.pose(heard_s).position_world, velocity, turn_rad_s)

    def is_heard(self, now_s: float) -> bool:
        """Return whether its state reports are fresh."""
        telemetry = self.drone.telemetry
        return telemetry is not None and now_s - telemetry.received_s < _STALE_STATE_S

    def feel_wind(self, now_s: float, dt_s: float) -> None:
        """Learn the wind from what the drone does beyond what it was told; due at every tick."""
        if not self.is_heard(now_s):
            return
        if self._moves and self.drone.hears:
            beyond = self.filter.velocity() - self._told
            self.wind = self.wind + min(1.0, dt_s / _WIND_TAU_S) * (beyond - self.wind)
        else:
            # It may stand in the wind, have lost its hold, or creep too slowly to report it: what
            # holds it against a wind that is over. One that does not hear goes on as it was told
            # before, which is no wind.
            self.wind = self.wind * max(0.0, 1.0 - dt_s / _CALM_TAU_S)
        self.wind[2] = 0.0  # Up and down its own sensors hold it well.
        strongest = min(_WIND_MAX_M_S, _WIND_SHARE * self._config.safety.max_speed_m_s)
        self.wind = within(self.wind, strongest)

    @property
    def doubtful_wind(self) -> Array:
        """The part ``(3,)`` of the wind, world m/s, that may be none: a drone drifts as much.

        What is sent against it must keep to every limit as if there were no wind. A wind twice as
        strong is no drift: all of the drone's strength may be needed to hold against it.
        """
        beyond_m_s = max(0.0, 2.0 * _DOUBTFUL_WIND_M_S - float(np.linalg.norm(self.wind)))
        return within(self.wind, min(_DOUBTFUL_WIND_M_S, beyond_m_s))

    def against_wind(self, velocity_world: Array) -> Array:
        """Return what to send so that the drone flies ``velocity_world`` ``(3,)`` in its wind.

        The doubtful part of the wind is taken from the velocity already.
        """
        wind = self.wind - self.doubtful_wind
        share = share_flown(velocity_world, wind, self._config.safety.max_speed_m_s)
        return share * velocity_world - wind

    def was_told(
        self, velocity_world: Array, yaw_rate_rad_s: float, now_s: float, dt_s: float
    ) -> None:
        """Note the world velocity ``(3,)`` and turn really sent; zero while it only hovers."""
        if self.is_heard(now_s):
            self._orders.append((now_s, velocity_world, yaw_rate_rad_s))
        self._told = self._told + min(1.0, dt_s / _LAG_S) * (velocity_world - self._told)

    def turning(self, goal: Array, pose: CameraPose, obstacle: Box3, now_s: float) -> int:
        """Return which way round the object it goes to ``goal`` ``(3,)``: +1, -1 or 0."""
        self._detour = next_detour(
            self._detour,
            pose.position_world,
            goal,
            obstacle,
            self._config.planner,
            now_s,
            self._number,
        )
        return self._detour.turning

    @property
    def minds_floor(self) -> bool:
        """Whether it is too low by mistake when it is: it has risen, and nobody lands it."""
        return self._rose and self.drone.activity in ("flying", "holding")

    def ages(self, now_s: float) -> FlightReadings:
        """Return how long it has neither seen the object nor felt itself move."""
        heard = self._heard
        return FlightReadings(
            object_age_s=None if self._seen_s is None else now_s - self._seen_s,
            velocity_age_s=0.0 if heard is None else max(0.0, heard.received_s - self._felt_s),
        )


def within(vector: Array, longest: float) -> Array:
    """Return ``vector`` ``(3,)``, shortened to ``longest`` where it is longer."""
    return vector * min(1.0, longest / max(float(np.linalg.norm(vector)), 1e-9))


def share_flown(velocity: Array, wind: Array, fastest_m_s: float) -> float:
    """Return the largest share s, at most 1, with |s velocity - wind| <= ``fastest_m_s``.

    What cannot be flown is taken from the wish alone: less against the wind would let it carry the
    drone where the wish, which keeps to every limit, does not go. The wind is weaker than that.
    """
    a, half_b = float(velocity @ velocity), float(velocity @ wind)
    c = float(wind @ wind) - fastest_m_s**2
    if a < 1e-12:
        return 1.0
    return min(1.0, (half_b + float(np.sqrt(half_b**2 - a * c))) / a)
