"""Carries a reconstruction, known up to a similarity, into the world the drones believed in.

Symbols. A model has camera poses ``(R_i, x_i)`` in a frame of its own; ``s, R, t`` is the wanted
similarity, so that ``y_i = s R x_i + t`` are camera centres in the world, metres, +Z up. The
flight believed ``(P_i, c_i)`` instead. Its errors are of three kinds and are modelled as such:

* what all pictures of drone d share, because it was set down wrongly: an offset ``o_d`` and a turn
  ``psi_d`` about the vertical, both unknown, with known spread;
* what is new in each picture: the position and heading sigma of that picture;
* pitch and roll, which the drone measures against gravity: small and alike for all.

    c_i ~ p_d + Rz(psi_d) (y_i - p_d) + o_d        p_d: mean of the y_i of drone d
    P_i ~ Rz(psi_d) R R_i

All unknowns are found together by least squares with iteratively re-weighted pictures and drones,
so that a drone (or a picture) with a wrong belief moves the world frame little.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from server.geometry.poses import Similarity
from server.nerf.pose_config import PoseConfig

Array = NDArray[np.float64]

_ROUNDS = 8  # Re-weighting has settled to below a millimetre by then.
_PER_DRONE = 4  # Unknowns per drone: offset (3) and turn.


class ScaleUnknownError(ValueError):
    """A model whose cameras stand too close together for their beliefs to tell its scale."""


@dataclass(frozen=True, slots=True, eq=False)
class Beliefs:
    """What the flight believed about some pictures.

    Attributes:
        T_world_cam: Poses ``(n, 4, 4)``.
        drone: Number of the drone of each picture ``(n,)``, int.
        sigma_m: Position spread of each picture ``(n,)``, metres.
        sigma_rad: Heading spread of each picture ``(n,)``, radians.
    """

    T_world_cam: Array
    drone: NDArray[np.int_]
    sigma_m: Array
    sigma_rad: Array

    def subset(self, indices: NDArray[np.int_]) -> Beliefs:
        """Return the beliefs about the pictures ``indices``."""
        return Beliefs(
            self.T_world_cam[indices],
            self.drone[indices],
            self.sigma_m[indices],
            self.sigma_rad[indices],
        )


def _mean_rotation(rotations: Array) -> Rotation:
    """Return the rotation with the smallest sum of angles to ``rotations`` ``(n, 3, 3)``."""
    R = Rotation.from_matrix(rotations)
    weights = np.ones(len(rotations))
    mean = R.mean(weights)
    for _ in range(10):
        weights = 1.0 / np.maximum((R * mean.inv()).magnitude(), 1e-3)
        mean = R.mean(weights)
    return mean


def _first_guess(T_model_cam: Array, beliefs: Beliefs) -> Similarity:
    """Return a similarity good to a few degrees and per cent: rotations first, then distances.

    Raises:
        ScaleUnknownError: If the camera centres are too close together to tell the scale.
    """
    x, c = T_model_cam[:, :3, 3], beliefs.T_world_cam[:, :3, 3]
    R = _mean_rotation(
        beliefs.T_world_cam[:, :3, :3] @ np.swapaxes(T_model_cam[:, :3, :3], 1, 2)
    ).as_matrix()
    spread = float(np.sqrt(((c - c.mean(0)) ** 2).sum(1).mean()))
    spread_model = float(np.sqrt(((x - x.mean(0)) ** 2).sum(1).mean()))
    if spread < float(np.median(beliefs.sigma_m)) or spread_model < 1e-9:
        raise ScaleUnknownError("the camera centres are too close together to tell the scale")
    i, j = np.triu_indices(len(x), 1)
    d_model = np.linalg.norm(x[i] - x[j], axis=1)
    d_world = np.linalg.norm(c[i] - c[j], axis=1)
    # Far pairs only: their ratio suffers least from errors of the single positions.
    far = d_model >= np.quantile(d_model, 0.5)
    scale = float(np.median(d_world[far] / np.maximum(d_model[far], 1e-12)))
    if scale <= 1e-9:
        raise ScaleUnknownError("the believed camera centres coincide")
    return Similarity(scale, R, np.median(c - scale * x @ R.T, axis=0))


class _Problem:
    """The residuals above over the unknowns ``(log s, rotvec, t, o_d, psi_d)``."""

    def __init__(
        self, T_model_cam: Array, beliefs: Beliefs, first: Similarity, config: PoseConfig
    ) -> None:
        self._R_first = Rotation.from_matrix(first.R)
        self._x = T_model_cam[:, :3, 3]
        self._R_model = Rotation.from_matrix(T_model_cam[:, :3, :3])
        self._c = beliefs.T_world_cam[:, :3, 3]
        self._P = Rotation.from_matrix(beliefs.T_world_cam[:, :3, :3])
        _, self._drone = np.unique(beliefs.drone, return_inverse=True)
        self.drones = int(self._drone.max()) + 1
        self._counts = np.bincount(self._drone).astype(float)
        self._sigma_m = np.maximum(beliefs.sigma_m, config.picture_sigma_floor_m)[:, None]
        sigma_yaw = np.maximum(beliefs.sigma_rad, config.yaw_sigma_floor_rad)
        tilt = np.full(len(sigma_yaw), config.tilt_sigma_rad)
        self._sigma_rotation = np.stack([tilt, tilt, sigma_yaw], axis=1)
        self._sigma_drone = np.array(
            [config.drone_offset_sigma_m] * 3 + [config.drone_yaw_sigma_rad]
        )
        self.start = np.concatenate(
            [[np.log(first.scale)], np.zeros(3), first.t, np.zeros(_PER_DRONE * self.drones)]
        )

    def similarity(self, unknowns: Array) -> Similarity:
        """Return the similarity within the ``unknowns``."""
        R = Rotation.from_rotvec(unknowns[1:4]) * self._R_first
        return Similarity(float(np.exp(unknowns[0])), R.as_matrix(), unknowns[4:7])

    def residuals(self, unknowns: Array) -> tuple[Array, Array]:
        """Return whitened residuals of the pictures ``(n, 6)`` and of the drones ``(k, 4)``."""
        similarity = self.similarity(unknowns)
        per_drone = unknowns[7:].reshape(self.drones, _PER_DRONE)
        offset, turn = per_drone[:, :3], per_drone[:, 3]
        y = similarity.points(self._x)
        pivot = np.stack(
            [np.bincount(self._drone, y[:, a], self.drones) / self._counts for a in range(3)],
            axis=1,
        )[self._drone]
        Rz = Rotation.from_rotvec(turn[self._drone, None] * [0.0, 0.0, 1.0])
        centres = pivot + Rz.apply(y - pivot) + offset[self._drone]
        R_error = self._P * (Rz * Rotation.from_matrix(similarity.R) * self._R_model).inv()
        of_pictures = np.concatenate(
            [(self._c - centres) / self._sigma_m, R_error.as_rotvec() / self._sigma_rotation],
            axis=1,
        )
        return of_pictures, per_drone / self._sigma_drone

    def solve(self, unknowns: Array, w_pictures: Array, w_drones: Array) -> Array:
        """Return the least-squares unknowns for fixed weights ``(n,)`` and ``(k,)``."""
        root_p, root_d = np.sqrt(w_pictures)[:, None], np.sqrt(w_drones)[:, None]

        def weighted(x: Array) -> Array:
            of_pictures, of_drones = self.residuals(x)
            return np.concatenate([(root_p * of_pictures).ravel(), (root_d * of_drones).ravel()])

        return least_squares(weighted, unknowns, method="trf", x_scale="jac", max_nfev=20).x


def align_to_beliefs(T_model_cam: Array, beliefs: Beliefs, config: PoseConfig) -> Similarity:
    """Return the similarity that carries a model into the world (see the module docstring).

    Args:
        T_model_cam: Camera poses ``(n, 4, 4)`` in the frame of the model, n >= 3.
        beliefs: The same pictures as the flight believed them.
        config: Spreads of the errors.

    Raises:
        ValueError: With fewer than three pictures.
        ScaleUnknownError: When the centres are too close together to tell the scale.
    """
    if len(T_model_cam) < 3:
        raise ValueError("aligning a model needs at least three pictures")
    first = _first_guess(T_model_cam, beliefs)
    problem = _Problem(T_model_cam, beliefs, first, config)
    unknowns = problem.start
    w_pictures, w_drones = np.ones(len(T_model_cam)), np.ones(problem.drones)
    for _ in range(_ROUNDS):
        unknowns = problem.solve(unknowns, w_pictures, w_drones)
        of_pictures, of_drones = problem.residuals(unknowns)
        # Cauchy weights on whole pictures and whole drones: half weight at the expected size.
        w_pictures = 1.0 / (1.0 + (of_pictures**2).sum(1) / of_pictures.shape[1])
        w_drones = 1.0 / (1.0 + (of_drones**2).sum(1) / of_drones.shape[1])
    return problem.similarity(unknowns)


def carry_corrections(
    T_world_cam: Array,
    T_refined: Array,
    refined: NDArray[np.bool_],
    drone: NDArray[np.int_],
    at_s: Array,
) -> Array:
    """Return poses ``(n, 4, 4)``: the refined ones, and the others moved as their neighbours were.

    A picture that could not be registered is given the correction (shift of the centre, turn of
    the camera) of its drone's refined pictures before and after it, interpolated in time; without
    such pictures it keeps its believed pose.

    Args:
        T_world_cam: Believed poses ``(n, 4, 4)``.
        T_refined: Refined poses ``(n, 4, 4)``; only those of ``refined`` are read.
        refined: Which poses were refined ``(n,)``.
        drone: The drone of each picture ``(n,)``.
        at_s: When each picture was taken ``(n,)``, seconds.
    """
    out = np.where(refined[:, None, None], T_refined, T_world_cam)
    for d in np.unique(drone):
        known = np.flatnonzero(refined & (drone == d))
        missing = np.flatnonzero(~refined & (drone == d))
        if not len(known):
            continue
        known = known[np.argsort(at_s[known], kind="stable")]
        shifts = T_refined[known, :3, 3] - T_world_cam[known, :3, 3]
        turns = Rotation.from_matrix(
            T_refined[known, :3, :3] @ np.swapaxes(T_world_cam[known, :3, :3], 1, 2)
        ).as_rotvec()
        for i in missing:
            shift = [np.interp(at_s[i], at_s[known], shifts[:, a]) for a in range(3)]
            turn = [np.interp(at_s[i], at_s[known], turns[:, a]) for a in range(3)]
            out[i, :3, 3] = T_world_cam[i, :3, 3] + shift
            out[i, :3, :3] = Rotation.from_rotvec(turn).as_matrix() @ T_world_cam[i, :3, :3]
    return out
