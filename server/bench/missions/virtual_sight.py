"""Pictures without pixels: what the cameras of a simulation in virtual time show.

The stage Frame -> Box is replaced. A virtual picture is one datagram with a number; its decoder
makes a tiny ``Frame`` whose pixels are that number; the eye looks up the true camera pose of that
moment and projects the object, with the errors a region search makes: noise, a slowly wandering
bias, wrong places (outliers), no result (drop-outs), and for many seconds at a time a part of the
object, or more than the object, taken for the whole of it. Loss of the datagram is loss of the
picture and damages those up to the next key picture, as in a real stream.

Truth enters here, as it enters a lens; nothing else of the mission sees it.
"""

from __future__ import annotations

import struct
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from server.geometry.cameras import Intrinsics
from server.mission.events import FrameAnnotated
from server.mission.eyes import Sight
from server.sim.tello import Tello
from server.stages import Box, Frame, Region
from server.swarm.drone import Drone
from server.vision.region import RegionPrior

Array = NDArray[np.float64]

FPS = 6.0
_KEY_EVERY = 6
_PICTURE = struct.Struct(">4sI?")
_MAGIC = b"VPIC"
_MASK_SCALE = 8.0
_POSES_KEPT = 64
_NEAREST_M = 0.1


@dataclass(frozen=True, slots=True)
class SightErrors:
    """What is wrong with the boxes of a virtual eye.

    Attributes:
        edge_px: Standard deviation of each edge of the box, pixels.
        bias_px: Of the slowly wandering offset of the whole box, pixels.
        bias_s: How long an offset lasts, seconds.
        outliers: Share of boxes that are somewhere else.
        drop_outs: Share of pictures without a box.
        extent: While something else than the whole object is taken for it, each edge is this
            factor's exponential nearer to or farther from the object's middle: its standard
            deviation. Much too large is as frequent as much too small, and further off.
        extent_share: Share of the time during which that is so.
        extent_s: How long one extent is seen on average, seconds.
    """

    edge_px: float = 8.0
    bias_px: float = 15.0
    bias_s: float = 5.0
    outliers: float = 0.02
    drop_outs: float = 0.1
    extent: float = 0.45
    extent_share: float = 0.6
    extent_s: float = 50.0


class VirtualCamera:
    """Numbers the pictures of one drone and remembers where each was taken.

    Attributes:
        lens: Its true intrinsics, which the mission does not know.
    """

    def __init__(self, tello: Tello) -> None:
        self.lens = tello.lens
        self._tello = tello
        self._count = 0
        self._poses: OrderedDict[int, Array] = OrderedDict()

    def shoot(self, now_s: float) -> list[bytes]:
        """Take a picture and return its datagrams."""
        number = self._count
        self._count += 1
        self._poses[number] = self._tello.airframe.T_world_cam()
        if len(self._poses) > _POSES_KEPT:
            self._poses.popitem(last=False)
        return [_PICTURE.pack(_MAGIC, number, number % _KEY_EVERY == 0)]

    def pose_of(self, number: int) -> Array | None:
        """Return the true camera pose ``(4, 4)`` of a picture, None when it is long gone."""
        return self._poses.get(number)


class VirtualDecoder:
    """Turns virtual pictures into frames; stands in for the H.264 decoder."""

    def __init__(self, drone_id: str, on_frame: Callable[[Frame], None]) -> None:
        self.overflows = 0  # Nothing waits here.
        self._drone_id = drone_id
        self._on_frame = on_frame
        self._sequence = 0
        self._next: int | None = None
        self._damaged = True

    async def __aenter__(self) -> VirtualDecoder:
        return self

    async def __aexit__(self, *_: object) -> None:
        pass

    def feed(self, datagram: bytes, arrived_s: float) -> None:
        """Take one datagram."""
        try:
            magic, number, key = _PICTURE.unpack(datagram)
        except struct.error:
            return
        if magic != _MAGIC:
            return
        if self._next is not None and number < self._next:
            return  # A copy, or one that others have overtaken: a real stream would be damaged.
        if key:
            self._damaged = False
        elif number != self._next:
            self._damaged = True
        self._next = number + 1
        image = np.frombuffer(struct.pack(">III", number, 0, 0), np.uint8).reshape(2, 2, 3)
        self._on_frame(Frame(self._drone_id, self._sequence, arrived_s, image, self._damaged))
        self._sequence += 1


