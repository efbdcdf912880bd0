"""Masks once more, after the capture: now that the cameras' places are known to millimetres.

In flight a picture's outline is looked for where a pose that is decimetres wrong expects it, so
some masks hold a shelf behind the object and some lack its legs. With refined poses the masks of
all pictures make one seed geometry, by vote, and its outline in each picture says what the mask
should have been.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from server.geometry.cameras import Intrinsics
from server.stages import CameraPose, Region, SeedGeometry, View
from server.vision.box import box_from_region
from server.vision.config import RegionConfig, SeedConfig
from server.vision.expectation import expected_region
from server.vision.region import find_region, full_mask, region_of_mask
from server.vision.seed import SeedError, seed_from_views
from server.vision.target import TargetEstimate

Array = NDArray[np.float64]
Image = NDArray[np.uint8]
Mask = NDArray[np.bool_]

# Full-picture pixels per working pixel of the two passes: the first mends what is grossly wrong,
# the second is exact.
_WORK_SCALES = (4, 2)
# Masks of the flight, and how surely an estimate of the object from all pictures is right.
_MASK_SCALE, _CONFIDENCE = 4, 0.9
_TARGET_SIGMA_M, _LOG_HEIGHT_SIGMA = 0.02, 0.1


@dataclass(frozen=True, slots=True, eq=False)
class MaskedPicture:
    """A picture of a camera whose place is known well.

    Attributes:
        image_bgr: ``(h, w, 3)`` uint8.
        mask: True on the object as far as is known ``(h, w)``, None when nothing is.
        pose: The camera's pose and its covariance.
        intrinsics: The camera.
    """

    image_bgr: Image
    mask: Mask | None
    pose: CameraPose
    intrinsics: Intrinsics


def recut_masks(
    pictures: Sequence[MaskedPicture],
    region: RegionConfig,
    seed: SeedConfig,
    on_progress: Callable[[float], None],
) -> list[Mask | None]:
    """Return a mask ``(h, w)`` for each of ``pictures``; one that is not found anew stays.

    Pictures whose masks have nothing in common keep those they have.

    Args:
        pictures: Of one object.
        region: Settings of the search.
        seed: Settings of the seed geometry.
        on_progress: Told the share that is done.
    """
    regions = [_coarse(picture) for picture in pictures]
    anew: list[Region | None] = [None] * len(pictures)
    for turn, scale in enumerate(_WORK_SCALES):
        try:
            geometry = seed_from_views(_views(pictures, regions), seed)
        except SeedError:
            return [picture.mask for picture in pictures]
        finer = replace(region, work_scale=scale)
        for k, picture in enumerate(pictures):
            found = _search(picture, geometry, finer)
            if found is not None:
                regions[k] = anew[k] = found
            on_progress((turn + (k + 1) / len(pictures)) / len(_WORK_SCALES))
    return [
        picture.mask
        if each is None
        else full_mask(each, picture.intrinsics.width, picture.intrinsics.height)
        for each, picture in zip(anew, pictures, strict=True)
    ]


def _coarse(picture: MaskedPicture) -> Region | None:
    """Return the region of a mask as the flight would have found it, None when it is empty."""
    if picture.mask is None:
        return None
    rows, columns = (size // _MASK_SCALE * _MASK_SCALE for size in picture.mask.shape)
    cells = picture.mask[:rows, :columns].reshape(
        rows // _MASK_SCALE, _MASK_SCALE, columns // _MASK_SCALE, _MASK_SCALE
    )
    small = cells.mean(axis=(1, 3)) >= 0.5
    return region_of_mask(small, 0.0, _CONFIDENCE, _MASK_SCALE) if small.any() else None


def _views(pictures: Sequence[MaskedPicture], regions: Sequence[Region | None]) -> list[View]:
    return [
        View(
            picture.pose,
            picture.intrinsics,
            box_from_region(region, picture.intrinsics.width, picture.intrinsics.height),
            region,
        )
        for picture, region in zip(pictures, regions, strict=True)
        if region is not None
    ]


def _search(picture: MaskedPicture, geometry: SeedGeometry, config: RegionConfig) -> Region | None:
    """Return the region where the geometry is expected."""
    target = TargetEstimate(
        geometry.outer.centre,
        float(geometry.outer.size[2]),
        np.diag([_TARGET_SIGMA_M**2] * 3 + [_LOG_HEIGHT_SIGMA**2]),
    )
    expected = expected_region(picture.pose, target, picture.intrinsics, geometry)
    return find_region(picture.image_bgr, config, expected)
