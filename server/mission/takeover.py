"""Sharing out anew what is left to be photographed, after drones dropped out or came back. Pure."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np

from server.planner.assignment import assign
from server.planner.config import FlightSpace
from server.planner.errors import PlanError
from server.stages import Assignment, CameraPose, Viewpoint


def orphans(
    assignment: Assignment, next_round: int, taken: Collection[str], flying: Collection[str]
) -> list[Viewpoint]:
    """Return the viewpoints that nobody will go to.

    Args:
        assignment: Who was to go where.
        next_round: Rounds before it are over, the last of them just now.
        taken: The drones whose picture of the last round is on disk.
        flying: The drones that still fly.
    """
    left = []
    if next_round > 0:
        row = assignment.rounds[next_round - 1]
        left += [view for drone_id, view in row.items() if drone_id not in taken]
    for row in assignment.rounds[next_round:]:
        left += [view for drone_id, view in row.items() if drone_id not in flying]
    return left


def share_out(
    assignment: Assignment,
    next_round: int,
    orphaned: list[Viewpoint],
    poses: Mapping[str, CameraPose],
    centre_world: np.ndarray,
    space: FlightSpace,
) -> tuple[Assignment, int]:
    """Return the assignment with everything that is left shared out among the drones that fly.

    Args:
        assignment: As planned; its first ``next_round`` rounds stay.
        next_round: The first round to share out.
        orphaned: Viewpoints of nobody, see ``orphans``.
        poses: Believed poses of the drones that fly.
        centre_world: The object's centre ``(3,)``.
        space: Separation, downwash and fence.

    Returns:
        The new assignment, and how many viewpoints had to be given up because the drones could not
        be kept apart at them.
    """
    rows = assignment.rounds[next_round:]
    own = [view for row in rows for drone_id, view in row.items() if drone_id in poses]
    before = assignment.rounds[:next_round]
    # Without the orphans the rest is a part of a plan that was good.
    kept = tuple({d: v for d, v in row.items() if d in poses} for row in rows)
    for given_up in range(len(orphaned) + 1):
        wanted = own + orphaned[: len(orphaned) - given_up]
        if not wanted:
            break
        try:
            after = assign(wanted, poses, centre_world, space).rounds
        except PlanError:
            continue
        return Assignment(before + after), given_up
    return Assignment(before + tuple(row for row in kept if row)), len(orphaned)
