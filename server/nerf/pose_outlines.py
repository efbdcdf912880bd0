"""Poses from outlines: what is left where pictures have too little texture to share points.

The masks of the object are silhouettes of one shape. With poses that are wrong by decimetres they
contradict each other; here shape and poses are brought to agree by turns (Hernandez, Schmitt and
Cipolla, "Silhouette coherence for camera calibration under circular motion", 2007, do the same for
turntables):

1. the shape is what enough of the silhouettes hold to be the object, each place with one vote per
   picture; how many are enough is chosen by how well the shape's own silhouettes match the masks;
2. each camera is moved until the rim of the shape lies on the outline of its mask, by least squares
   held by what was believed before, with outlines known to a few pixels.

An outline tells well where a camera looks and how far off it stands, and badly from which side: a
round object looks alike from everywhere. What it does not tell stays as it was believed, and the
standard deviations say so.

Symbols: ``n`` pictures, ``m`` places. Masks are worked on at ``_SHRINK`` of their size.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.spatial.transform import Rotation

from server.geometry.cameras import Intrinsics, whole_pixels
from server.nerf.pose_config import PoseConfig

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_SHRINK = 0.25
_CELLS = 56
_ROUNDS, _STEPS = 6, 3
_FEWEST = 4
# A mask smaller than this, or that reaches this near to the picture's edge, is no whole silhouette.
_LEAST_PX, _EDGE_PX = 40, 2
# Shares of the votes that may be asked for.
_AGREEMENTS = np.arange(0.5, 1.01, 0.1)
# The space looked at is larger than the object appears by this factor.
_ROOM = 1.6
# Neighbouring points of an outline are wrong alike: an outline counts as so many that are not.
_INDEPENDENT = 12
_LEAST_RIM = 24
# Nearer cameras see a shape with holes.
_WIDEST_CELL_PX = 15
# A mask that has less in common with the shape's silhouette is of something else.
_LEAST_MATCH = 0.4


@dataclass(frozen=True, slots=True, eq=False)
class OutlinedPoses:
    """What outlines say about poses.

    Attributes:
        T_world_cam: Poses ``(n, 4, 4)``; those that were not fitted are as they came.
        fitted: Which were moved ``(n,)``.
        sigma_m: How well each position is known ``(n,)``, metres per axis.
        sigma_rad: How well each rotation is known ``(n,)``, radians per axis.
        match: Intersection over union of each mask and the shape's silhouette ``(n,)``, NaN where
            there is no whole mask.
    """

    T_world_cam: Array
    fitted: NDArray[np.bool_]
    sigma_m: Array
    sigma_rad: Array
    match: Array


@dataclass(frozen=True, slots=True, eq=False)
class _Silhouette:
    """One mask, reduced.

    Attributes:
        mask: The object ``(h, w)``.
        beyond_px: ``(h, w)`` distance from the outline, positive outside.
        slope: ``(2, h, w)`` its derivatives along x and y.
        camera: Of the reduced picture.
    """

    mask: Mask
    beyond_px: Array
    slope: Array
    camera: Intrinsics

    def at(self, pixels: Array) -> tuple[Array, Array]:
        """Return distance ``(k,)`` and slope ``(k, 2)`` at ``pixels``, clamped to the picture."""
        x, y = pixels.T.astype(np.float32)
        fields = (self.beyond_px, *self.slope)
        read = [
            cv2.remap(f.astype(np.float32), x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            for f in fields
        ]
        distance, slope_x, slope_y = (np.asarray(values, float).ravel() for values in read)
        return distance, np.stack([slope_x, slope_y], axis=1)


@dataclass(frozen=True, slots=True, eq=False)
class _Shape:
    """Places held to be the object, those within left out.

    Attributes:
        points_world: ``(m, 3)`` their centres.
        cell_m: Distance between neighbours.
    """

    points_world: Array
    cell_m: float


def fit_to_outlines(
    T_world_cam: Array,
    cameras: Sequence[Intrinsics],
    masks: Sequence[Mask | None],
    sigma_m: Array,
    sigma_rad: Array,
    known: NDArray[np.bool_],
    config: PoseConfig,
    on_progress: Callable[[float], None],
) -> OutlinedPoses:
    """Move cameras until the object's outlines agree on one shape.

    Args:
        T_world_cam: Believed poses ``(n, 4, 4)``.
        cameras: Of each picture.
        masks: Of each picture ``(h, w)``, None where there is none.
        sigma_m: Standard deviation of the believed positions ``(n,)``, metres per axis.
        sigma_rad: The same of the headings ``(n,)``, radians.
        known: Poses that need no outline ``(n,)``: they take part, but stay.
        config: ``outline_sigma_px`` and ``tilt_sigma_rad``.
        on_progress: Told the share that is done.

    Returns:
        The poses. None are fitted when fewer than four pictures show the object whole, or when
        their outlines have no shape in common; a picture whose mask is of something else is not.
    """
    poses, matches = T_world_cam.copy(), np.full(len(cameras), np.nan)
    fitted = np.zeros(len(cameras), bool)
    sigma_m, sigma_rad = sigma_m.copy(), sigma_rad.copy()
    seen = {
        i: silhouette
        for i, (mask, camera) in enumerate(zip(masks, cameras, strict=True))
        if mask is not None and (silhouette := _silhouette(mask, camera)) is not None
    }
    unmoved = OutlinedPoses(poses, fitted, sigma_m, sigma_rad, matches)
    if len(seen) < _FEWEST:
        return unmoved
    fits = {i: _Fit(T_world_cam[i], sigma_m[i], sigma_rad[i], config) for i in seen}
    shape: _Shape | None = None
    for number in range(_ROUNDS):
        on_progress(number / _ROUNDS)
        shape = _common_shape(seen, poses)
        if shape is None:
            return unmoved
        for i in seen:
            if not known[i]:
                fits[i].bring(shape, seen[i])
        # All at once, after the last has looked at the shape: their order means nothing.
        poses = poses.copy()
        for i in seen:
            if not known[i]:
                poses[i] = fits[i].T_world_cam
    on_progress(1.0)
    assert shape is not None
    for i in seen:
        matches[i] = _match(seen[i].mask, _drawn(shape, poses[i], seen[i].camera)[0])
        spread = fits[i].sigma
        if known[i]:
            continue
        if spread is None or matches[i] < _LEAST_MATCH:
            poses[i] = T_world_cam[i]
        else:
            fitted[i] = True
            sigma_m[i], sigma_rad[i] = spread
    return OutlinedPoses(poses, fitted, sigma_m, sigma_rad, matches)


def _silhouette(mask: Mask, camera: Intrinsics) -> _Silhouette | None:
    """Return the reduced mask, None when it does not show the object whole."""
    small_camera = camera.scaled(_SHRINK)
    size = (small_camera.width, small_camera.height)
    small = cv2.resize(mask.astype(np.float32), size, interpolation=cv2.INTER_AREA) >= 0.5
    # One object: specks are none.
    count, labels, stats, _ = cv2.connectedComponentsWithStats(small.astype(np.uint8))
    if count < 2:
        return None
    largest = 1 + int(stats[1:, cv2.CC_STAT_AREA].argmax())
    small = labels == largest
    rows, columns = np.flatnonzero(small.any(axis=1)), np.flatnonzero(small.any(axis=0))
    room = min(rows[0], columns[0], size[1] - 1 - rows[-1], size[0] - 1 - columns[-1])
    if small.sum() < _LEAST_PX or room < _EDGE_PX:
        return None
    inside = cv2.distanceTransform(small.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    outside = cv2.distanceTransform((~small).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    # The outline runs between the pixels: half a pixel from the centres on either side.
    beyond = np.where(small, 0.5 - inside, outside - 0.5).astype(float)
    slope_y, slope_x = np.gradient(beyond)
    return _Silhouette(small, beyond, np.stack([slope_x, slope_y]), small_camera)


def _common_shape(seen: dict[int, _Silhouette], poses: Array) -> _Shape | None:
    """Return the shape that most silhouettes hold, None when they have none in common."""
    centre, half_m = _middle(seen, poses)
    axis = (np.arange(_CELLS) + 0.5) / _CELLS * 2.0 - 1.0
    grid = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    points = centre + half_m * grid
    votes = np.zeros(len(points), np.int16)
    for i, silhouette in seen.items():
        pixels, depths = silhouette.camera.project(points, poses[i])
        u, v = whole_pixels(pixels).T
        height, width = silhouette.mask.shape
        shown = (depths > 0) & (u >= 0) & (u < width) & (v >= 0) & (v < height)
        votes[shown] += silhouette.mask[v[shown], u[shown]]
    best, best_match = None, 0.0
    for share in _AGREEMENTS:
        held = (votes >= np.ceil(share * len(seen) - 1e-9)).reshape((_CELLS,) * 3)
        if not held.any():
            break
        # What lies inside is never seen.
        inner: Mask = np.asarray(ndimage.binary_erosion(held), bool)
        skin = (held & ~inner).reshape(-1)
        shape = _Shape(points[skin], 2.0 * half_m / _CELLS)
        drawn = (_drawn(shape, poses[i], s.camera)[0] for i, s in seen.items())
        matches = [_match(s.mask, d) for s, d in zip(seen.values(), drawn, strict=True)]
        match = float(np.median(matches))
        if match > best_match:
            best, best_match = shape, match
    return best


def _middle(seen: dict[int, _Silhouette], poses: Array) -> tuple[Array, float]:
    """Return the point nearest to all rays through the masks' middles, and the reach around it."""
    A, b, sizes = np.zeros((3, 3)), np.zeros(3), []
    for i, silhouette in seen.items():
        v, u = np.nonzero(silhouette.mask)
        middle = np.array([[(u.min() + u.max()) / 2.0, (v.min() + v.max()) / 2.0]])
        ray = poses[i, :3, :3] @ silhouette.camera.directions(middle)[0]
        across = np.eye(3) - np.outer(ray, ray)
        A += across
        b += across @ poses[i, :3, 3]
        extent_px = max(np.ptp(u), np.ptp(v)) + 1
        sizes.append((extent_px / silhouette.camera.fx, poses[i, :3, 3]))
    centre = np.asarray(np.linalg.lstsq(A, b, rcond=None)[0], float)
    reaches = [share * float(np.linalg.norm(position - centre)) for share, position in sizes]
    return centre, _ROOM * max(reaches) / 2.0


