"""The last bundle adjustment of a reconstruction, and how well its poses are known afterwards.

What a general library leaves out is what a flight knows: calibrations are a per cent wrong, all
pictures of a drone share their lens, a picture taken on the move (its rows were exposed one after
another) deserves less trust than one taken hovering, and things that moved meanwhile none at all.

Symbols. Picture i has centre ``c_i`` and rotation ``R_i`` (model from camera); its drone's lens has
focal length ``f e^g`` and its principal point ``x`` pixels beside the calibrated one; a point ``X``
lies at ``Y = R_i^T (X - c_i)`` and is seen at ``f e^g Y_xy / Y_z + (x, 0)``, in pixels without
distortion. Unknowns are a turn and a shift per picture, ``(g, x)`` per lens, and the points. The
principal point's height stays: all cameras of all drones look down alike, so it cannot be told from
that tilt.

Picture i has noise ``s_i``, found from its residuals as they fall; single observations get Cauchy's
weights. With ``J_c`` and ``J_p`` the weighted derivatives by cameras and by points, the points are
eliminated (Triggs et al., "Bundle Adjustment - A Modern Synthesis", 1999, section 6.1):

    S = J_c^T J_c - J_c^T J_p (J_p^T J_p)^-1 J_p^T J_c
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.spatial.transform import Rotation

from server.geometry.cameras import Intrinsics
from server.nerf.pose_config import PoseConfig
from server.nerf.pose_mapping import Model

Array = NDArray[np.float64]
Indices = NDArray[np.int_]

_PER_CAMERA, _PER_LENS = 6, 2
# A model may be moved, turned and scaled as a whole without any change of its pictures.
_GAUGE = 7
_LEAST_NOISE_PX = 0.2
_DAMPING, _DAMPING_MAX = 1e-4, 1e6


@dataclass(frozen=True, slots=True, eq=False)
class Adjusted:
    """A reconstruction at its best.

    Attributes:
        model: Poses, points and the observations that fit.
        intrinsics: Lens of each of its pictures.
        sigma_turn: How well each rotation is known ``(m,)``, radians per axis.
        sigma_shift: How well each centre is known ``(m,)``, model units per axis. Both hold after
            the similarity that fits best, and for independent observations.
    """

    model: Model
    intrinsics: tuple[Intrinsics, ...]
    sigma_turn: Array
    sigma_shift: Array


def adjust(
    model: Model, intrinsics: Sequence[Intrinsics], drone: Indices, config: PoseConfig
) -> Adjusted:
    """Adjust a reconstruction of m pictures.

    Args:
        model: What structure from motion found.
        intrinsics: Calibrated camera of each of its pictures.
        drone: Drone of each of its pictures ``(m,)``.
        config: How lenses and outliers are treated.
    """
    bundle = _Bundle(model, intrinsics, drone, config)
    damping = _DAMPING
    cost = bundle.cost()
    for _ in range(config.adjustments):
        bundle.weigh()
        cost = bundle.cost()
        while damping <= _DAMPING_MAX:
            kept = bundle.state
            bundle.step(damping)
            tried = bundle.cost()
            if tried < cost:
                damping = max(damping / 10.0, 1e-9)
                break
            bundle.state = kept
            damping *= 10.0
        else:
            break
        if cost - tried < 1e-4 * cost:
            break
    return bundle.adjusted()


@dataclass(frozen=True, slots=True, eq=False)
class _State:
    """Rotations ``(m, 3, 3)``, centres ``(m, 3)``, lenses ``(d, 2)``, points ``(p, 3)``."""

    R: Array
    c: Array
    lenses: Array
    points: Array


class _Bundle:
    """The unknowns of one reconstruction and what the pictures say about them."""

    def __init__(
        self,
        model: Model,
        intrinsics: Sequence[Intrinsics],
        drone: Indices,
        config: PoseConfig,
    ) -> None:
        self._model, self._config = model, config
        self._cameras = list(intrinsics)
        keys = list(zip(drone.tolist(), self._cameras, strict=True))
        kinds = {key: k for k, key in enumerate(dict.fromkeys(keys))}
        self._lens = np.array([kinds[key] for key in keys])
        self._picture = model.observations[:, 0].astype(int)
        self._point = model.observations[:, 1].astype(int)
        centres = model.T_model_cam[:, :3, 3]
        # Shifts are counted in the spread of the cameras, so that they weigh like turns.
        self._size = max(float(np.sqrt(((centres - centres.mean(0)) ** 2).sum(1).mean())), 1e-12)
        self._f = np.array([camera.fx for camera in self._cameras])
        self._seen = np.empty((len(self._picture), 2))
        for i, camera in enumerate(self._cameras):
            rows = self._picture == i
            rays = camera.directions(model.observations[rows, 2:])
            self._seen[rows] = camera.fx * rays[:, :2] / rays[:, 2:]
        few = np.bincount(self._lens) < config.min_focal_pictures
        sigmas = np.array([config.focal_sigma, config.principal_sigma_px])
        # What is not to be found is held where it is by a prior that nothing moves.
        self._prior = np.where(few[:, None] | (not config.refine_lens), 1e-9, sigmas)
        self.state = _State(
            model.T_model_cam[:, :3, :3],
            centres,
            np.zeros((len(kinds), _PER_LENS)),
            model.points_model,
        )
        self._noise = np.ones(len(model.indices))
        self.weigh()

    def residuals(self) -> Array:
        """Return seen minus expected places ``(o, 2)``, pixels."""
        Y, f = self._in_camera()
        expected = f[:, None] * Y[:, :2] / Y[:, 2:]
        expected[:, 0] += self.state.lenses[self._lens[self._picture], 1]
        return self._seen - expected

    def weigh(self) -> None:
        """Find each picture's noise, and from it the weight of every observation."""
        lengths = np.linalg.norm(self.residuals(), axis=1)
        for i in range(len(self._noise)):
            own = lengths[self._picture == i]
            # The median length of a two-dimensional normal deviation is 1.177 of it.
            noise = float(np.median(own)) / 1.177 if len(own) else 1.0
            self._noise[i] = max(noise, _LEAST_NOISE_PX)

    def cost(self) -> float:
        """Return the sum of Cauchy's losses and of the priors."""
        noise = self._noise[self._picture]
        square = (self.residuals() ** 2).sum(axis=1) / noise**2
        k = self._config.robust_noises**2
        of_lenses = float(((self.state.lenses / self._prior) ** 2).sum())
        return float((k * np.log1p(square / k)).sum()) + of_lenses

    def step(self, damping: float) -> None:
        """Take one damped Gauss-Newton step."""
        residuals, J_c, J_p = self._derivatives()
        S, b_c, V_inverse, W, b_p = self._reduced(residuals, J_c, J_p)
        scale = damping * np.diag(S).clip(1e-12)
        move = np.linalg.solve(S + np.diag(scale), b_c)
        points = V_inverse @ (b_p - W.T @ move)
        m = len(self._cameras)
        of_pictures = move[: _PER_CAMERA * m].reshape(m, _PER_CAMERA)
        state = self.state
        turns = Rotation.from_rotvec(of_pictures[:, :3]).as_matrix()
        self.state = _State(
            state.R @ turns,
            state.c + self._size * of_pictures[:, 3:],
            state.lenses + move[_PER_CAMERA * m :].reshape(-1, _PER_LENS),
            state.points + self._size * np.asarray(points).reshape(-1, 3),
        )

    def adjusted(self) -> Adjusted:
        """Return the reconstruction without the observations that do not fit."""
        self.weigh()
        state, m = self.state, len(self._cameras)
        residuals, J_c, J_p = self._derivatives()
        S = self._reduced(residuals, J_c, J_p)[0]
        values, vectors = np.linalg.eigh(S)
        spread = 1.0 / np.sqrt(np.maximum(values[_GAUGE:], values[-1] * 1e-14))
        deviations = self._after_similarity(vectors[: _PER_CAMERA * m, _GAUGE:] * spread)
        # Fitted points take a part of the noise with them: residuals alone would promise too much.
        free = max(len(residuals) - len(S) - state.points.size, 0.1 * len(residuals))
        variances = (deviations**2).sum(axis=1).reshape(m, 2, 3) * len(residuals) / free
        turn, shift = np.sqrt(variances.mean(axis=2)).T
        T = np.tile(np.eye(4), (m, 1, 1))
        T[:, :3, :3], T[:, :3, 3] = state.R, state.c
        lengths = np.linalg.norm(self.residuals(), axis=1)
        fits = lengths <= self._config.max_reprojection_error_px
        model = Model(self._model.indices, T, state.points, self._model.observations[fits])
        lenses = state.lenses[self._lens]
        intrinsics = tuple(
            replace(
                camera,
                fx=camera.fx * float(np.exp(g)),
                fy=camera.fy * float(np.exp(g)),
                cx=camera.cx + float(x),
            )
            for camera, (g, x) in zip(self._cameras, lenses, strict=True)
        )
        return Adjusted(model, intrinsics, turn, shift * self._size)

    def _after_similarity(self, deviations: Array) -> Array:
        """Return deviations ``(6 m, k)`` after the similarity that brings the centres back best.

        This is the gauge in which poses are compared with others (Baarda's S-transformation).
        """
        state, m = self.state, len(self._cameras)
        centres = (state.c - state.c.mean(axis=0)) / self._size
        gauge = np.zeros((m, 2, 3, _GAUGE))
        gauge[:, 1, :, 0:3] = np.eye(3)
        for axis, unit in enumerate(np.eye(3)):
            gauge[:, 0, :, 3 + axis] = np.swapaxes(state.R, 1, 2) @ unit
            gauge[:, 1, :, 3 + axis] = np.cross(unit, centres)
        gauge[:, 1, :, 6] = centres
        of_shifts = gauge[:, 1].reshape(3 * m, _GAUGE)
        shifts = deviations.reshape(m, 2, 3, -1)[:, 1].reshape(3 * m, -1)
        whole = gauge.reshape(_PER_CAMERA * m, _GAUGE)
        return deviations - whole @ (np.linalg.pinv(of_shifts) @ shifts)

    def _in_camera(self) -> tuple[Array, Array]:
        """Return all observed points in camera axes ``(o, 3)`` and their focal lengths ``(o,)``."""
        state = self.state
        offset = state.points[self._point] - state.c[self._picture]
        Y = np.einsum("oji,oj->oi", state.R[self._picture], offset)
        Y[:, 2] = np.maximum(Y[:, 2], 1e-6 * self._size)
        return Y, (self._f * np.exp(state.lenses[self._lens, 0]))[self._picture]

    def _derivatives(self) -> tuple[Array, csr_array, csr_array]:
        """Return weighted residuals ``(2 o,)`` and derivatives of what is expected."""
        picture, m = self._picture, len(self._cameras)
        Y, f = self._in_camera()
        flat = Y[:, :2] / Y[:, 2:]
        by_Y = np.zeros((len(Y), 2, 3))
        by_Y[:, 0, 0] = by_Y[:, 1, 1] = f / Y[:, 2]
        by_Y[:, :, 2] = -(f / Y[:, 2])[:, None] * flat
        cross = np.zeros((len(Y), 3, 3))
        for a, b, c in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
            cross[:, a, b], cross[:, b, a] = -Y[:, c], Y[:, c]
        by_point = self._size * by_Y @ np.swapaxes(self.state.R, 1, 2)[picture]
        by_lens = np.zeros((len(Y), 2, _PER_LENS))
        by_lens[:, :, 0] = f[:, None] * flat
        by_lens[:, 0, 1] = 1.0
        # A turn by w on the camera's side carries a point from Y to Y - w x Y = Y + [Y]x w.
        blocks = np.concatenate([by_Y @ cross, -by_point, by_lens], axis=2)
        columns = np.concatenate(
            [
                _PER_CAMERA * picture[:, None] + np.arange(_PER_CAMERA),
                _PER_CAMERA * m + _PER_LENS * self._lens[picture][:, None] + np.arange(_PER_LENS),
            ],
            axis=1,
        )
        residuals = self.residuals()
        noise = self._noise[picture]
        square = (residuals**2).sum(axis=1) / noise**2
        root = 1.0 / (noise * np.sqrt(1.0 + square / self._config.robust_noises**2))
        wide = _PER_CAMERA * m + _PER_LENS * len(self.state.lenses)
        J_c = _sparse(root[:, None, None] * blocks, columns, wide)
        places = 3 * self._point[:, None] + np.arange(3)
        J_p = _sparse(root[:, None, None] * by_point, places, 3 * len(self.state.points))
        return (root[:, None] * residuals).ravel(), J_c, J_p

    def _reduced(
        self, residuals: Array, J_c: csr_array, J_p: csr_array
    ) -> tuple[Array, Array, csr_array, csr_array, Array]:
        """Return S, its right side, the points' inverse blocks, the coupling, the points' side."""
        points = len(self.state.points)
        # A point's three columns meet in a block of their own: its inverse is taken alone.
        V = np.zeros((points, 3, 3))
        normal = (J_p.T @ J_p).tocoo()
        V[normal.row // 3, normal.row % 3, normal.col % 3] = normal.data
        V += np.eye(3) * (1e-7 * np.trace(V, axis1=1, axis2=2)[:, None, None] + 1e-12)
        place = 3 * np.arange(points)[:, None, None]
        rows = np.broadcast_to(place + np.arange(3)[:, None], V.shape).ravel()
        columns = np.broadcast_to(place + np.arange(3), V.shape).ravel()
        V_inverse = csr_array((np.linalg.inv(V).ravel(), (rows, columns)))
        W = (J_c.T @ J_p).tocsr()
        WV = W @ V_inverse
        b_p = J_p.T @ residuals
        weight = np.zeros(_PER_CAMERA * len(self._cameras) + self._prior.size)
        of_lenses = (1.0 / self._prior**2).ravel()
        weight[-len(of_lenses) :] = of_lenses
        right = J_c.T @ residuals - WV @ b_p
        right[-len(of_lenses) :] -= of_lenses * self.state.lenses.ravel()
        S = (J_c.T @ J_c - WV @ W.T).toarray() + np.diag(weight)
        return S, right, V_inverse, W, b_p


def _sparse(blocks: Array, columns: Indices, width: int) -> csr_array:
    """Return rows of ``blocks`` ``(o, 2, k)`` at ``columns`` ``(o, k)``."""
    rows = np.arange(2 * len(blocks)).reshape(-1, 2, 1)
    row, column = np.broadcast_arrays(rows, columns[:, None, :])
    shape = (2 * len(blocks), width)
    return csr_array((blocks.ravel(), (row.ravel(), column.ravel())), shape=shape)
