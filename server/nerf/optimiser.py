"""Adam over all parameters of the field (Kingma and Ba 2015), with a schedule by progress."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from server.nerf.config import TrainConfig
from server.nerf.field import FieldParameters
from server.nerf.kernels.cpu_rays import adam_step

FloatArray = NDArray[np.float32]

_BETA_1 = 0.9
_BETA_2 = 0.99


class Adam:
    """Moves parameters in place; rows of the table without gradient stay where they are.

    Args:
        parameters: Arrays to move.
        config: Learning rate and its schedule.
    """

    def __init__(self, parameters: FieldParameters, config: TrainConfig) -> None:
        self._config = config
        self._values = {name: array.reshape(-1) for name, array in parameters.named().items()}
        self._means = {name: np.zeros_like(v) for name, v in self._values.items()}
        self._variances = {name: np.zeros_like(v) for name, v in self._values.items()}
        self._steps = 0

    def state(self) -> dict[str, FloatArray]:
        """Return moments and step count by name, for a checkpoint to go on from."""
        named = {"adam_steps": np.array(self._steps, np.float32)}
        for kind, moments in (("mean", self._means), ("variance", self._variances)):
            named |= {f"adam_{kind}_{name}": moment for name, moment in moments.items()}
        return named

    def restore(self, state: Mapping[str, FloatArray]) -> None:
        """Take over what ``state`` returned.

        Raises:
            KeyError: If something is missing.
        """
        self._steps = int(state["adam_steps"])
        for kind, moments in (("mean", self._means), ("variance", self._variances)):
            for name, moment in moments.items():
                moment[:] = state[f"adam_{kind}_{name}"]

    def rate(self, progress: float) -> float:
        """Return the learning rate at ``progress`` in [0, 1]: warm-up, then exponential decay."""
        warm = min(1.0, (self._steps + 1) / self._config.warm_up_steps)
        # The rate stays high for the first third: geometry is found there.
        fall = max(0.0, (progress - 1.0 / 3.0) * 1.5)
        return self._config.learning_rate * warm * self._config.learning_rate_end**fall

    def step(self, grads: dict[str, FloatArray], progress: float) -> None:
        """Take one step along ``grads`` ``(chunks, *shape)`` by name, and clear them."""
        rate = self.rate(progress)
        self._steps += 1
        for name, values in self._values.items():
            adam_step(
                values,
                grads[name].reshape(len(grads[name]), -1),
                self._means[name],
                self._variances[name],
                np.float32(rate if name == "table" else rate * self._config.mlp_rate_share),
                np.float32(_BETA_1),
                np.float32(_BETA_2),
                np.float32(1.0 - _BETA_1**self._steps),
                np.float32(1.0 - _BETA_2**self._steps),
                np.float32(0.0 if name == "table" else self._config.mlp_weight_decay),
            )
