"""One small gain per picture and channel, so that exposure changes do not become geometry."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from server.nerf.config import TrainConfig

FloatArray = NDArray[np.float32]


class ExposureGains:
    """Log gains of the training pictures, pulled towards zero, their mean held at zero.

    Held-out pictures are judged without any gain, so the field must keep the mean exposure.

    Args:
        pictures: Number of pictures in the dataset.
        config: Rate and decay.
    """

    def __init__(self, pictures: int, config: TrainConfig) -> None:
        self._config = config
        self._mean = np.zeros((pictures, 3), np.float32)
        self._variance = np.zeros((pictures, 3), np.float32)
        self.log_gains = np.zeros((pictures, 3), np.float32)

    @property
    def gains(self) -> FloatArray:
        """Factors ``(pictures, 3)``."""
        return np.exp(self.log_gains)

    def grow(self, pictures: int) -> None:
        """Make room for ``pictures`` pictures; new ones begin without any gain."""
        more = ((0, pictures - len(self.log_gains)), (0, 0))
        self._mean, self._variance, self.log_gains = (
            np.pad(part, more) for part in (self._mean, self._variance, self.log_gains)
        )

    def state(self) -> dict[str, FloatArray]:
        """Return gains and moments by name, for a checkpoint to go on from."""
        return {
            "log_gains": self.log_gains,
            "gains_mean": self._mean,
            "gains_variance": self._variance,
        }

    def restore(self, state: Mapping[str, FloatArray]) -> None:
        """Take over what ``state`` returned; moments may be missing."""
        self.log_gains = state["log_gains"]
        if "gains_mean" in state:
            self._mean, self._variance = state["gains_mean"], state["gains_variance"]

    def step(self, grads: FloatArray, indices: NDArray[np.int64]) -> None:
        """Move the gains of ``indices`` along ``grads`` ``(chunks, pictures, 3)``, clear those."""
        grad = grads.sum(axis=0)
        grads[:] = 0.0
        if self._config.exposure_rate == 0.0:
            return
        # Slow moments: a picture has only a few hundred pixels in one step.
        self._mean = 0.95 * self._mean + 0.05 * grad
        self._variance = 0.99 * self._variance + 0.01 * grad**2
        push = self._mean / (np.sqrt(self._variance) + 1e-12)
        moved = self.log_gains - self._config.exposure_rate * push
        moved *= 1.0 - self._config.exposure_decay
        moved[indices] -= moved[indices].mean(axis=0)
        self.log_gains = moved.astype(np.float32)
