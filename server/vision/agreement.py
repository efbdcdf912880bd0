"""Whether the drones' regions are of one object, and who looks at something else.

Two tests per view, both as wide as the believed poses are unsure:

1. epipolar: the rays through the boxes' centres must pass one common point. The point is sought by
   consensus, so that one wrong view of four cannot pull it: every pair of rays proposes its nearest
   point, and the one that most views pass, and pass most closely, wins;
2. size: at that point each box has a height in metres, which must be that of the others.

A box cut off by the picture's edge proves little: its centre is not the object's and its height is
a lower bound.

Symbols: ``o``, ``d`` origins and unit directions ``(n, 3)`` of the rays, world; misses in metres.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from server.stages import View
from server.vision.config import AgreementConfig

Array = NDArray[np.float64]
Kind = Literal["place", "size"]

# Rays nearer to parallel than this (the sine of their angle) propose no point.
_PARALLEL = 0.1
# No object is believed nearer to a camera than this, metres.
_NEAREST_M = 0.2


@dataclass(frozen=True, slots=True)
class Disagreement:
    """A view that shows something else than the others do.

    Attributes:
        drone_id: Whose view.
        index: The view's place in the sequence that was judged.
        kind: ``place``: its line of sight passes the object by; ``size``: its box is not as high.
        measured: By how much: metres past the common point, or the ratio of the heights.
        allowed: Up to where that would have been believed, in the same unit.
        text: The same in a sentence for the operator.
    """

    drone_id: str
    index: int
    kind: Kind
    measured: float
    allowed: float
    text: str


def disagreements(views: Sequence[View], config: AgreementConfig) -> list[Disagreement]:
    """Return which of ``views`` do not show the object that most of them show, in their order.

    Where no majority agrees (two views that look past one another, or two against two), every view
    is named, as none can be told to be right. Fewer than two views cannot disagree.
    """
    if len(views) < 2:
        return []
    o, d = _rays(views)
    point, agreeing = _common_point(views, o, d, config)
    if point is None:
        return [
            _no_common_place(view, k, o, d, config.gate * _sigma_m(view, None, config))
            for k, view in enumerate(views)
        ]
    found: list[Disagreement] = []
    heights = np.array([_height_m(view, point) for view in views])
    whole = np.array([not view.box.touches_edge for view in views])
    judges = agreeing & whole if (agreeing & whole).any() else agreeing
    height_m = float(np.median(heights[judges]))
    for k, view in enumerate(views):
        if not agreeing[k]:
            found.append(_elsewhere(view, k, _misses(point, o, d)[k], point, config))
        elif judges.sum() > 2:
            # With two heights nobody can tell which is wrong; the place agrees, and that must do.
            ratio, allowed = heights[k] / height_m, _allowed_ratio(view, point, config)
            if ratio > allowed or (ratio < 1.0 / allowed and whole[k]):
                found.append(_other_size(view, k, float(ratio), allowed))
    return found


def _rays(views: Sequence[View]) -> tuple[Array, Array]:
    """Return origins and unit directions ``(n, 3)`` of the rays through the boxes' centres."""
    origins = np.stack([view.pose.position_world for view in views])
    directions = [
        view.pose.T_world_cam[:3, :3] @ view.intrinsics.directions(view.box.centroid_px[None])[0]
        for view in views
    ]
    return origins, np.stack(directions)


def _common_point(
    views: Sequence[View], o: Array, d: Array, config: AgreementConfig
) -> tuple[Array | None, NDArray[np.bool_]]:
    """Return the point most rays pass and which do; None without a majority."""
    best: tuple[int, float, Array, NDArray[np.bool_]] | None = None
    for i, j in combinations(range(len(views)), 2):
        if np.linalg.norm(np.cross(d[i], d[j])) < _PARALLEL:
            continue
        point = nearest_point(o[[i, j]], d[[i, j]])
        agreeing, normal = _passing(views, point, o, d, config)
        if agreeing.sum() > 2:
            # A point of two rays alone is as unsure as they are: once more with all that agree.
            point = nearest_point(o[agreeing], d[agreeing])
            agreeing, normal = _passing(views, point, o, d, config)
        # Rays of opposite drones nearly coincide, and a third that looks elsewhere crosses them
        # somewhere, too; there the boxes' sizes do not fit one another.
        sizes = _size_misfits(views, point, agreeing, config)
        cost = float(np.minimum(normal, config.gate).sum() + np.minimum(sizes, config.gate).sum())
        if best is None or (int(agreeing.sum()), -cost) > (best[0], -best[1]):
            best = int(agreeing.sum()), cost, point, agreeing
    if best is None or best[0] < 2 or 2 * best[0] <= len(views):
        return None, np.zeros(len(views), bool)
    return best[2], best[3]


