"""Finding the object in a picture: the largest region (equations 1-3) and its mask.

The paper takes the largest region of the scale-normalised Laplacian of Gaussian as the object. In
an ordinary room rugs, doors and shelves are regions too, so the choice among the maxima weighs
size, response and nearness to where the object is expected: score = |R| sigma^k P(place).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from server.stages import Box, Frame, Region
from server.vision.box import box_from_region
from server.vision.config import RegionConfig
from server.vision.ground import Ground, floor_evidence, foot_factor, grow_up
from server.vision.masks import (
    ColourModel,
    Mask,
    Window,
    first_guess,
    grab_cut,
    keep_object,
    lab_bins,
    learn_colours,
    surroundings,
)
from server.vision.scale_space import (
    Blob,
    evidence_stack,
    find_blobs,
    lab_float,
    log_stack,
    scales,
)

# Evidence against floor, nats beyond the threshold, that no cut overrules.
_SURE = 2.5

Array = NDArray[np.float64]
Image = NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class RegionPrior:
    """Where the object should be in the picture.

    Attributes:
        centre_px: ``(2,)`` expected x, y of its centre, full-picture pixels; may lie outside.
        sigma_px: Standard deviation of that, full-picture pixels.
        size_px: ``(2,)`` expected width and height of its box, or None when not yet known.
        ground: Where free floor is and where the object's foot can be, None when unknown.
    """

    centre_px: Array
    sigma_px: float
    size_px: Array | None = None
    ground: Ground | None = None


@dataclass(frozen=True, slots=True, eq=False)
class _Work:
    """A picture at working size with what every step needs."""

    image_bgr: Image
    bins_lab: NDArray[np.intp]
    scale: int
    prior: RegionPrior

    @property
    def shape(self) -> tuple[int, int]:
        return self.image_bgr.shape[0], self.image_bgr.shape[1]


def _work(image_bgr: Image, config: RegionConfig, prior: RegionPrior | None) -> _Work:
    height, width = image_bgr.shape[:2]
    size = (width // config.work_scale, height // config.work_scale)
    small = cv2.resize(image_bgr, size, interpolation=cv2.INTER_AREA).astype(np.uint8, copy=False)
    if prior is None:
        centre = np.array([width / 2.0, height / 2.0])
        prior = RegionPrior(centre, config.prior_sigma_px * width)
    bins = lab_bins(small, config.histogram_bins)
    return _Work(small, bins, config.work_scale, prior)


def _score(blob: Blob, work: _Work, config: RegionConfig) -> float:
    place = np.array([blob.x_px, blob.y_px]) * work.scale
    off = (place - work.prior.centre_px) / work.prior.sigma_px
    # A blob can sit on a part of the object, so the place is never held to better than its size.
    spread = 1.0 + (blob.sigma_px * work.scale / work.prior.sigma_px) ** 2
    score = blob.response * blob.sigma_px**config.size_exponent
    score *= float(np.exp(-0.5 * (off @ off) / spread))
    if work.prior.size_px is not None:
        expected = float(np.sqrt(np.prod(work.prior.size_px))) / (2.0 * np.sqrt(2.0) * work.scale)
        score *= float(np.exp(-0.5 * (np.log(blob.sigma_px / expected) / 0.6) ** 2))
    return score


def _windows(blob: Blob, work: _Work) -> tuple[Window, Window]:
    """Return the blob's core and the window the object may fill, working pixels."""
    radius = np.sqrt(2.0) * blob.sigma_px
    core = Window(blob.x_px, blob.y_px, radius, radius)
    size = work.prior.size_px
    if size is None:
        return core, Window(blob.x_px, blob.y_px, 2.0 * radius, 2.3 * radius)
    # With a known size the window sits on the expected place, loosened by what is not known.
    loose = work.prior.sigma_px / work.scale
    half = size / (2.0 * work.scale)
    centre = work.prior.centre_px / work.scale
    core = Window(centre[0], centre[1], max(0.6 * half[0], 2.0), max(0.6 * half[1], 2.0))
    return core, Window(
        centre[0],
        centre[1],
        float(1.35 * half[0] + loose + 3.0),
        float(1.35 * half[1] + loose + 3.0),
    )


