"""How far poses are from the truth, after the similarity that fits best (BARF's protocol)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from server.geometry.poses import Similarity, fit_similarity, inverse

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class PoseErrors:
    """Errors of some poses.

    Attributes:
        rotation_deg: ``(n,)`` degrees.
        translation_m: ``(n,)`` metres in the world's scale.
        to_truth: The similarity from the estimated frame to the true one.
    """

    rotation_deg: Array
    translation_m: Array
    to_truth: Similarity

    @property
    def scale_error(self) -> float:
        """How wrong the estimated frame's scale is, as a share of the truth."""
        return abs(1.0 / self.to_truth.scale - 1.0)


def pose_errors(T_estimated: Array, T_true: Array) -> PoseErrors:
    """Return the errors of ``T_estimated`` ``(n, 4, 4)``, n >= 3.

    Lin et al., "BARF", ICCV 2021, section 4: the centres are aligned by a similarity, and what is
    left is the error.
    """
    similarity = fit_similarity(T_estimated[:, :3, 3], T_true[:, :3, 3])
    carried = similarity.poses(T_estimated)
    turns = Rotation.from_matrix((inverse(T_true) @ carried)[:, :3, :3]).magnitude()
    shifts = np.linalg.norm(carried[:, :3, 3] - T_true[:, :3, 3], axis=1)
    return PoseErrors(np.rad2deg(turns), shifts, similarity)


def into_frame_of(T_estimated: Array, T_true: Array, wanted_true: Array) -> Array:
    """Carry true poses ``wanted_true`` ``(m, 4, 4)`` into the frame of ``T_estimated``."""
    back = fit_similarity(T_true[:, :3, 3], T_estimated[:, :3, 3])
    return back.poses(wanted_true)


def percentiles(name: str, values: Sequence[float], digits: int, *shares: int) -> dict[str, Any]:
    """Return ``{name_p50: ...}`` for every share, None where there are no values."""
    return {
        f"{name}_p{share}": round(float(np.percentile(values, share)), digits) if values else None
        for share in shares
    }