def _drawn(shape: _Shape, T_world_cam: Array, camera: Intrinsics) -> tuple[Mask, NDArray[np.int64]]:
    """Return the shape's silhouette ``(h, w)`` and which place each pixel shows, -1 for none."""
    pixels, depths = camera.project(shape.points_world, T_world_cam)
    u, v = whole_pixels(pixels).T
    shown = (depths > 0) & (u >= 0) & (u < camera.width) & (v >= 0) & (v < camera.height)
    places = np.full((camera.height, camera.width), -1, np.int64)
    if not shown.any():
        return np.zeros(places.shape, bool), places
    places[v[shown], u[shown]] = np.flatnonzero(shown)
    # Cells wider than a pixel leave gaps between their centres.
    cell_px = camera.fx * shape.cell_m / float(np.median(depths[shown]))
    side = 2 * min(int(np.ceil(cell_px)), _WIDEST_CELL_PX) + 1
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    closed = cv2.morphologyEx((places >= 0).astype(np.uint8), cv2.MORPH_CLOSE, disc)
    return closed > 0, places


def _match(a: Mask, b: Mask) -> float:
    """Return intersection over union."""
    return float((a & b).sum() / max((a | b).sum(), 1))


class _Fit:
    """One camera between what was believed of it and its outline.

    The unknowns are a shift (3), metres, and a turn (3), radians, both in the world's axes and from
    the believed pose on.

    Attributes:
        T_world_cam: The pose now ``(4, 4)``.
        sigma: How well position and rotation are known, per axis, None before any outline.
    """

    def __init__(
        self, T_believed: Array, sigma_m: float, sigma_rad: float, config: PoseConfig
    ) -> None:
        self._believed = T_believed
        self._sigma_px = config.outline_sigma_px * _SHRINK
        tilt = config.tilt_sigma_rad
        self._trust = 1.0 / np.array([sigma_m, sigma_m, sigma_m, tilt, tilt, sigma_rad]) ** 2
        self._moved = np.zeros(6)
        self.T_world_cam = T_believed.copy()
        self.sigma: tuple[float, float] | None = None

    def bring(self, shape: _Shape, silhouette: _Silhouette) -> None:
        """Move the camera towards where the shape's rim lies on the outline."""
        for _ in range(_STEPS):
            drawn, places = _drawn(shape, self.T_world_cam, silhouette.camera)
            rim = places[_outline(drawn)]
            rim = np.unique(rim[rim >= 0])
            if len(rim) < _LEAST_RIM:
                return
            self._step(shape.points_world[rim], shape.cell_m, silhouette)

    def _step(self, points: Array, cell_m: float, silhouette: _Silhouette) -> None:
        camera, R = silhouette.camera, self.T_world_cam[:3, :3]
        from_camera = points - self.T_world_cam[:3, 3]
        seen = from_camera @ R
        depth = seen[:, 2]
        beyond, slope = silhouette.at(camera.pixels_of(seen))
        # The rim runs half a cell outside of the centres of its cells.
        miss = beyond + 0.5 * camera.fx * cell_m / depth
        by_point = np.stack(
            [
                slope[:, 0] * camera.fx / depth,
                slope[:, 1] * camera.fy / depth,
                -(slope[:, 0] * camera.fx * seen[:, 0] + slope[:, 1] * camera.fy * seen[:, 1])
                / depth**2,
            ],
            axis=1,
        )
        by_world = by_point @ R.T
        # A point p moves to R'(p - c): with the camera shifted by s and turned by w in the world,
        # p - c changes by -s - w x (p - c).
        J = np.concatenate([-by_world, np.cross(by_world, from_camera)], axis=1)
        weights = 1.0 / (1.0 + (miss / (2.0 * self._sigma_px)) ** 2)
        weights *= _INDEPENDENT / (len(points) * self._sigma_px**2)
        information = (J * weights[:, None]).T @ J + np.diag(self._trust)
        gradient = J.T @ (weights * miss) + self._trust * self._moved
        self._moved = self._moved - np.linalg.solve(information, gradient)
        spread = np.diag(np.linalg.inv(information))
        self.sigma = float(np.sqrt(spread[:3].mean())), float(np.sqrt(spread[3:].mean()))
        turned = Rotation.from_rotvec(self._moved[3:]).as_matrix()
        self.T_world_cam[:3, :3] = turned @ self._believed[:3, :3]
        self.T_world_cam[:3, 3] = self._believed[:3, 3] + self._moved[:3]


def _outline(drawn: Mask) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return rows and columns of the pixels at the rim of ``drawn`` ``(h, w)``."""
    inner = cv2.erode(drawn.astype(np.uint8), np.ones((3, 3), np.uint8), borderValue=1) > 0
    rows, columns = np.nonzero(drawn & ~inner)
    return rows, columns