def _confidence(mask: Mask, work: _Work, config: RegionConfig) -> tuple[float, ColourModel]:
    """Return how far the mask's colours differ from its surroundings', times its plausibility.

    The first factor is the share of the object's colours that the ring around it does not have;
    the second is 1 at the expected place and falls with distance; sizes outside the configured
    limits, and what spans the picture, give zero.
    """
    width = 0.35 * np.sqrt(float(mask.sum()))
    ring = surroundings(mask, width)
    model = learn_colours(
        work.bins_lab,
        mask.astype(np.float32),
        ring.astype(np.float32),
        config.histogram_bins,
    )
    share = float(mask.mean())
    # What reaches from the picture's left edge to its right is a wall or the floor.
    spans_picture = bool(mask[:, 0].any() and mask[:, -1].any())
    fits = config.min_area_share <= share <= config.max_area_share
    if not fits or spans_picture or not ring.any():
        return 0.0, model
    ys, xs = np.nonzero(mask)
    off = np.array([xs.mean(), ys.mean()]) * work.scale - work.prior.centre_px
    reach = work.prior.sigma_px + 0.5 * work.scale * np.sqrt(float(mask.sum()))
    place = float(np.exp(-0.5 * (off @ off) / reach**2 / 4.0))
    return float(np.clip(model.separation * place, 0.0, 1.0)), model


def _region(mask: Mask, response: float, confidence: float, scale: int) -> Region:
    ys, xs = np.nonzero(mask)
    centre = (np.array([xs.mean(), ys.mean()]) + 0.5) * scale - 0.5
    # The sigma at which a disc of the mask's area answers most strongly.
    sigma = float(np.sqrt(len(xs) / np.pi) / np.sqrt(2.0)) * scale
    return Region(centre, sigma, response, mask, float(scale), confidence)


def _mask_from_blob(
    blob: Blob, work: _Work, config: RegionConfig, refine: bool
) -> tuple[Mask, float, ColourModel]:
    core, window = _windows(blob, work)
    mask, _ = first_guess(work.bins_lab, core, window, config.histogram_bins)
    if refine:
        mask = grab_cut(work.image_bgr, mask, window, config.refine_iterations)
    mask = keep_object(mask, core.x_px, core.y_px, 0.7 * window.half_width_px)
    confidence, model = _confidence(mask, work, config)
    return mask, confidence, model


def _search(work: _Work, config: RegionConfig, refine: bool) -> tuple[Region, ColourModel] | None:
    """Search on the floor where the camera sees enough of it, else in the picture's own colours."""
    if work.prior.ground is not None:
        return _search_on_floor(work, work.prior.ground, config, refine)
    return _search_in_colours(work, config, refine)


def _search_on_floor(
    work: _Work, ground: Ground, config: RegionConfig, refine: bool
) -> tuple[Region, ColourModel] | None:
    """Return the largest region of what does not look like floor where only floor can be behind.

    Equations 1-3 are applied to the map of evidence against floor; each maximum proposes a mask,
    and the largest, most surprising one at the right place with its foot on the floor wins.
    """
    centre, reach = work.prior.centre_px / work.scale, work.prior.sigma_px / work.scale
    y, x = np.ogrid[: work.shape[0], : work.shape[1]]
    half = reach if work.prior.size_px is None else 0.6 * work.prior.size_px[0] / work.scale
    across = ((x - centre[0]) / (reach + half)) ** 2 + np.zeros_like(y)
    away = (1.0 - np.exp(-0.5 * across) + 0.03).astype(np.float32)
    evidence = floor_evidence(work.bins_lab, config.histogram_bins, ground, work.scale, away)
    strength = np.clip(evidence, 0.0, 3.0) * np.exp(-0.25 * across)
    sigmas = scales(config)
    blobs = find_blobs(evidence_stack(strength.astype(np.float32), sigmas), sigmas, 0.1)
    surprising = evidence > 0.0
    window = _known_window(work)
    if window is not None:
        surprising &= window.radius(work.shape) < 1.0
    best: tuple[float, Mask, Blob] | None = None
    for blob in blobs[: config.candidates]:
        radius = np.sqrt(2.0) * blob.sigma_px
        near = (abs(x - blob.x_px) < 2.0 * radius + 4) & (abs(y - blob.y_px) < 3.5 * radius + 6)
        mask = keep_object(surprising & near, blob.x_px, blob.y_px, radius)
        if mask.sum() < config.min_area_share * mask.size:
            continue
        score = _floor_score(mask, evidence, ground, work, config)
        if best is None or score > best[0]:
            best = score, mask, blob
    if best is None:
        return None
    _, mask, blob = best
    on_floor = mask & (evidence > _SURE)
    mask = grow_up(mask, work.bins_lab, config.histogram_bins, ground, work.scale)
    if window is not None:
        mask &= window.radius(work.shape) < 1.0
    if refine:
        mask = _refined(mask, on_floor, window, work, config)
    confidence, model = _confidence(mask, work, config)
    confidence *= foot_factor(mask, ground, work.scale)
    if confidence < config.min_confidence:
        return None
    region = _region(mask, blob.response, confidence, work.scale)
    maximum = (np.array([blob.x_px, blob.y_px]) + 0.5) * work.scale - 0.5
    return replace(region, centre_px=maximum, sigma_px=blob.sigma_px * work.scale), model


