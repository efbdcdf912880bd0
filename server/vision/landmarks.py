"""Landmarks of the pose filter: corners of the scene, each at an unknown distance.

What was first seen in the same picture hangs on the same anchor: the pose from which that picture
was taken. A landmark is then one number, its inverse distance from the anchor along the direction
in which it was seen (Civera, Davison and Montiel, "Inverse depth parametrization for monocular
SLAM", IEEE T-RO 2008), which takes what is far away as well as what is near.

An anchor's part of the filter's state, 6 + n numbers:

    p (3)    its camera centre, world metres
    phi (3)  error of its attitude, rad, world axes; folded into ``R_world_cam`` at once
    rho (n)  inverse distances, 1/m
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from server.geometry.axes import rotation_about

Array = NDArray[np.float64]
Rows = NDArray[np.int64]

_POSE = 6
# Nearer to the camera's plane than this share of its distance nothing is seen.
_BEHIND = 0.1
# A camera has moved when it did so by this many standard deviations.
_SURELY = 4.0
_NONE = np.zeros(0, np.int64)


@dataclass(slots=True, eq=False)
class Anchor:
    """A pose from which landmarks were first seen.

    Attributes:
        at: Where its part of the state begins.
        R_world_cam: Its attitude ``(3, 3)``.
        numbers: Its landmarks' ``(n,)``.
        bearings: Unit directions ``(n, 3)`` in which it saw them, its own camera frame.
    """

    at: int
    R_world_cam: Array
    numbers: NDArray[np.int64]
    bearings: Array

    @property
    def size(self) -> int:
        """Length of its part of the state."""
        return _POSE + len(self.numbers)

    @property
    def rays(self) -> Array:
        """Its bearings ``(n, 3)`` in world axes."""
        return self.bearings @ self.R_world_cam.T

    @property
    def rows(self) -> Rows:
        """Where in the state its inverse distances ``(n,)`` are."""
        return np.arange(self.at + _POSE, self.at + self.size)


@dataclass(frozen=True, slots=True, eq=False)
class Expected:
    """What a camera should see of the landmarks.

    Attributes:
        numbers: Which of the features asked for are landmarks in front of it ``(k,)``.
        tangents: Where ``(k, 2)``, right and down.
        by_position: Derivatives ``(k, 2, 3)`` by the camera's centre.
        by_attitude: By a small turn of the camera ``(k, 2, 3)``, world axes.
        by_map: By the whole state ``(k, 2, size)``, camera left out.
    """

    numbers: NDArray[np.int64]
    tangents: Array
    by_position: Array
    by_attitude: Array
    by_map: Array


class LandmarkMap:
    """Which part of the filter's state means what; numbers themselves stay in the filter."""

    def __init__(self, begin: int) -> None:
        """Build an empty one whose part of the state begins at ``begin``."""
        self._begin = begin
        self.anchors: list[Anchor] = []

    @property
    def numbers(self) -> NDArray[np.int64]:
        """All landmarks' ``(n,)``."""
        return np.concatenate([_NONE, *(anchor.numbers for anchor in self.anchors)])

    def add(self, R_world_cam: Array, numbers: NDArray[np.int64], bearings: Array) -> None:
        """Append an anchor; the caller appends ``6 + n`` numbers to the state."""
        at = self._begin + sum(anchor.size for anchor in self.anchors)
        self.anchors.append(Anchor(at, R_world_cam, numbers, bearings))

    def keep(self, numbers: NDArray[np.int64]) -> Rows:
        """Forget all landmarks but ``numbers``, and anchors that lose their last.

        Returns:
            The rows of the state that are left, those before the map included.
        """
        rows = [np.arange(self._begin)]
        left, at = list[Anchor](), self._begin
        for anchor in self.anchors:
            kept = np.flatnonzero(np.isin(anchor.numbers, numbers))
            if not len(kept):
                continue
            rows += [np.arange(anchor.at, anchor.at + _POSE), anchor.at + _POSE + kept]
            anchor = Anchor(at, anchor.R_world_cam, anchor.numbers[kept], anchor.bearings[kept])
            left.append(anchor)
            at += anchor.size
        self.anchors = left
        return np.concatenate(rows)

    def fold(self, x: Array) -> None:
        """Turn the anchors by the attitude errors in state ``x`` and set these to zero."""
        for anchor in self.anchors:
            phi = slice(anchor.at + 3, anchor.at + _POSE)
            anchor.R_world_cam = rotation_about(x[phi]) @ anchor.R_world_cam
            x[phi] = 0.0

    def too_near(self, x: Array, cov: Array, position: Array) -> Rows:
        """Return the rows of inverse distances that nothing should be learned of yet.

        A camera that has hardly moved from an anchor sees landmarks shift by noise. Taken for the
        effect of a movement that is itself noise, this would draw them ever farther away, and
        what is believed to be far makes later movements seem longer than they are.

        Args:
            x: The filter's state.
            cov: Its covariance.
            position: Camera centre ``(3,)``, world metres.
        """
        rows = [_NONE]
        for anchor in self.anchors:
            place = slice(anchor.at, anchor.at + 3)
            moved_m = float(np.linalg.norm(position - x[place]))
            apart = cov[:3, :3] - cov[:3, place] - cov[place, :3] + cov[place, place]
            if moved_m < _SURELY * np.sqrt(np.linalg.eigvalsh(apart)[-1]):
                rows.append(anchor.rows)
        return np.concatenate(rows)

    def expected(
        self, x: Array, numbers: NDArray[np.int64], position: Array, R_world_cam: Array
    ) -> Expected:
        """Return what a camera should see.

        Args:
            x: The filter's state.
            numbers: Features ``(m,)`` that were seen, in rising order.
            position: Camera centre ``(3,)``, world metres.
            R_world_cam: Its attitude ``(3, 3)``.
        """
        _, seen, mine = np.intersect1d(numbers, self.numbers, return_indices=True)
        # Per landmark seen: its direction from its anchor, world axes, and its place in the state.
        rays = np.concatenate([np.zeros((0, 3)), *(a.rays for a in self.anchors)])[mine]
        at = np.concatenate([_NONE, *(np.full(len(a.numbers), a.at) for a in self.anchors)])[mine]
        rows = np.concatenate([_NONE, *(a.rows for a in self.anchors)])[mine]
        rho, from_camera = x[rows], x[at[:, None] + np.arange(3)] - position
        # The way to the landmark, times its inverse distance from the anchor.
        way = rho[:, None] * from_camera + rays
        in_camera = way @ R_world_cam
        front = in_camera[:, 2] > _BEHIND
        if not front.all():
            return self.expected(x, numbers[seen[front]], position, R_world_cam)
        tangents = in_camera[:, :2] / in_camera[:, 2:]
        by_way = np.zeros((len(way), 2, 3))
        by_way[:, 0, 0] = by_way[:, 1, 1] = 1.0
        by_way[:, :, 2] = -tangents
        by_way = (by_way / in_camera[:, 2, None, None]) @ R_world_cam.T
        by_map, each = np.zeros((len(way), 2, len(x))), np.arange(len(way))
        by_turn = -by_way @ _cross_matrices(rays)
        for axis in range(3):
            by_map[each, :, at + axis] = by_way[:, :, axis] * rho[:, None]
            by_map[each, :, at + 3 + axis] = by_turn[:, :, axis]
        by_map[each, :, rows] = (by_way @ from_camera[:, :, None])[:, :, 0]
        return Expected(
            numbers=numbers[seen],
            tangents=tangents,
            by_position=-by_way * rho[:, None, None],
            by_attitude=by_way @ _cross_matrices(way),
            by_map=by_map,
        )


def _cross_matrices(vectors: Array) -> Array:
    """Return for ``(n, 3)`` the matrices ``(n, 3, 3)`` with ``M @ v = vector x v``."""
    x, y, z = vectors.T
    none = np.zeros_like(x)
    rows = [[none, -z, y], [z, none, -x], [-y, x, none]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=1)
