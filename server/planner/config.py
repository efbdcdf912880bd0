"""Configuration of the planner, in the pieces that its modules take.

Lengths are metres, angles radians unless a name says otherwise, weights are shares without unit.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field


def _require(holds: bool, name: str, rule: str) -> None:
    if not holds:
        raise ValueError(f"{name} must be {rule}")


@dataclass(frozen=True, slots=True)
class FlightSpace:
    """The room drones may use. Every planner module obeys it.

    Attributes:
        fence_radius_m: Radius of the cylindrical fence about the world's origin.
        floor_m: Lowest height of a camera.
        ceiling_m: Greatest height of a camera.
        standoff_m: Least horizontal distance to the object's outer box; nobody flies above it.
        view_standoff_m: Least such distance of viewpoints, where the fence leaves half of them.
            Drones that come near the object creep, see ``server.swarm.coasting``.
        separation_m: Least distance between viewpoints occupied at the same time.
        downwash_factor: How many times the separation two drones keep when one is above the other.
        no_go: Volumes that no drone may enter, each as the x, y, z of its lower and then of its
            upper corner, world metres; in flight they reach from the floor to the ceiling. They do
            not hide the object.
        no_go_clearance_m: Distance that planned poses and ways keep from them.
    """

    fence_radius_m: float = 4.0
    floor_m: float = 0.45
    ceiling_m: float = 2.0
    standoff_m: float = 0.9
    view_standoff_m: float = 1.2
    separation_m: float = 1.0
    downwash_factor: float = 2.0
    no_go: tuple[tuple[float, float, float, float, float, float], ...] = ()
    no_go_clearance_m: float = 0.8

    def __post_init__(self) -> None:
        _require(self.fence_radius_m > 0, "fence_radius_m", "positive")
        _require(self.floor_m >= 0, "floor_m", "at least 0")
        _require(self.ceiling_m > self.floor_m, "ceiling_m", "above floor_m")
        _require(self.standoff_m > 0, "standoff_m", "positive")
        _require(self.view_standoff_m > 0, "view_standoff_m", "positive")
        _require(self.separation_m > 0, "separation_m", "positive")
        _require(self.downwash_factor >= 1, "downwash_factor", "at least 1")
        _require(self.no_go_clearance_m >= 0, "no_go_clearance_m", "at least 0")
        for corners in self.no_go:
            finite = len(corners) == 6 and all(map(math.isfinite, corners))
            upright = finite and all(corners[axis] <= corners[axis + 3] for axis in range(3))
            _require(upright, "no_go", "boxes of six finite numbers, lower corner first")


@dataclass(frozen=True, slots=True)
class RingConfig:
    """The standard placement.

    Attributes:
        fill: Share of the frame that the larger side of the object's box fills.
    """

    fill: float = 0.6

    def __post_init__(self) -> None:
        _require(0 < self.fill < 1, "fill", "between 0 and 1")


@dataclass(frozen=True, slots=True)
class CandidateConfig:
    """The finite set P of candidate poses: shells around the seed geometry.

    Attributes:
        radius_factors: Shells, as factors of the nearest distance that still shows the whole
            object and keeps the standoff, each at least 1.
        above_m: Highest candidates above the object's top. With a fixed tilt the object stays in
            view at greater heights only from farther away, under the same elevation.
        heights: Number of height steps between floor and that height, or the ceiling.
        azimuths: Number of azimuths per shell and height, before thinning out.
        minimum: Fewest candidates wanted; azimuths are doubled, at most three times, to reach it.
        margin: Share of the frame that stays free around the whole object.
        off_fence_m: So far inside the fence candidates keep where that leaves half of them. Drones
            that come near a fence creep, see ``server.swarm.coasting``, and may be beyond it.
    """

    radius_factors: tuple[float, ...] = (1.0, 1.15, 1.35)
    above_m: float = 1.0
    heights: int = 7
    azimuths: int = 48
    minimum: int = 600
    margin: float = 0.05
    off_fence_m: float = 0.3

    def __post_init__(self) -> None:
        _require(len(self.radius_factors) > 0, "radius_factors", "non-empty")
        _require(min(self.radius_factors) >= 1, "radius_factors", "at least 1 each")
        _require(self.heights >= 1, "heights", "at least 1")
        _require(self.azimuths >= 4, "azimuths", "at least 4")
        _require(self.minimum >= 1, "minimum", "at least 1")
        _require(0 <= self.margin < 0.4, "margin", "in [0, 0.4)")
        _require(self.off_fence_m >= 0, "off_fence_m", "at least 0")


@dataclass(frozen=True, slots=True)
class FitnessConfig:
    """Weights and scales of the fitness; ``server.planner.fitness`` has the formulas.

    Attributes:
        samples: Wanted number of surface samples.
        incidence_max_rad: A surface seen more obliquely than this does not count as seen.
        views_wanted: Views of a sample after which another one adds no visibility (of many views).
        pictures_per_view: K pictures ask for K over this many views of a sample, at least one.
        view_decay: Worth of each further view of a sample relative to the one before, in (0, 1].
        sharp_share: Share of the sharpest possible view's pixel density at which a view counts
            fully as one, in (0, 1].
        detail_px_per_m2: Density of pixels at which detail begins to saturate.
        normal_doubt: How little a box's face says about the slope of the surface inside, from 0
            (all) to 1 (nothing); detail's cosine moves by this share to its mean, one half.
        spread_rad: Angle to the nearest view at which a direction counts as not viewed.
        overlap_rad: Views closer than this, seen from the object, overlap more than needed.
        baseline_low_rad: Smallest good angle to the neighbouring view.
        baseline_high_rad: Greatest good angle to the neighbouring view.
        position_sigma_m: Standard deviation of a drone's position about the commanded one.
        yaw_sigma_rad: Standard deviation of a drone's heading about the commanded one.
        tau_px: Scale of the picture error in Algorithm 1.
        weight_agreement: Weight of Algorithm 1's sum.
        weight_visibility: Weight of the capped multi-view coverage.
        weight_detail: Weight of the resolution on the surface.
        weight_priority: Weight of the coverage of concavities.
        weight_spread: Weight of the coverage of viewing directions.
        weight_baseline: Weight of well-spaced neighbours.
        weight_overlap: Weight of the penalty for overlap.
    """

    samples: int = 800
    incidence_max_rad: float = math.radians(75.0)
    views_wanted: int = 3
    pictures_per_view: float = 8.0
    view_decay: float = 0.6
    sharp_share: float = 0.5
    detail_px_per_m2: float = 2e4
    normal_doubt: float = 0.2
    spread_rad: float = math.radians(60.0)
    overlap_rad: float = math.radians(12.0)
    baseline_low_rad: float = math.radians(10.0)
    baseline_high_rad: float = math.radians(40.0)
    position_sigma_m: float = 0.08
    yaw_sigma_rad: float = math.radians(2.0)
    tau_px: float = 60.0
    weight_agreement: float = 0.05
    weight_visibility: float = 0.30
    weight_detail: float = 0.30
    weight_priority: float = 0.10
    weight_spread: float = 0.15
    weight_baseline: float = 0.10
    weight_overlap: float = 0.05

    def __post_init__(self) -> None:
        _require(self.samples >= 50, "samples", "at least 50")
        _require(0 < self.incidence_max_rad < math.pi / 2, "incidence_max_rad", "in (0, pi/2)")
        _require(self.views_wanted >= 1, "views_wanted", "at least 1")
        _require(0 < self.view_decay <= 1, "view_decay", "in (0, 1]")
        _require(0 < self.sharp_share <= 1, "sharp_share", "in (0, 1]")
        _require(0 <= self.normal_doubt <= 1, "normal_doubt", "in [0, 1]")
        for name in (
            "pictures_per_view",
            "detail_px_per_m2",
            "spread_rad",
            "overlap_rad",
            "baseline_low_rad",
            "tau_px",
        ):
            _require(getattr(self, name) > 0, name, "positive")
        _require(
            self.baseline_high_rad > self.baseline_low_rad,
            "baseline_high_rad",
            "above baseline_low_rad",
        )
        for name in ("position_sigma_m", "yaw_sigma_rad"):
            _require(getattr(self, name) >= 0, name, "at least 0")
        weights = [n for n in self.__dataclass_fields__ if n.startswith("weight_")]
        for name in weights:
            _require(getattr(self, name) >= 0, name, "at least 0")
        _require(any(getattr(self, n) > 0 for n in weights), "the weights", "not all 0")


@dataclass(frozen=True, slots=True)
class AnnealingConfig:
    """Simulated annealing.

    Attributes:
        swaps: Proposed moves in all.
        restarts: Annealings from anywhere after the one from the first start, at most 4; each has
            a fifth of the moves.
        restart_heat: How many times hotter those begin.
        start_temperature: First temperature, as a share of the first start's fitness.
        end_factor: Last temperature as a factor of the first, of the annealing from the first
            start; the others end as cool.
        adjust_share: Share of moves that go to a neighbouring candidate rather than to any.
        neighbours: How many nearest candidates count as neighbouring.
        report_every: Moves between two progress reports.
        prove: Whether to compute the upper bound of the fitness.
    """

    swaps: int = 40_000
    restarts: int = 2
    restart_heat: float = 50.0
    start_temperature: float = 1e-3
    end_factor: float = 1e-3
    adjust_share: float = 0.5
    neighbours: int = 12
    report_every: int = 2_000
    prove: bool = True

    def __post_init__(self) -> None:
        _require(self.swaps >= 0, "swaps", "at least 0")
        _require(0 <= self.restarts <= 4, "restarts", "from 0 to 4")
        _require(self.restart_heat >= 1, "restart_heat", "at least 1")
        _require(self.start_temperature > 0, "start_temperature", "positive")
        _require(0 < self.end_factor <= 1, "end_factor", "in (0, 1]")
        _require(0 <= self.adjust_share <= 1, "adjust_share", "in [0, 1]")
        _require(self.neighbours >= 1, "neighbours", "at least 1")
        _require(self.report_every >= 1, "report_every", "at least 1")


@dataclass(frozen=True, slots=True)
class PidGains:
    """Gains of one control axis; the error is in metres (or radians), the output per second.

    Attributes:
        p: Proportional gain, 1/s.
        i: Integral gain, 1/s^2.
        d: Derivative gain, without unit.
        integral_limit: Greatest share of the output that the integral may have, output units.
    """

    p: float
    i: float = 0.0
    d: float = 0.0
    integral_limit: float = 0.1

    def __post_init__(self) -> None:
        for name in ("p", "i", "d", "integral_limit"):
            _require(getattr(self, name) >= 0, name, "at least 0")


@dataclass(frozen=True, slots=True)
class TrackingConfig:
    """The PID on the box, and the flight between viewpoints.

    Attributes:
        roll: Gains of the sideways axis (centroid x).
        pitch: Gains of the forward axis (apparent size).
        throttle: Gains of the vertical axis (centroid y).
        yaw: Gains of the heading (equation 4).
        heading_share: Share of the box's own bearing that is added to equation 4's angle; with 1
            the yaw axis sees the heading error alone and is decoupled from roll.
        derivative_time_s: Time constant of the low-pass before the derivative.
        speed_max_m_s: Greatest speed while fine-tuning.
        yaw_rate_max_rad_s: Greatest yaw rate.
        travel_speed_m_s: Greatest speed between viewpoints.
        travel_gain: Speed per distance near the goal, 1/s.
    """

    roll: PidGains = field(default=PidGains(0.6, 0.02, 0.10))
    pitch: PidGains = field(default=PidGains(0.5, 0.02, 0.05))
    throttle: PidGains = field(default=PidGains(0.6, 0.02, 0.10))
    yaw: PidGains = field(default=PidGains(0.9, 0.02, 0.05))
    heading_share: float = 1.0
    derivative_time_s: float = 0.15
    speed_max_m_s: float = 0.3
    yaw_rate_max_rad_s: float = math.radians(45.0)
    travel_speed_m_s: float = 0.5
    travel_gain: float = 0.7

    def __post_init__(self) -> None:
        _require(0 <= self.heading_share <= 1, "heading_share", "in [0, 1]")
        for name in (
            "derivative_time_s",
            "speed_max_m_s",
            "yaw_rate_max_rad_s",
            "travel_speed_m_s",
            "travel_gain",
        ):
            _require(getattr(self, name) > 0, name, "positive")


@dataclass(frozen=True, slots=True)
class AvoidanceConfig:
    """Reciprocal collision avoidance.

    Attributes:
        radius_m: Radius of one drone's protected sphere; two drones keep the sum of theirs.
        sigma_factor: How many standard deviations of its pose are added to a drone's radius.
        sigma_margin_max_m: Upper limit of that addition, so that goals stay reachable.
        horizon_s: How far ahead collisions with drones are avoided.
        wall_horizon_s: Time in which the free distance to object or fence may be used up.
        recovery_s: Time in which drones that are already too close shall be apart again.
        speed_max_m_s: Greatest speed.
        lag_s: Time constant with which a drone takes up a new velocity, seconds.
        latency_s: Age of what is believed plus the time until a setpoint takes effect, seconds.
        acceleration_max_m_s2: Greatest acceleration a setpoint may ask for.
        sidestep: Share of the speed given to passing on the right of a drone ahead.
        sidestep_stalled: Further share that is added as a drone makes less progress.
        parked_factor: How many times more of it is given to passing a drone that hovers.
        calm_share: Share of its wish that a drone at full speed gives up when no velocity is safe.
        downwash_factor: How many times the distance is kept vertically.
    """

    radius_m: float = 0.4
    sigma_factor: float = 1.0
    sigma_margin_max_m: float = 0.1
    horizon_s: float = 3.0
    wall_horizon_s: float = 1.0
    recovery_s: float = 0.8
    speed_max_m_s: float = 0.5
    lag_s: float = 0.35
    latency_s: float = 0.1
    acceleration_max_m_s2: float = 1.5
    sidestep: float = 0.15
    sidestep_stalled: float = 0.6
    parked_factor: float = 5.0
    calm_share: float = 0.5
    downwash_factor: float = 2.0

    def __post_init__(self) -> None:
        for name in (
            "radius_m",
            "horizon_s",
            "wall_horizon_s",
            "recovery_s",
            "speed_max_m_s",
            "lag_s",
            "acceleration_max_m_s2",
        ):
            _require(getattr(self, name) > 0, name, "positive")
        for name in (
            "sigma_factor",
            "sigma_margin_max_m",
            "latency_s",
            "sidestep",
            "sidestep_stalled",
            "parked_factor",
        ):
            _require(getattr(self, name) >= 0, name, "at least 0")
        _require(0 <= self.calm_share <= 1, "calm_share", "in [0, 1]")
        _require(self.downwash_factor >= 1, "downwash_factor", "at least 1")


@dataclass(frozen=True, slots=True)
class PlannerConfig:
    """Everything the planner can be told.

    Attributes:
        space: Where drones may be.
        ring: Standard placement.
        candidates: Candidate poses.
        fitness: What a good set of views is.
        annealing: How it is searched.
        tracking: Fine-tuning on the box.
        avoidance: Keeping apart.
        policy: Which rule chooses: annealed, farthest or uncertain (``server.planner.policies``).
            In a capture that trains no field, uncertain chooses as annealed.
        uncertainty_gain: How many times more than a sure patch a wholly unknown one counts, added
            to one; for the policy uncertain.
    """

    space: FlightSpace = field(default_factory=FlightSpace)
    ring: RingConfig = field(default_factory=RingConfig)
    candidates: CandidateConfig = field(default_factory=CandidateConfig)
    fitness: FitnessConfig = field(default_factory=FitnessConfig)
    annealing: AnnealingConfig = field(default_factory=AnnealingConfig)
    tracking: TrackingConfig = field(default_factory=TrackingConfig)
    avoidance: AvoidanceConfig = field(default_factory=AvoidanceConfig)
    policy: str = "annealed"
    uncertainty_gain: float = 4.0

    def __post_init__(self) -> None:
        known = ("annealed", "farthest", "uncertain")
        _require(self.policy in known, "policy", f"one of {', '.join(known)}")
        _require(self.uncertainty_gain >= 0, "uncertainty_gain", "at least 0")
        widest = 2.0 * (self.avoidance.radius_m + self.avoidance.sigma_margin_max_m)
        # Else two drones could be sent to viewpoints that avoidance never lets them reach.
        _require(
            widest <= self.space.separation_m + 1e-9,
            "avoidance.radius_m + avoidance.sigma_margin_max_m",
            "at most half of space.separation_m",
        )
        _require(
            self.avoidance.downwash_factor <= self.space.downwash_factor,
            "avoidance.downwash_factor",
            "at most space.downwash_factor",
        )
