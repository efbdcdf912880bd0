"""How close a rendering comes to a photograph.

All pictures are sRGB in [0, 1], clipped. Set means are means of per-picture values.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, cast

import flip_evaluator
import numpy as np
from numpy.typing import NDArray
from skimage.metrics import structural_similarity

from server.stages import Metrics

Image = NDArray[np.float32]

# Smaller pictures have no structural similarity.
SSIM_WINDOW_PX = 11
# Pictures that are equal would have infinite PSNR, which no JSON can carry.
_PSNR_MAX_DB = 100.0


@dataclass(frozen=True, slots=True)
class PictureScore:
    """Figures of one picture.

    Attributes:
        index: Which picture of the dataset.
        psnr_db: Whole picture.
        ssim: Whole picture.
        flip: Whole picture, smaller is better.
        psnr_db_object: Inside the object's mask, None without one.
    """

    index: int
    psnr_db: float
    ssim: float
    flip: float
    psnr_db_object: float | None


def psnr_db(image: Image, reference: Image, mask: NDArray[np.bool_] | None = None) -> float:
    """Return the peak signal-to-noise ratio in dB, over ``mask`` ``(h, w)`` when one is given.

    Raises:
        ValueError: If the shapes differ or the mask is empty.
    """
    if image.shape != reference.shape:
        raise ValueError(f"pictures differ in shape: {image.shape} and {reference.shape}")
    square = (image.astype(np.float64) - reference.astype(np.float64)) ** 2
    if mask is not None:
        if not mask.any():
            raise ValueError("the mask is empty")
        square = square[mask]
    mean = float(square.mean())
    return min(_PSNR_MAX_DB, -10.0 * float(np.log10(mean))) if mean > 0.0 else _PSNR_MAX_DB


def ssim(image: Image, reference: Image) -> float:
    """Return the structural similarity of Wang et al. 2004: 11x11 Gaussian window, sigma 1.5."""
    # Annotated as a union of results, of which these arguments select the plain number.
    similarity = cast(Any, structural_similarity)(
        image,
        reference,
        gaussian_weights=True,
        sigma=1.5,
        use_sample_covariance=False,
        data_range=1.0,
        channel_axis=2,
    )
    return float(similarity)


def flip(image: Image, reference: Image) -> float:
    """Return the mean FLIP error (Andersson et al. 2020) at the evaluator's default distance."""
    # The evaluator returns the error picture, its mean, and the parameters used.
    evaluate = cast(Any, flip_evaluator.evaluate)
    result = evaluate(
        np.ascontiguousarray(reference, np.float32), np.ascontiguousarray(image, np.float32), "LDR"
    )
    return float(result[1])


def score_picture(
    index: int, image: Image, reference: Image, mask: NDArray[np.bool_] | None
) -> PictureScore:
    """Return all figures of ``image`` against ``reference``, both ``(h, w, 3)``."""
    shown = np.clip(image, 0.0, 1.0).astype(np.float32)
    on_object = None if mask is None or not mask.any() else psnr_db(shown, reference, mask)
    return PictureScore(
        index, psnr_db(shown, reference), ssim(shown, reference), flip(shown, reference), on_object
    )


def mean_metrics(scores: Sequence[PictureScore], images: int) -> Metrics:
    """Return the means of ``scores``, the held-out pictures of a dataset of ``images``.

    Raises:
        ValueError: If there is no score.
    """
    if not scores:
        raise ValueError("no picture was judged")
    on_object = [s.psnr_db_object for s in scores if s.psnr_db_object is not None]
    return Metrics(
        images=images,
        images_held_out=len(scores),
        psnr_db=float(np.mean([s.psnr_db for s in scores])),
        ssim=float(np.mean([s.ssim for s in scores])),
        flip=float(np.mean([s.flip for s in scores])),
        psnr_db_object=float(np.mean(on_object)) if on_object else None,
    )
