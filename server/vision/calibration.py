"""Camera intrinsics from several views of a flat board.

Symbols: ``K`` camera matrix, ``(k1, k2, p1, p2, k3)`` OpenCV's distortion, rotation vectors of
``R_cam_board`` and translations of each view, residuals in pixels. Zhang's method (A Flexible New
Technique for Camera Calibration, 2000) followed by bundle adjustment, both OpenCV's; what is ours
is the choice of views, the rule for bad ones, and when to refuse.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from server.geometry.cameras import Intrinsics
from server.vision.calibration_board import BoardView
from server.vision.calibration_views import (
    CalibrationConfig,
    coverage_of,
    missing_sides,
    tilt_deg,
)

Array = NDArray[np.float64]

_TERM_NAMES = ("k1", "k2", "p1", "p2", "k3")
_TERMS = (
    (("k3",), cv2.CALIB_FIX_K3),
    (("p1", "p2"), cv2.CALIB_ZERO_TANGENT_DIST),
    (("k2",), cv2.CALIB_FIX_K2),
    (("k1",), cv2.CALIB_FIX_K1),
)
_BELOW = {"k2": "k3", "k1": "k2"}


Lack = Literal[
    "few_views",
    "one_sided",
    "coverage",
    "flat",
    "disagree",
    "contradict",
    "uncertain",
    "undetermined",
    "sizes",
]
"""What keeps views from determining a camera, in a word for programs."""


class CalibrationRefusedError(ValueError):
    """The views do not determine the camera; the text says what is missing and what to do.

    Attributes:
        lack: The same in a word.
    """

    def __init__(self, lack: Lack, text: str) -> None:
        super().__init__(text)
        self.lack: Lack = lack


@dataclass(frozen=True, slots=True, eq=False)
class Calibration:
    """A camera and how well it is known.

    Attributes:
        intrinsics: The camera.
        deviations: Standard deviations of ``fx, fy, cx, cy`` ``(4,)``, pixels, from the residuals
            of the kept views, supposing them independent.
        rms_px: Root mean square of the corner errors of the kept views, pixels.
        mean_px: Mean length of the corner errors, pixels.
        views: Kept views' names and RMS errors, pixels.
        dropped: Dropped views' names and RMS errors, pixels.
        coverage: How many corners fell into each cell ``(6, 8)`` of the picture.
        tilts_deg: Tilt of each kept view about the vertical and horizontal axis ``(n, 2)``.
        fixed: Distortion terms that the views could not tell from zero and that were set to it.
    """

    intrinsics: Intrinsics
    deviations: Array
    rms_px: float
    mean_px: float
    views: tuple[tuple[str, float], ...]
    dropped: tuple[tuple[str, float], ...]
    coverage: NDArray[np.int64]
    tilts_deg: Array
    fixed: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False)
class _Fit:
    """OpenCV's answer: ``K (3, 3)``, distortion ``(5,)``, deviations ``(>= 9,)``, per view."""

    K: Array
    distortion: Array
    rotations: tuple[Array, ...]
    translations: tuple[Array, ...]
    deviations: Array
    errors: Array
    rms_px: float


def calibrate(views: Sequence[BoardView], config: CalibrationConfig | None = None) -> Calibration:
    """Return the camera that took ``views``.

    Raises:
        CalibrationRefusedError: If pictures differ in size, or views are too few, cover too little
            of the picture, are too little tilted, disagree with each other, or leave the focal
            length too uncertain.
    """
    config = config if config is not None else CalibrationConfig()
    _refuse_mixed_sizes(views)
    _refuse_few(len(views), config)
    fit, kept, dropped = _robust_fit(views, config)
    chosen = [views[index] for index in kept]
    coverage = coverage_of(chosen)
    tilts = np.array([tilt_deg(rotation) for rotation in fit.rotations])
    _refuse_one_sided(coverage, config)
    _refuse_flat(tilts, config)
    fit, fixed = _without_idle_terms(chosen, fit)
    _refuse_uncertain(fit, config)
    lengths = np.concatenate(_residual_lengths(chosen, fit))
    width, height = chosen[0].width, chosen[0].height
    k1, k2, p1, p2, k3 = (float(term) for term in fit.distortion)
    fx, fy, cx, cy = (float(fit.K[place]) for place in ((0, 0), (1, 1), (0, 2), (1, 2)))
    return Calibration(
        Intrinsics(width, height, fx, fy, cx, cy, (k1, k2, p1, p2, k3)),
        fit.deviations[:4].copy(),
        fit.rms_px,
        float(lengths.mean()),
        tuple((view.name, float(e)) for view, e in zip(chosen, fit.errors, strict=True)),
        tuple((views[index].name, error) for index, error in dropped),
        coverage,
        tilts,
        fixed,
    )


