"""What is known of the object, by one drone and by all together.

Given the object, the drones' errors are independent, so the object is the only thing they have to
share: ``TargetEstimator`` multiplies the drones' likelihoods of it, and a filter is conditioned on
what the *others* know of it when a pose is asked for. Nothing is counted twice.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from server.vision.config import LocalizationConfig

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class TargetEstimate:
    """What is known of the object.

    Attributes:
        centre: Its centre ``(3,)``, world metres.
        height_m: Its height.
        covariance: ``(4, 4)`` of (x, y, z, log height).
    """

    centre: Array
    height_m: float
    covariance: Array

    @property
    def vector(self) -> Array:
        """The estimate as ``(4,)``: x, y, z, log height."""
        return np.array([*self.centre, np.log(self.height_m)])

    @property
    def sigma_m(self) -> float:
        """Root of the mean variance of the centre, metres."""
        return float(np.sqrt(np.trace(self.covariance[:3, :3]) / 3.0))


def prior_target(config: LocalizationConfig) -> TargetEstimate:
    """Return what is known of the object before anything was seen."""
    sigmas = np.array(
        [
            config.target_sigma_m,
            config.target_sigma_m,
            config.target_height_sigma_m,
            config.object_height_log_sigma,
        ]
    )
    centre = np.array([0.0, 0.0, config.target_height_m])
    return TargetEstimate(centre, config.object_height_m, np.diag(sigmas**2))


def estimate_from(vector: Array, covariance: Array) -> TargetEstimate:
    """Return the estimate of ``(4,)`` x, y, z, log height, and their covariance ``(4, 4)``."""
    return TargetEstimate(vector[:3].copy(), float(np.exp(vector[3])), covariance)


class TargetEstimator:
    """Combines the drones' beliefs about the object into one.

    With prior information L0 and posterior L_i of drone i, the drone's own contribution is
    L_i - L0, and together they know L0 + sum_i (L_i - L0).
    """

    def __init__(self, config: LocalizationConfig, prior: TargetEstimate | None = None) -> None:
        """Begin with ``prior``, which every filter must begin with too; None: the config's."""
        self._prior = prior_target(config) if prior is None else prior
        # As information, whose sum is what they know together: inverted once, asked for often.
        self._information = np.linalg.inv(self._prior.covariance)
        self._weighted = self._information @ self._prior.vector
        self._own: dict[str, tuple[Array, Array]] = {}

    def observe(self, drone_id: str, belief: TargetEstimate) -> None:
        """Take the newest belief of ``drone_id`` (``PoseFilter.target_belief``)."""
        own = np.linalg.inv(belief.covariance)
        self._own[drone_id] = own - self._information, own @ belief.vector - self._weighted

    def estimate(self, excluding: str | None = None) -> TargetEstimate:
        """Return what all drones, or all but ``excluding``, know together."""
        information, weighted = self._information.copy(), self._weighted.copy()
        for drone_id, (own, own_weighted) in self._own.items():
            if drone_id != excluding:
                information += own
                weighted += own_weighted
        covariance = np.linalg.inv(information)
        return estimate_from(covariance @ weighted, (covariance + covariance.T) / 2.0)
