"""What drones leave behind is shared out among the others; nothing is lost, nothing done twice."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from server.geometry.poses import camera_pose
from server.mission.takeover import orphans, share_out
from server.planner.config import FlightSpace
from server.stages import Assignment, CameraPose, Viewpoint

SPACE = FlightSpace()
CENTRE = np.array([0.0, 0.0, 0.5])
DRONES = ["a", "b", "c", "d"]


def view(azimuth_deg: float) -> Viewpoint:
    azimuth = np.deg2rad(azimuth_deg)
    place = np.array([2.0 * np.cos(azimuth), 2.0 * np.sin(azimuth), 1.0])
    return Viewpoint(place, azimuth + np.pi)


def ring(rounds: int) -> Assignment:
    step = 360.0 / (len(DRONES) * rounds)
    return Assignment(
        tuple({d: view(90.0 * i + step * r) for i, d in enumerate(DRONES)} for r in range(rounds))
    )


def poses(flying: list[str], plan: Assignment, at_round: int) -> dict[str, CameraPose]:
    return {
        d: CameraPose(
            d,
            0.0,
            camera_pose(plan.rounds[at_round][d].position_world, 0.0, 0.2),
            0.01 * np.eye(4),
        )
        for d in flying
    }


def azimuths(views: list[Viewpoint]) -> list[float]:
    return sorted(
        round(float(np.arctan2(v.position_world[1], v.position_world[0])), 3) for v in views
    )


def test_nothing_is_orphaned_while_all_fly_and_all_pictures_are_clean() -> None:
    assert orphans(ring(3), 1, set(DRONES), DRONES) == []


def test_a_missed_picture_and_a_lost_drone_leave_viewpoints() -> None:
    plan = ring(3)
    left = orphans(plan, 1, {"a", "b"}, ["a", "b", "c"])
    # Round 1 of c (missed) and d (lost), rounds 2 and 3 of d.
    expected = [plan.rounds[0]["c"], *(plan.rounds[r]["d"] for r in range(3))]
    assert azimuths(left) == azimuths(expected)


@given(
    lost=st.sets(st.sampled_from(DRONES), min_size=1, max_size=3),
    next_round=st.integers(1, 3),
    rounds=st.integers(3, 6),
)
def test_the_others_take_over_everything_that_is_left(
    lost: set[str], next_round: int, rounds: int
) -> None:
    plan = ring(rounds)
    flying = [d for d in DRONES if d not in lost]
    left = orphans(plan, next_round, set(flying), flying)
    after, given_up = share_out(
        plan, next_round, left, poses(flying, plan, next_round - 1), CENTRE, SPACE
    )
    assert after.rounds[:next_round] == plan.rounds[:next_round]
    rest = [v for row in after.rounds[next_round:] for v in row.values()]
    assert all(set(row) <= set(flying) for row in after.rounds[next_round:])
    own = [v for row in plan.rounds[next_round:] for d, v in row.items() if d in flying]
    assert len(rest) == len(own) + len(left) - given_up
    assert given_up == 0
    assert azimuths(rest) == pytest.approx(azimuths(own + left), abs=2e-3)