def _passing(
    views: Sequence[View], point: Array, o: Array, d: Array, config: AgreementConfig
) -> tuple[NDArray[np.bool_], Array]:
    """Return which rays pass ``point``, in front of the camera, and all misses in sigmas."""
    sigmas_m = np.array([_sigma_m(view, point, config) for view in views])
    normal = _misses(point, o, d) / sigmas_m
    in_front = ((point - o) * d).sum(axis=1) > _NEAREST_M
    return (normal <= config.gate) & in_front, normal


def _size_misfits(
    views: Sequence[View], point: Array, agreeing: NDArray[np.bool_], config: AgreementConfig
) -> Array:
    """Return in sigmas how far the agreeing views' heights of the object lie from their median."""
    judging = agreeing & np.array([not view.box.touches_edge for view in views])
    if not judging.any():
        return np.zeros(0)
    logs = np.log([_height_m(view, point) for view in views])[judging]
    allowed = np.log([_allowed_ratio(view, point, config) for view in views])[judging]
    return np.abs(logs - np.median(logs)) * config.gate / allowed


def nearest_point(o: Array, d: Array) -> Array:
    """Return the point ``(3,)`` with the least squared distance to all rays."""
    across = np.eye(3) - d[:, :, None] * d[:, None, :]
    A = across.sum(axis=0) + 1e-9 * np.eye(3)
    return np.linalg.solve(A, np.einsum("nij,nj->i", across, o))


def _misses(point: Array, o: Array, d: Array) -> Array:
    """Return the distances ``(n,)`` in metres at which the rays pass ``point``."""
    offset = point - o
    return np.linalg.norm(offset - (offset * d).sum(axis=1, keepdims=True) * d, axis=1)


def _depth_m(view: View, point: Array) -> float:
    T = view.pose.T_world_cam
    return max(float((point - T[:3, 3]) @ T[:3, 2]), _NEAREST_M)


def _sigma_m(view: View, point: Array | None, config: AgreementConfig) -> float:
    """Return how unsure the place of a view's ray is at ``point``, metres."""
    distance_m = config.distance_m if point is None else _depth_m(view, point)
    yaw_m = distance_m * float(np.sqrt(view.pose.covariance[3, 3]))
    extent_m = float(view.box.size_px.max()) / view.intrinsics.fx * distance_m
    share = config.cut_off_share if view.box.touches_edge else config.centroid_share
    parts = (view.pose.position_sigma_m, yaw_m, share * extent_m, config.floor_m)
    return float(np.linalg.norm(parts))


def _height_m(view: View, point: Array) -> float:
    return float(view.box.size_px[1]) / view.intrinsics.fy * _depth_m(view, point)


def _allowed_ratio(view: View, point: Array, config: AgreementConfig) -> float:
    """Return the ratio of heights up to which a box is of the same object."""
    distance = view.pose.position_sigma_m / _depth_m(view, point)
    return float(np.exp(config.gate * np.hypot(config.size_log_sigma, distance)))


# What the operator reads --------------------------------------------------------------------------


def _elsewhere(
    view: View, index: int, miss_m: float, point: Array, config: AgreementConfig
) -> Disagreement:
    allowed_m = config.gate * _sigma_m(view, point, config)
    text = f"It looks at another place: its line of sight passes the object by {miss_m:.2f} m."
    if miss_m <= allowed_m:
        text = "It looks at another place: the object of the others lies behind it."
    return Disagreement(view.pose.drone_id, index, "place", float(miss_m), allowed_m, text)


def _no_common_place(view: View, index: int, o: Array, d: Array, allowed_m: float) -> Disagreement:
    """Return what is said of one view when no majority looks at one place."""
    miss_m = float(_misses(nearest_point(o, d), o, d)[index])
    text = f"No majority of the drones looks at one place; this one is {miss_m:.2f} m off."
    return Disagreement(view.pose.drone_id, index, "place", miss_m, allowed_m, text)


def _other_size(view: View, index: int, ratio: float, allowed: float) -> Disagreement:
    what = f"{ratio:.1f} times as high as" if ratio > 1.0 else f"{1.0 / ratio:.1f} times lower than"
    text = f"Its region is not the others' object: it would be {what} theirs."
    return Disagreement(view.pose.drone_id, index, "size", ratio, allowed, text)
