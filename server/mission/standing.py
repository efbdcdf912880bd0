"""Whether a drone that reports to stand really stands: what it sees must stand still as well. Pure.

A Tello holds its place by its downward camera. Where that finds nothing to hold on to, the drone
reports no velocity and drifts; as long as it is told to hover nothing else in its reports tells.
Its pictures do: the object becomes smaller or larger, or leaves for one side, little by little. A
search that shows now a part of the object, now all of it, makes steps instead: they are no drift.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np
from numpy.typing import NDArray

from server.geometry.axes import wrap_angle
from server.geometry.cameras import Intrinsics
from server.stages import Box

# So long a time is looked at, and so many boxes must be in it.
_WINDOW_S = 5.0
_LEAST_BOXES = 15
# From the window's first third to its last a drone that reports to stand may move by this much: its
# report rounds to 0.1 m/s. And so much must the log of the apparent height, or the bearing in
# radians, change in any case to be told from the boxes' own errors.
_UNREPORTED_M = 0.4
_LEAST_CHANGE = 0.2
# In the middle of the window a drift has made at least this share of its way, and as much is left.
_STEADY_SHARE = 0.25
# Of the boxes meanwhile so large a share is neither where it began nor where it ended, to within
# this share of the way.
_MOST, _EDGE_SHARE = 0.6, 0.15
# It exceeds the boxes' own scatter about the thirds of the window by this factor.
_CLEAR = 3.0


class StandingWatch:
    """What a drone has seen since it reports to stand."""

    def __init__(self) -> None:
        self._seen: deque[tuple[float, float, float]] = deque()

    def reset(self) -> None:
        """Begin anew: the drone reports that it moves, or another flight begins."""
        self._seen.clear()

    def observe(self, box: Box, at_s: float, yaw_rad: float, camera: Intrinsics) -> None:
        """Take a box of the picture at ``at_s``, seen while the drone reports to stand.

        Args:
            box: The object's box; one that the picture's edge cuts says nothing.
            at_s: When the picture was taken.
            yaw_rad: The drone's reported heading.
            camera: Its camera.
        """
        if box.touches_edge:
            return
        corners = np.stack([box.xyxy_px[:2], box.xyxy_px[2:], box.centroid_px])
        directions = camera.directions(corners)
        tangents = directions[:, :2] / directions[:, 2:]
        height = max(float(tangents[1, 1] - tangents[0, 1]), 1e-4)
        bearing = yaw_rad - math.atan(float(tangents[2, 0]))
        if self._seen:  # Continuous over the half turn.
            before = self._seen[-1][2]
            bearing = before + wrap_angle(bearing - before)
        self._seen.append((at_s, math.log(height), bearing))
        while self._seen[0][0] < at_s - _WINDOW_S:
            self._seen.popleft()

    def drifts_since_s(self, distance_m: float) -> float | None:
        """Return since when the drone drifts though it reports to stand, None if it does not.

        Args:
            distance_m: How far the object is believed to be.
        """
        if len(self._seen) < _LEAST_BOXES:
            return None
        seen = np.array(self._seen)
        times, heights, bearings = seen.T
        if times[-1] - times[0] < 0.9 * _WINDOW_S:
            return None
        third = np.minimum((3.0 * (times - times[0]) / (times[-1] - times[0])).astype(int), 2)
        if min(np.bincount(third, minlength=3)) < _LEAST_BOXES // 5:
            return None
        least = max(_LEAST_CHANGE, _UNREPORTED_M / max(distance_m, 0.5))
        drifts = _drifts(heights, third, least) or _drifts(bearings, third, least)
        return float(times[0]) if drifts else None


def _drifts(values: NDArray[np.float64], third: NDArray[np.intp], least: float) -> bool:
    """Return whether values went one way, all through the three thirds of the window."""
    first, middle, last = (float(np.median(values[third == k])) for k in range(3))
    change = last - first
    if abs(change) < least:
        return False
    if not _STEADY_SHARE <= (middle - first) / change <= 1.0 - _STEADY_SHARE:
        return False
    on_the_way = (values[third == 1] - first) / change
    if np.mean((on_the_way > _EDGE_SHARE) & (on_the_way < 1.0 - _EDGE_SHARE)) < _MOST:
        return False  # A step: either here or there, nothing between.
    scatter = float(np.median(np.abs(values - np.array([first, middle, last])[third])))
    return abs(change) > _CLEAR * scatter
