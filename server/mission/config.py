"""What the mission may be told: tolerances, waits, counts and choices."""

from __future__ import annotations

from dataclasses import dataclass, fields

from server.planner.config import PlannerConfig
from server.planner.margins import margin_fault
from server.swarm.config import SafetyConfig
from server.vision.config import VisionConfig


@dataclass(frozen=True, slots=True)
class MissionConfig:
    """Settings of the flight; every number must be positive.

    Attributes:
        control_rate_hz: How often setpoints are computed and sent.
        connect_timeout_s: How long preflight waits for every drone's telemetry and first picture.
        centre_timeout_s: How long the drones may take to centre the object before the seed views.
        plan_timeout_s: After this long without a plan the paper's circular step is flown. The first
            plan of a new installation is compiled: 19 s on two busy cores.
        fly_timeout_s: How long a move to the next viewpoints may take.
        tune_timeout_s: How long the trim on the box may take in each round.
        arrive_m: A drone has arrived when it believes to be this near.
        arrive_rad: And its heading is this near.
        centred_px: The box counts as centred when its centroid is this near the wanted place.
        still_m_s: A picture is taken below this speed.
        picture_timeout_s: How long a capture waits for an undamaged picture of a still drone.
        whole_picture_timeout_s: How long instead while pictures come but data is missing in them.
        keyframe_m: A key frame is saved after each such move of a camera.
        keyframe_rad: Or after each such turn.
        grounded_timeout_s: How long a capture whose drones have all landed waits to be resumed.
        manual_speed_m_s: How fast a drone flown by hand goes with its sticks at their ends.
        manual_turn_rad_s: How fast it turns then.
        manual_keep_s: Without fresh sticks for so long it hovers.
        replan_every_round: Plan what is left anew after every round, with the geometry as it is
            known by then, and not only when the operator has changed something. Flights take
            longer with it and see no more (ADR 47).
    """

    control_rate_hz: float = 15.0
    connect_timeout_s: float = 20.0
    centre_timeout_s: float = 40.0
    plan_timeout_s: float = 40.0
    fly_timeout_s: float = 60.0
    tune_timeout_s: float = 3.0
    arrive_m: float = 0.12
    arrive_rad: float = 0.08
    centred_px: float = 40.0
    still_m_s: float = 0.15
    picture_timeout_s: float = 3.0
    whole_picture_timeout_s: float = 15.0
    keyframe_m: float = 0.45
    keyframe_rad: float = 0.3
    grounded_timeout_s: float = 1800.0
    manual_speed_m_s: float = 0.4
    manual_turn_rad_s: float = 0.6
    manual_keep_s: float = 0.4
    replan_every_round: bool = False

    def __post_init__(self) -> None:
        for entry in fields(self):
            value = getattr(self, entry.name)
            if not isinstance(value, bool) and not value > 0:
                raise ValueError(f"mission.{entry.name} must be positive")
        if not self.manual_keep_s <= 1.0:
            raise ValueError("mission.manual_keep_s must be at most 1: silence is a hand let go")


@dataclass(frozen=True, slots=True)
class FlightConfig:
    """The config of everything that flies, handed down in pieces.

    Attributes:
        mission: This package's own.
        planner: Of ``server.planner``.
        vision: Of ``server.vision``.
        safety: Of ``server.swarm``.

    Raises:
        ValueError: If the planner would send drones to where a safety rule fires.
    """

    mission: MissionConfig
    planner: PlannerConfig
    vision: VisionConfig
    safety: SafetyConfig

    def __post_init__(self) -> None:
        safety = self.safety
        fault = margin_fault(
            self.planner,
            fence_radius_m=safety.fence_radius_m,
            floor_m=safety.floor_m,
            ceiling_m=safety.ceiling_m,
            standoff_m=max([safety.standoff_m, *safety.failsafes.standoff_m.values()]),
            separation_m=max(safety.failsafes.separation_m.values(), default=0.0),
            max_speed_m_s=safety.max_speed_m_s,
        )
        if fault is not None:
            raise ValueError(fault)