def _floor_score(
    mask: Mask,
    evidence: NDArray[np.float32],
    ground: Ground,
    work: _Work,
    config: RegionConfig,
) -> float:
    """Return size^k times evidence, less where place, foot or extent do not fit the object."""
    columns = np.nonzero(mask.any(axis=0))[0]
    width = float(columns[-1] - columns[0])
    reach = work.prior.sigma_px / work.scale + 0.25 * width
    off = (float(np.nonzero(mask)[1].mean()) - work.prior.centre_px[0] / work.scale) / reach
    score = float(mask.sum()) ** config.size_exponent * float(evidence[mask].mean())
    score *= foot_factor(mask, ground, work.scale) * float(np.exp(-0.5 * off * off))
    across_the_picture = columns[0] <= 1 and columns[-1] >= work.shape[1] - 2
    return 0.2 * score if across_the_picture else score


def _known_window(work: _Work) -> Window | None:
    """Return the ellipse the object lies in, None while its size is unknown."""
    size = work.prior.size_px
    if size is None:
        return None
    # Corners of the box lie 1.41 half axes out; what is not known of the place comes on top.
    half = 0.75 * size / work.scale + work.prior.sigma_px / work.scale + 3.0
    centre = work.prior.centre_px / work.scale
    return Window(float(centre[0]), float(centre[1]), float(half[0]), float(half[1]))


def _refined(
    mask: Mask, sure: Mask, window: Window | None, work: _Work, config: RegionConfig
) -> Mask:
    """Return ``mask`` cut anew along the picture's edges, with ``sure`` in any case."""
    ys, xs = np.nonzero(mask)
    if window is None:
        half_width = 0.75 * float(xs.max() - xs.min()) + 8.0
        half_height = 0.75 * float(ys.max() - ys.min()) + 8.0
        middle = (xs.min() + xs.max()) / 2.0, (ys.min() + ys.max()) / 2.0
        window = Window(float(middle[0]), float(middle[1]), half_width, half_height)
    cut = grab_cut(work.image_bgr, mask, window, config.refine_iterations)
    reach = 0.5 * (window.half_width_px + window.half_height_px)
    cut = keep_object(cut, window.x_px, window.y_px, reach)
    kept = float((cut & mask).sum()) / float(mask.sum())
    if kept < 0.5 or float(cut.sum()) > 2.0 * float(mask.sum()):
        return mask
    # A cut prefers short borders and so loses thin legs; what clearly is no floor stays.
    return keep_object(cut | sure, window.x_px, window.y_px, reach)


