"""What a simulated drone's camera makes of a perfect picture: its lens, shutter and exposure.

The world is drawn once per picture, by a pinhole with somewhat wider a view (the canvas). From that
the camera takes its own picture in one resampling:

* the lens: focal length and principal point of this very drone, Brown's distortion;
* the rolling shutter: a row is read ``dt`` after the middle one, from where the camera is then,
  so a point at depth Z on the row's ray ``d`` lies at ``d + dt (w x d + v / Z)`` in the axes of the
  middle row (first order; one depth for all, as stills are taken hovering);
* the smear of the exposure time: along the flow of the picture's middle;
* exposure and white balance, which wander as automatic ones do.

Symbols: ``w`` angular rate and ``v`` velocity of the camera in its own axes (right, down, ahead);
times in seconds, displacements in pixels.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from server.geometry.cameras import TELLO_INTRINSICS, Intrinsics
from server.sim.config import CameraConfig

Array = NDArray[np.float64]
Image = NDArray[np.uint8]

# The canvas is this much wider than a lens of nominal focal length, so that no lens, distortion or
# shutter looks past its edge.
_CANVAS_FOCAL = 0.95
_NODE_PX = 16
# Lenses farther off than this many standard deviations are not sold.
_WORST_SIGMA = 2.0
# Light follows pixel values by this power.
_GAMMA = 2.2
_LEAST_SMEAR_PX = 1.0


@dataclass(frozen=True, slots=True, eq=False)
class CameraMotion:
    """How the camera moves while it takes a picture.

    Attributes:
        angular_rad_s: Angular rate ``(3,)`` about its own axes.
        velocity_m_s: Velocity ``(3,)`` along its own axes.
    """

    angular_rad_s: Array
    velocity_m_s: Array


STILL = CameraMotion(np.zeros(3), np.zeros(3))


def true_intrinsics(config: CameraConfig, seed: int, index: int) -> Intrinsics:
    """Return the lens that the drone with ``index`` really has; for the simulation alone."""
    rng = np.random.default_rng([seed, index, 11])
    focal, x, y = np.clip(rng.standard_normal(3), -_WORST_SIGMA, _WORST_SIGMA)
    known = config.calibrated
    return replace(
        known,
        fx=known.fx * (1.0 + config.focal_sigma * float(focal)),
        fy=known.fy * (1.0 + config.focal_sigma * float(focal)),
        cx=known.cx + config.principal_sigma_px * float(x),
        cy=known.cy + config.principal_sigma_px * float(y),
    )


def canvas_intrinsics(config: CameraConfig) -> Intrinsics:
    """Return the pinhole by which the world is to be drawn for ``SimulatedCamera.take``."""
    if not config.bends:
        return TELLO_INTRINSICS
    nominal = TELLO_INTRINSICS
    return replace(nominal, fx=nominal.fx * _CANVAS_FOCAL, fy=nominal.fy * _CANVAS_FOCAL)


class SimulatedCamera:
    """One drone's camera; takes pictures in order of time.

    Attributes:
        lens: Its true intrinsics.
    """

    def __init__(self, config: CameraConfig, seed: int, index: int) -> None:
        """Build the camera of the drone with ``index`` from 0."""
        self.lens = true_intrinsics(config, seed, index)
        self._config = config
        self._canvas = canvas_intrinsics(config)
        self._rng = np.random.default_rng([seed, index, 12])
        self._at_s: float | None = None
        # Logarithms of the gains: all channels, then blue and red against green.
        self._gains = np.zeros(3)
        width, height = self.lens.width, self.lens.height
        columns, rows = -(-width // _NODE_PX) + 1, -(-height // _NODE_PX) + 1
        # Nodes sit where enlarging by an integer puts them, half a cell inside their cells.
        x = (np.arange(columns) + 0.5) * _NODE_PX - 0.5
        y = (np.arange(rows) + 0.5) * _NODE_PX - 0.5
        nodes = np.stack(np.meshgrid(x, y), axis=2).reshape(-1, 2).astype(np.float64)
        rays = self.lens.directions(nodes).reshape(rows, columns, 3)
        self._rays = rays / rays[..., 2:]
        self._dt_s = ((y / (height - 1) - 0.5) * config.readout_s)[:, None, None]

    def take(self, canvas_bgr: Image, motion: CameraMotion, at_s: float) -> Image:
        """Return the picture that the camera takes of a drawn one.

        Args:
            canvas_bgr: Drawn with ``canvas_intrinsics`` from the pose of the middle row.
            motion: How the camera moves meanwhile.
            at_s: Time of the middle row, any zero.
        """
        self._wander(at_s)
        picture = canvas_bgr
        if self._config.bends:
            picture = self._bent(picture, motion)
        if self._config.exposure_s > 0.0:
            picture = _smeared(picture, self.middle_flow_px_s(motion) * self._config.exposure_s)
        if self._gains.any():
            picture = _exposed(picture, self._gains)
        return picture

    def middle_flow_px_s(self, motion: CameraMotion) -> Array:
        """Return how fast the middle of the picture moves ``(2,)`` past the camera, pixels/s."""
        w, v = motion.angular_rad_s, motion.velocity_m_s / self._config.depth_m
        return self.lens.fx * np.array([w[1] + v[0], -w[0] + v[1]])

    def _bent(self, canvas_bgr: Image, motion: CameraMotion) -> Image:
        canvas, lens = self._canvas, self.lens
        flow = np.cross(motion.angular_rad_s, self._rays)
        flow += motion.velocity_m_s / self._config.depth_m
        d = self._rays + self._dt_s * flow
        nodes = np.stack(
            [
                canvas.fx * d[..., 0] / d[..., 2] + canvas.cx,
                canvas.fy * d[..., 1] / d[..., 2] + canvas.cy,
            ],
            axis=2,
        ).astype(np.float32)
        size = (nodes.shape[1] * _NODE_PX, nodes.shape[0] * _NODE_PX)
        places = cv2.resize(nodes, size, interpolation=cv2.INTER_LINEAR)
        places = places[: lens.height, : lens.width]
        # Fixed-point places are looked up nearly twice as fast.
        whole, parts = cv2.convertMaps(places, np.empty(0), cv2.CV_16SC2)
        bent = cv2.remap(
            canvas_bgr, whole, parts, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
        return bent.astype(np.uint8, copy=False)

    def _wander(self, at_s: float) -> None:
        """Move the gains on, each an Ornstein-Uhlenbeck process."""
        config, last_s = self._config, self._at_s
        self._at_s = at_s
        sigmas = np.array([config.gain_sigma, config.balance_sigma, config.balance_sigma])
        if not sigmas.any():
            return
        keep = 0.0 if last_s is None else math.exp(-max(0.0, at_s - last_s) / config.gain_tau_s)
        kick = sigmas * math.sqrt(1.0 - keep * keep)
        self._gains = keep * self._gains + kick * self._rng.standard_normal(3)


def _smeared(image: Image, along_px: Array) -> Image:
    """Return the mean of ``image`` moved along ``along_px`` ``(2,)``, in powers of two of steps."""
    length = float(np.hypot(*along_px))
    if length < _LEAST_SMEAR_PX:
        return image
    halvings = max(1, math.ceil(math.log2(length)))
    share = 0.5
    for k in range(halvings):
        # The means of pictures moved by a half, a quarter, ... are the mean of all in between.
        x, y = (round(float(part) * share) for part in along_px)
        if x or y:
            image = _doubled(image, x, y, forward=k % 2 == 0)
        share /= 2.0
    return image


def _doubled(image: Image, x: int, y: int, *, forward: bool) -> Image:
    """Return the mean of ``image`` moved by one part of ``(x, y)`` and by the rest, backwards."""
    # Half of it each way; the odd pixel goes now this way, now that, to keep the middle in place.
    less = (abs(x) // 2, abs(y) // 2)
    more = (abs(x) - less[0], abs(y) - less[1])
    ahead, behind = (more, less) if forward else (less, more)
    one = _shifted(image, int(math.copysign(ahead[0], x)), int(math.copysign(ahead[1], y)))
    other = _shifted(image, -int(math.copysign(behind[0], x)), -int(math.copysign(behind[1], y)))
    return cv2.addWeighted(one, 0.5, other, 0.5, 0.0).astype(np.uint8, copy=False)


def _shifted(image: Image, x: int, y: int) -> Image:
    """Return ``image`` moved by whole pixels; what comes in repeats the edge."""
    if x == 0 and y == 0:
        return image
    height, width = image.shape[:2]
    padded = cv2.copyMakeBorder(
        image, max(y, 0), max(-y, 0), max(x, 0), max(-x, 0), cv2.BORDER_REPLICATE
    )
    top, left = max(-y, 0), max(-x, 0)
    return padded[top : top + height, left : left + width].astype(np.uint8, copy=False)


def _exposed(image: Image, log_gains: Array) -> Image:
    """Return ``image`` in other light: ``log_gains`` of all channels, of blue, of red."""
    gain, blue, red = log_gains
    channels = np.exp((gain + np.array([blue, 0.0, red])) / _GAMMA)
    table = np.clip(np.arange(256.0)[:, None] * channels + 0.5, 0.0, 255.0).astype(np.uint8)
    return cv2.LUT(image, table[:, None, :]).astype(np.uint8, copy=False)