def _fit(views: Sequence[BoardView], flags: int = 0) -> _Fit:
    width, height = views[0].width, views[0].height
    try:
        rms, K, distortion, rotations, translations, deviations, _, errors = (
            cv2.calibrateCameraExtended(
                [view.points_board.astype(np.float32) for view in views],
                [view.pixels.astype(np.float32) for view in views],
                (width, height),
                np.eye(3),
                np.zeros(5),
                flags=flags,
            )
        )
    except cv2.error as error:
        raise CalibrationRefusedError(
            "contradict", "the views contradict each other: is the board flat and as described?"
        ) from error
    fit = _Fit(
        np.asarray(K, float),
        np.asarray(distortion, float).ravel()[:5],
        tuple(np.asarray(rotation, float).ravel() for rotation in rotations),
        tuple(np.asarray(translation, float).ravel() for translation in translations),
        np.asarray(deviations, float).ravel(),
        np.asarray(errors, float).ravel(),
        float(rms),
    )
    if not np.isfinite(fit.K).all() or not np.isfinite(fit.distortion).all():
        raise CalibrationRefusedError(
            "undetermined", "the views do not determine the camera: tilt the board more"
        )
    return fit


def _robust_fit(
    views: Sequence[BoardView], config: CalibrationConfig
) -> tuple[_Fit, list[int], list[tuple[int, float]]]:
    """Fit, drop views that do not belong, and fit again until none is left to drop."""
    kept = list(range(len(views)))
    dropped: list[tuple[int, float]] = []
    most = int(config.outlier_share * len(views))
    while True:
        fit = _fit([views[index] for index in kept])
        median = float(np.median(fit.errors))
        spread = 1.4826 * float(np.median(np.abs(fit.errors - median)))
        limit = max(median + config.outlier_sigmas * spread, 1.5 * median)
        worst = int(np.argmax(fit.errors))
        if fit.errors[worst] <= limit or len(dropped) >= most:
            return fit, kept, dropped
        # One at a time: a bad view spoils the errors of the good ones.
        dropped.append((kept.pop(worst), float(fit.errors[worst])))
        _refuse_few(len(kept), config)


def _without_idle_terms(views: Sequence[BoardView], fit: _Fit) -> tuple[_Fit, tuple[str, ...]]:
    """Fit again without distortion terms within three standard deviations of zero.

    A term the views cannot tell bends the picture's corners at will: published calibrations of
    this camera have ``k3`` of 2 and of 8 where another has 0. From the highest order down, because
    without ``k3`` the lower terms become certain.
    """
    fixed: list[str] = []
    flags = 0
    for names, flag in _TERMS:
        # A radial term stays while a higher one is needed.
        if names[0] in _BELOW and _BELOW[names[0]] not in fixed:
            continue
        places = [_TERM_NAMES.index(name) for name in names]
        if any(abs(fit.distortion[at]) >= 3.0 * fit.deviations[4 + at] for at in places):
            continue
        flags |= flag
        fixed += names
        fit = _fit(views, flags)
    return fit, tuple(sorted(fixed))


def _residual_lengths(views: Sequence[BoardView], fit: _Fit) -> list[Array]:
    lengths: list[Array] = []
    for view, rotation, translation in zip(views, fit.rotations, fit.translations, strict=True):
        projected, _ = cv2.projectPoints(
            view.points_board, rotation, translation, fit.K, fit.distortion
        )
        lengths.append(np.linalg.norm(projected.reshape(-1, 2) - view.pixels, axis=1))
    return lengths


def _refuse_mixed_sizes(views: Sequence[BoardView]) -> None:
    sizes: dict[tuple[int, int], str] = {}
    for view in views:
        sizes.setdefault((view.width, view.height), view.name)
    if len(sizes) > 1:
        seen = ", ".join(f"{w}x{h} ({name})" for (w, h), name in sizes.items())
        raise CalibrationRefusedError("sizes", f"the pictures must all have one size, not {seen}")


def _refuse_few(count: int, config: CalibrationConfig) -> None:
    if count < config.views_least:
        raise CalibrationRefusedError(
            "few_views", f"{count} good views are too few, {config.views_least} are needed"
        )


def _refuse_one_sided(coverage: NDArray[np.int64], config: CalibrationConfig) -> None:
    missing = missing_sides(coverage)
    share = float((coverage > 0).mean())
    if missing:
        raise CalibrationRefusedError(
            "one_sided",
            f"no view shows the board at the picture's {' and '.join(missing)}: hold it there, too",
        )
    if share < config.coverage_least:
        raise CalibrationRefusedError(
            "coverage",
            f"the views cover {share:.0%} of the picture, {config.coverage_least:.0%} are needed:"
            " hold the board nearer and into the corners",
        )


def _refuse_flat(tilts_deg: Array, config: CalibrationConfig) -> None:
    tilted = (np.abs(tilts_deg) >= config.tilt_deg).sum(axis=0)
    for axis, count in zip(("left and right", "up and down"), tilted, strict=True):
        if count < config.tilted_least:
            raise CalibrationRefusedError(
                "flat",
                f"tilt the board more: {count} views are turned {axis} by"
                f" {config.tilt_deg:g} degrees or more, {config.tilted_least} are needed",
            )


def _refuse_uncertain(fit: _Fit, config: CalibrationConfig) -> None:
    if fit.rms_px > config.rms_px_most:
        raise CalibrationRefusedError(
            "disagree",
            f"the views disagree by {fit.rms_px:.2f} pixels, {config.rms_px_most:g} is the most:"
            " is the board flat, stiff and as described, are the pictures sharp?",
        )
    deviation = float(fit.deviations[0] / fit.K[0, 0])
    if not deviation <= config.fx_sd_most:
        raise CalibrationRefusedError(
            "uncertain",
            f"the focal length is uncertain by {deviation:.1%}, {config.fx_sd_most:.1%} is the"
            " most: more views, nearer and tilted more",
        )