def _search_in_colours(
    work: _Work, config: RegionConfig, refine: bool
) -> tuple[Region, ColourModel] | None:
    sigmas = scales(config)
    stack = log_stack(lab_float(work.image_bgr), sigmas, config.chroma_weight)
    blobs = find_blobs(stack, sigmas, config.min_response)
    ranked = sorted(blobs, key=lambda blob: -_score(blob, work, config))[: config.candidates]
    if not ranked:
        return None
    # The best two maxima get a quick mask; the more convincing one is the object.
    quick = [
        (_mask_from_blob(blob, work, config, False)[1] * _score(blob, work, config) ** 0.5, blob)
        for blob in ranked[:2]
    ]
    blob = max(quick, key=lambda pair: pair[0])[1]
    mask, confidence, model = _mask_from_blob(blob, work, config, refine)
    if confidence < config.min_confidence:
        return None
    region = _region(mask, blob.response, confidence, work.scale)
    maximum = (np.array([blob.x_px, blob.y_px]) + 0.5) * work.scale - 0.5
    return replace(region, centre_px=maximum, sigma_px=blob.sigma_px * work.scale), model


def find_region(
    image_bgr: Image, config: RegionConfig, prior: RegionPrior | None = None, *, refine: bool = True
) -> Region | None:
    """Return the object's region in one picture, or None when nothing stands out.

    Args:
        image_bgr: ``(h, w, 3)`` uint8.
        config: Settings.
        prior: Where the object should be; None means around the picture's middle.
        refine: Whether the mask is refined by GrabCut (tens of milliseconds).
    """
    found = _search(_work(image_bgr, config, prior), config, refine)
    return None if found is None else found[0]


class RegionTracker:
    """Follows the object through one drone's pictures: a full search now and then, cheap between.

    Between refined pictures the colour model of the last one is applied around the last mask.
    """

    def __init__(self, config: RegionConfig) -> None:
        self._config = config
        self._since_refined = 0
        self._model: ColourModel | None = None
        self._last: Region | None = None
        self._last_expected: RegionPrior | None = None

    def update(self, frame: Frame, expected: RegionPrior | None) -> tuple[Region, Box] | None:
        """Return region and box of ``frame``, or None when the object is not seen.

        Args:
            frame: The next picture of this tracker's drone.
            expected: Where the object should be by the drone's pose; None when that is unknown.
        """
        prior = expected or self._prior_from_last()
        work = _work(frame.image_bgr, self._config, prior)
        region = self._follow(work, expected)
        if region is None or self._since_refined + 1 >= self._config.refine_every:
            found = _search(work, self._config, refine=True)
            self._since_refined = 0
            region, self._model = found if found is not None else (None, None)
        else:
            self._since_refined += 1
        self._last, self._last_expected = region, expected
        if region is None:
            return None
        height, width = frame.image_bgr.shape[:2]
        return region, box_from_region(region, width, height)

    def _prior_from_last(self) -> RegionPrior | None:
        if self._last is None:
            return None
        return RegionPrior(self._last.centre_px, 2.0 * self._last.sigma_px)

    def _follow(self, work: _Work, expected: RegionPrior | None) -> Region | None:
        """Return the last region moved along by its colours; None when that is not convincing."""
        if self._last is None or self._model is None or self._last.mask.shape != work.shape:
            return None
        before = self._last.mask.astype(np.float32)
        if expected is not None and self._last_expected is not None:
            shift = (expected.centre_px - self._last_expected.centre_px) / work.scale
            matrix = np.array([[1.0, 0.0, shift[0]], [0.0, 1.0, shift[1]]])
            before = cv2.warpAffine(before, matrix, (work.shape[1], work.shape[0]))
        near = cv2.blur(before, (13, 13))
        evidence = cv2.blur(self._model.ratio(work.bins_lab), (3, 3))
        mask = (evidence + 6.0 * (near - 0.5) > 0.0) & (near > 0.02)
        if not mask.any():
            return None
        ys, xs = np.nonzero(before > 0.5)
        if len(xs) == 0:
            return None
        reach = 2.0 * np.sqrt(float(len(xs)))
        mask = keep_object(mask, float(xs.mean()), float(ys.mean()), reach)
        change = float(mask.sum()) / len(xs)
        confidence, _ = _confidence(mask, work, self._config)
        if confidence < self._config.min_confidence or not 0.6 < change < 1.6:
            return None
        return _region(mask, self._last.response, confidence, work.scale)
