"""Who takes which viewpoint in which round.

Every drone gets a sector of azimuths and goes through it in one direction, all drones in the same
one, so that their ways do not cross. What separation then still asks for is repaired by exchanging
viewpoints, and in the last resort by moving one of two viewpoints that are too close outwards.

Symbols: ``plan`` is an int array ``(rounds, drones)`` of indices into the viewpoints, -1 for none;
cylindrical coordinates are those of ``server.planner.paths``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from server.planner.config import FlightSpace
from server.planner.errors import PlanError
from server.planner.no_go import intrusion, space_about
from server.planner.paths import arc_length, arc_points, cylindrical, separation
from server.stages import Assignment, CameraPose, Viewpoint

Array = NDArray[np.float64]
Plan = NDArray[np.int64]

# One metre of missing separation weighs more than any way round the object.
_CONFLICT_COST = 1e3
_ARC_STEPS = 8
_REPAIR_EXCHANGES = 4
_PUSH_M = 0.05


def assign(
    viewpoints: Sequence[Viewpoint],
    drone_poses: Mapping[str, CameraPose],
    centre_world: Array,
    space: FlightSpace,
) -> Assignment:
    """Give every viewpoint to one drone in one round, with little travel and enough separation.

    Args:
        viewpoints: K poses; the last rounds miss a drone when K is no multiple of their number.
        drone_poses: Where the drones are now.
        centre_world: The object's centre ``(3,)``.
        space: Separation, downwash and fence.

    Returns:
        Rounds in flying order. A viewpoint that had to be moved to keep the separation keeps its
        azimuth and height.

    Raises:
        ValueError: Without drones or viewpoints.
        PlanError: If the viewpoints cannot be separated within the fence.
    """
    if not viewpoints or not drone_poses:
        raise ValueError("an assignment needs at least one drone and one viewpoint")
    drone_ids = list(drone_poses)
    starts = cylindrical(np.array([drone_poses[d].position_world for d in drone_ids]), centre_world)
    places = cylindrical(np.array([v.position_world for v in viewpoints]), centre_world)
    local = space_about(centre_world, space)
    plan = _best_sectors(places, starts, local)
    plan = _exchange_conflicts(plan, places, starts, local)
    places = _push_apart(plan, places, centre_world, space)
    _refuse_ways_through_no_go(plan, places, starts, local)
    rounds = []
    for row in plan:
        views = {}
        for drone_id, index in zip(drone_ids, row, strict=True):
            if index >= 0:
                views[drone_id] = _moved(viewpoints[index], places[index], centre_world)
        rounds.append(views)
    return Assignment(tuple(rounds))


def _best_sectors(places: Array, starts: Array, space: FlightSpace) -> Plan:
    """Try every cut of the circle into sectors in both directions; return the cheapest."""
    drones, count = len(starts), len(places)
    rounds = -(-count // drones)
    by_azimuth = np.argsort(places[:, 0], kind="stable")
    sizes = np.full(drones, rounds)
    sizes[count - drones * (rounds - 1) :] -= 1  # The last sectors have one viewpoint less.
    ends = np.cumsum(sizes)
    best, best_cost = np.full((rounds, drones), -1), np.inf
    # Turning a partition by a whole sector gives it again only when all are equally large.
    for cut in range(rounds if (sizes == rounds).all() else count):
        ring = np.roll(by_azimuth, -cut)
        sectors = [ring[end - size : end] for end, size in zip(ends, sizes, strict=True)]
        for direction in (1, -1):
            ordered = [sector[::direction] for sector in sectors]
            cost = np.array([[_travel(s, places[o]) for o in ordered] for s in starts])
            who, which = linear_sum_assignment(cost)
            plan = np.full((rounds, drones), -1)
            for drone, sector in zip(who, which, strict=True):
                plan[: sizes[sector], drone] = ordered[sector]
            total = cost[who, which].sum() + _CONFLICT_COST * _conflict(plan, places, starts, space)
            if total < best_cost:
                best, best_cost = plan, total
    return best


def _ways(stops: Array) -> Array:
    """Return points ``(steps, rounds, drones, 3)`` on the ways, about the object's vertical."""
    return arc_points(stops[:-1], stops[1:], _ARC_STEPS)


def _refuse_ways_through_no_go(
    plan: Plan, places: Array, starts: Array, space: FlightSpace
) -> None:
    points = _ways(_positions_by_round(plan, places, starts))
    # Whoever starts inside must be allowed to leave: of the first way only the end counts.
    if intrusion(points[:, 1:], space).any() or intrusion(points[-1, 0], space).any():
        raise PlanError("no order of the viewpoints keeps every way out of the no-go volumes")


def _travel(start: Array, stops: Array) -> float:
    """Return the length of the way from ``start`` ``(3,)`` through ``stops`` ``(n, 3)``."""
    way = np.concatenate([start[None], stops])
    return float(arc_length(way[:-1], way[1:]).sum())