class VirtualEye:
    """Looks through a drone's virtual camera; an ``Eye``."""

    def __init__(
        self,
        drone: Drone,
        camera: VirtualCamera,
        object_points: Array,
        errors: SightErrors,
        rng: np.random.Generator,
    ) -> None:
        """Build it; ``object_points`` are ``(n, 3)`` world metres on the object's hull."""
        self.sight: Sight | None = None
        self.annotated: FrameAnnotated | None = None
        self._drone = drone
        self._camera = camera
        self._points = object_points
        self._errors = errors
        self._rng = rng
        # Of its own, so that the other errors of a seed do not depend on it.
        self._extents = rng.spawn(1)[0]
        self._bias = errors.bias_px * rng.standard_normal(2)
        self._extent = self._drawn_extent()

    def expect(self, prior: RegionPrior | None) -> None:
        """Take no hint: this eye needs none."""

    def point_out(self, xyxy_px: Array | None) -> None:
        """Take no hint: this eye needs none."""

    async def run(self) -> None:
        """Look at pictures for ever."""
        sequence = -1
        while True:
            frame = await self._drone.next_frame(sequence)
            sequence = frame.sequence
            region, box = None, None
            if not frame.damaged:
                region, box = self._look(frame)
            self.sight = Sight(frame, region, box)

    def _look(self, frame: Frame) -> tuple[Region | None, Box | None]:
        number = int.from_bytes(frame.image_bgr.tobytes()[:4])
        T_world_cam = self._camera.pose_of(number)
        errors, rng = self._errors, self._rng
        keep = np.exp(-1.0 / (FPS * errors.bias_s))
        kick = errors.bias_px * np.sqrt(1.0 - keep * keep)
        self._bias = keep * self._bias + kick * rng.standard_normal(2)
        if self._extents.random() < 1.0 / (FPS * errors.extent_s):
            self._extent = self._drawn_extent()
        if T_world_cam is None or rng.random() < errors.drop_outs:
            return None, None
        intrinsics = self._camera.lens
        pixels, depths = intrinsics.project(self._points, T_world_cam)
        if (depths < _NEAREST_M).any():
            return None, None
        pixels = _stretched(pixels, self._extent) + self._bias
        if rng.random() < errors.outliers:
            pixels = pixels + rng.uniform(-300.0, 300.0, 2)
        return _seen(pixels, intrinsics, errors.edge_px * rng.standard_normal(4))

    def _drawn_extent(self) -> Array:
        """Return by which factors the lower and upper edges ``(2, 2)`` are off the middle."""
        errors, rng = self._errors, self._extents
        if rng.random() >= errors.extent_share:
            return np.ones((2, 2))
        return np.exp(errors.extent * rng.standard_normal((2, 2)))


def _stretched(pixels: Array, factors: Array) -> Array:
    """Return ``pixels`` ``(n, 2)``, those before and behind the middle moved by ``(2, 2)``."""
    middle = (pixels.min(axis=0) + pixels.max(axis=0)) / 2.0
    off = pixels - middle
    return middle + off * np.where(off < 0.0, factors[0], factors[1])


def _seen(
    pixels: Array, intrinsics: Intrinsics, noise_px: Array
) -> tuple[Region | None, Box | None]:
    size = np.array([intrinsics.width, intrinsics.height], float)
    lower, upper = pixels.min(axis=0) + noise_px[:2], pixels.max(axis=0) + noise_px[2:]
    inside = np.minimum(upper, size - 1.0) - np.maximum(lower, 0.0)
    if (inside < 12.0).any():
        return None, None  # Out of the picture, or nearly.
    touches = bool((lower < 2.0).any() or (upper > size - 3.0).any())
    lower, upper = np.maximum(lower, 0.0), np.minimum(upper, size - 1.0)
    shape = (int(intrinsics.height / _MASK_SCALE), int(intrinsics.width / _MASK_SCALE))
    mask = np.zeros(shape, np.uint8)
    outline = cv2.convexHull((pixels / _MASK_SCALE).astype(np.int32).reshape(-1, 1, 2))
    cv2.fillConvexPoly(mask, outline, 1)
    confidence = 0.8
    box = Box(np.concatenate([lower, upper]), confidence, touches)
    sigma_px = float(np.sqrt(np.prod(upper - lower))) / 3.0
    region = Region(
        (lower + upper) / 2.0, sigma_px, 50.0, mask.astype(bool), _MASK_SCALE, confidence
    )
    return region, box


def hull_points(vertices: Array) -> Array:
    """Return the points ``(n, 3)`` of the convex hull of ``vertices`` ``(m, 3)``."""
    return vertices[ConvexHull(vertices).vertices]
