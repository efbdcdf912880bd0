"""Whether the planner's room lies inside the safety limits; a line that says why not."""

from __future__ import annotations

from dataclasses import replace

from server.planner.config import FlightSpace, PlannerConfig

# What a believed pose may be wrong by, and what a drone needs to stop in.
_ROOM_M = 0.5
_ROOM_TO_FLOOR_M = 0.2
_ROOM_TO_OBJECT_M = 0.3


def space_within(
    space: FlightSpace,
    *,
    fence_radius_m: float,
    floor_m: float,
    ceiling_m: float,
    standoff_m: float,
) -> FlightSpace:
    """Return ``space`` drawn in so far that it lies inside the safety limits with room to spare.

    Args:
        space: The room as configured.
        fence_radius_m: Safety limit of the distance from the world's z axis.
        floor_m: Safety limit of the height, below.
        ceiling_m: Safety limit of the height, above.
        standoff_m: Safety limit of the distance to the object's box and to no-go volumes.

    Raises:
        ValueError: If no room is left.
    """
    return replace(
        space,
        fence_radius_m=min(space.fence_radius_m, fence_radius_m - _ROOM_M),
        floor_m=max(space.floor_m, floor_m + _ROOM_TO_FLOOR_M),
        ceiling_m=min(space.ceiling_m, ceiling_m - _ROOM_M),
        standoff_m=max(space.standoff_m, standoff_m + _ROOM_TO_OBJECT_M),
        no_go_clearance_m=max(space.no_go_clearance_m, standoff_m + _ROOM_TO_OBJECT_M),
    )


def margin_fault(
    config: PlannerConfig,
    *,
    fence_radius_m: float,
    floor_m: float,
    ceiling_m: float,
    standoff_m: float,
    separation_m: float,
    max_speed_m_s: float,
    margin_m: float = 0.1,
) -> str | None:
    """Return in one line what is wrong with the planner's room, None when all of it is inside.

    A drone that the planner sends to the edge of its room must not set off a safety rule there,
    although its pose is uncertain: each limit needs ``margin_m`` between the two.

    Args:
        config: The planner's room and avoidance.
        fence_radius_m: Safety limit of the distance from the world's z axis.
        floor_m: Safety limit of the height, below.
        ceiling_m: Safety limit of the height, above.
        standoff_m: Safety limit of the distance to the object's box and to no-go volumes.
        separation_m: Distance between two drones at which a safety rule fires.
        max_speed_m_s: Fastest setpoint that the safety rules let through.
        margin_m: Least margin of each.
    """
    space, avoidance = config.space, config.avoidance
    kept_m = 2.0 * avoidance.radius_m
    # (what, the planner's value, the safety limit, how far inside it is)
    margins = (
        ("space.fence_radius_m", space.fence_radius_m, fence_radius_m, 1.0),
        ("space.ceiling_m", space.ceiling_m, ceiling_m, 1.0),
        ("space.floor_m", space.floor_m, floor_m, -1.0),
        ("space.standoff_m", space.standoff_m, standoff_m, -1.0),
        ("twice avoidance.radius_m", kept_m, separation_m, -1.0),
    )
    faults = [
        f"{name} is {value:g} m, must be at {'most' if sign > 0 else 'least'} "
        f"{limit - sign * margin_m:g} m (safety limit {limit:g} m, margin {margin_m:g} m)"
        for name, value, limit, sign in margins
        if sign * (limit - value) < margin_m - 1e-9
    ]
    for name, speed in (
        ("avoidance.speed_max_m_s", avoidance.speed_max_m_s),
        ("tracking.travel_speed_m_s", config.tracking.travel_speed_m_s),
    ):
        if speed > max_speed_m_s + 1e-9:
            faults.append(
                f"{name} is {speed:g} m/s, must be at most {max_speed_m_s:g} m/s (safety limit)"
            )
    return "planner: " + "; ".join(faults) if faults else None