def _positions_by_round(plan: Plan, places: Array, starts: Array) -> Array:
    """Return cylindrical places ``(rounds + 1, drones, 3)``; who has no viewpoint stays."""
    out = np.empty((len(plan) + 1, len(starts), 3))
    out[0] = starts
    for index, row in enumerate(plan):
        out[index + 1] = np.where((row >= 0)[:, None], places[row], out[index])
    return out


def _conflict(plan: Plan, places: Array, starts: Array, space: FlightSpace) -> float:
    """Return the metres of separation that are missing, in all rounds and on the ways to them.

    Ways through no-go volumes count like missing separation; ``space`` has them about the object.
    """
    drones = len(starts)
    points = _ways(_positions_by_round(plan, places, starts))
    entered = float(intrusion(points, space).max(axis=0).sum()) if space.no_go else 0.0
    if drones < 2:
        return entered
    first, second = np.triu_indices(drones, 1)
    apart = separation(points[:, :, first], points[:, :, second], space.downwash_factor)
    # Drones that start too close are not the plan's fault: of the first way only the end counts.
    apart[:-1, 0] = np.maximum(apart[:-1, 0], space.separation_m)
    return entered + float(np.maximum(0.0, space.separation_m - apart).max(axis=0).sum())


def _exchange_conflicts(plan: Plan, places: Array, starts: Array, space: FlightSpace) -> Plan:
    """Exchange two viewpoints at a time while that removes conflicts, least travel first."""

    def cost(candidate: Plan) -> tuple[float, float]:
        stops = _positions_by_round(candidate, places, starts)
        travel = float(arc_length(stops[:-1], stops[1:]).sum())
        return _conflict(candidate, places, starts, space), travel

    current = cost(plan)
    cells = [tuple(cell) for cell in np.argwhere(plan >= 0)]
    for _ in range(_REPAIR_EXCHANGES):
        if current[0] <= 1e-9:
            break
        best, best_plan = current, plan
        for i, a in enumerate(cells):
            for b in cells[i + 1 :]:
                trial = plan.copy()
                trial[a], trial[b] = plan[b], plan[a]
                value = cost(trial)
                if value[0] < best[0] - 1e-9 or (value[0] < best[0] + 1e-9 and value[1] < best[1]):
                    best, best_plan = value, trial
        if best_plan is plan:
            break
        current, plan = best, best_plan
    return plan


def _push_apart(plan: Plan, places: Array, centre: Array, space: FlightSpace) -> Array:
    """Return the places with the outer one of every pair that is too close moved outwards."""
    places = places.copy()
    limit = space.fence_radius_m
    for _ in range(1000):
        pair = _closest_in_round(plan, places, space)
        if pair is None:
            return places
        outer, inner = sorted(pair, key=lambda index: -places[index, 1])
        for index in (outer, inner):
            pushed = places[index] + np.array([0.0, _PUSH_M, 0.0])
            if np.hypot(*(_cartesian(pushed, centre)[:2])) <= limit:
                places[index] = pushed
                break
        else:
            break
    raise PlanError(
        f"viewpoints of one round cannot be kept {space.separation_m:.2f} m apart inside the "
        f"fence ({limit:.2f} m)"
    )


def _closest_in_round(plan: Plan, places: Array, space: FlightSpace) -> tuple[int, int] | None:
    """Return two viewpoints of one round that are too close, or None."""
    # Who has no viewpoint in a round stays at the one before.
    standing = plan[0].copy()
    for row in plan:
        standing = np.where(row >= 0, row, standing)
        here = standing[standing >= 0]
        points = _cartesian(places[here], np.zeros(3))
        apart = separation(points[:, None], points[None], space.downwash_factor)
        np.fill_diagonal(apart, np.inf)
        if len(here) > 1 and apart.min() < space.separation_m - 1e-9:
            i, j = np.unravel_index(int(apart.argmin()), apart.shape)
            return int(here[i]), int(here[j])
    return None


def _cartesian(places: Array, centre: Array) -> Array:
    """Return positions ``(..., 3)`` of cylindrical ``places`` ``(..., 3)`` about ``centre``."""
    return np.stack(
        [
            centre[0] + places[..., 1] * np.cos(places[..., 0]),
            centre[1] + places[..., 1] * np.sin(places[..., 0]),
            places[..., 2],
        ],
        axis=-1,
    )


def _moved(viewpoint: Viewpoint, place: Array, centre: Array) -> Viewpoint:
    """Return ``viewpoint`` at the cylindrical ``place``; itself when it has not moved."""
    position = _cartesian(place, centre)
    if np.allclose(position, viewpoint.position_world, atol=1e-9):
        return viewpoint
    return Viewpoint(position, viewpoint.yaw_rad)
