"""The values that flow from stage to stage, one frozen dataclass per noun, in the order they arise.

``datagram -> Telemetry, Frame -> Region -> Box -> SeedGeometry -> Placement -> Assignment ->
Setpoint -> (drone moves)`` and ``Box, Telemetry -> CameraPose -> Capture -> dataset -> field ->
Preview, Metrics``.

Frames and units: see ``server.geometry.axes``. Times named ``*_s`` are seconds of the monotonic
clock of this process unless said otherwise.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from typing import Literal, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from server.geometry.boxes import Box3
from server.geometry.cameras import Intrinsics
from server.geometry.poses import camera_pose, yaw_of_camera

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Telemetry:
    """One state report of a drone, in our units and axes.

    Attributes:
        drone_id: Which drone.
        received_s: When its datagram arrived.
        yaw_rad: Heading since power-on as the drone believes it, counter-clockwise positive.
        pitch_rad: Nose-up positive.
        roll_rad: Right-side-down positive.
        velocity_m_s: Body FLU velocity ``(3,)``.
        acceleration_m_s2: Body FLU specific force ``(3,)``; at rest about ``(0, 0, 9.81)``.
        height_m: Height above the take-off point, in the drone's coarse steps.
        tof_m: Distance to the ground below, or None when the sensor saw nothing.
        baro_m: Barometric height with an arbitrary zero.
        battery_pct: Charge in percent.
        temperature_c: Highest board temperature.
        motor_time_s: Seconds the motors have run since power-on.
    """

    drone_id: str
    received_s: float
    yaw_rad: float
    pitch_rad: float
    roll_rad: float
    velocity_m_s: Array
    acceleration_m_s2: Array
    height_m: float
    tof_m: float | None
    baro_m: float
    battery_pct: int
    temperature_c: float
    motor_time_s: float


class Picture(Protocol):
    """A decoded picture that is converted as it is needed; may be used from any thread."""

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height."""
        ...

    def bgr(self) -> NDArray[np.uint8]:
        """Return the whole picture ``(h, w, 3)``."""
        ...

    def reduced_bgr(self, width_px: int, height_px: int) -> NDArray[np.uint8]:
        """Return the picture ``(height_px, width_px, 3)``, each pixel the mean of its area."""
        ...


@dataclass(frozen=True, slots=True)
class CodedPicture:
    """A picture as the drone sent it, for whoever decodes it again.

    Attributes:
        data: H.264, Annex-B bytes of one access unit.
        key: True when it and its parameter sets can be decoded without any other.
        number: Counts the coded pictures of its drone; it can be decoded after its predecessor
            alone, or when it is a key picture.
    """

    data: bytes
    key: bool
    number: int


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """One decoded video picture.

    Attributes:
        drone_id: Which drone.
        sequence: Counts decoded pictures of this drone from 0.
        captured_s: Arrival of the picture's first datagram.
        picture: What was decoded, or the same as an array ``(h, w, 3)`` BGR uint8.
        damaged: True when data was lost since the last key frame; such a picture may be shown but
            never enters a dataset.
        completed_s: Arrival of the picture's last datagram, None when that is unknown.
        coded: What was decoded, with those before it that nobody looked at, oldest first; empty
            when it came otherwise.
    """

    drone_id: str
    sequence: int
    captured_s: float
    picture: Picture | NDArray[np.uint8]
    damaged: bool
    completed_s: float | None = None
    coded: tuple[CodedPicture, ...] = ()

    @property
    def image_bgr(self) -> NDArray[np.uint8]:
        """The whole picture ``(h, w, 3)`` uint8; not for free, unlike ``reduced_bgr``."""
        return self.picture if isinstance(self.picture, np.ndarray) else self.picture.bgr()

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height of the whole picture."""
        if isinstance(self.picture, np.ndarray):
            return self.picture.shape[1], self.picture.shape[0]
        return self.picture.size_px

    def reduced_bgr(self, width_px: int, height_px: int) -> NDArray[np.uint8]:
        """Return the picture ``(height_px, width_px, 3)``, each pixel the mean of its area."""
        if not isinstance(self.picture, np.ndarray):
            return self.picture.reduced_bgr(width_px, height_px)
        size = (width_px, height_px)
        reduced = cv2.resize(self.picture, size, interpolation=cv2.INTER_AREA)
        return reduced.astype(np.uint8, copy=False)


@dataclass(frozen=True, slots=True, eq=False)
class Region:
    """The largest region of a picture (equations 1-3): the object as one drone sees it.

    Attributes:
        centre_px: ``(2,)`` x, y of the scale-space maximum, full-picture pixels.
        sigma_px: Scale of the maximum, full-picture pixels.
        response: Magnitude of the scale-normalised Laplacian there, in grey levels.
        mask: bool ``(h / mask_scale, w / mask_scale)``, True on the object.
        mask_scale: Full-picture pixels per mask pixel.
        confidence: 0 (nothing there) to 1.
    """

    centre_px: Array
    sigma_px: float
    response: float
    mask: NDArray[np.bool_]
    mask_scale: float
    confidence: float


@dataclass(frozen=True, slots=True, eq=False)
class Box:
    """The upright bounding rectangle of a region.

    Attributes:
        xyxy_px: ``(4,)`` left, top, right, bottom, full-picture pixels.
        confidence: That of its region.
        touches_edge: True when the object may go on beyond the picture.
    """

    xyxy_px: Array
    confidence: float
    touches_edge: bool

    @property
    def centroid_px(self) -> Array:
        """Centre ``(2,)`` of the box, the paper's C_box."""
        return (self.xyxy_px[:2] + self.xyxy_px[2:]) / 2.0

    @property
    def size_px(self) -> Array:
        """Width and height ``(2,)``."""
        return self.xyxy_px[2:] - self.xyxy_px[:2]


@dataclass(frozen=True, slots=True, eq=False)
class CameraPose:
    """Where a drone's camera is believed to be.

    The drone itself is treated as being at its camera, 3.5 cm from its body centre; every safety
    margin is far wider than that.

    Attributes:
        drone_id: Which drone.
        at_s: The time the estimate is for.
        T_world_cam: ``(4, 4)`` OpenCV camera to world.
        covariance: ``(4, 4)`` of (x, y, z, yaw), metres and radians.
    """

    drone_id: str
    at_s: float
    T_world_cam: Array
    covariance: Array

    @property
    def position_world(self) -> Array:
        """Camera centre ``(3,)``, world metres."""
        return self.T_world_cam[:3, 3]

    @property
    def yaw_rad(self) -> float:
        """Heading, counter-clockwise about +Z."""
        return yaw_of_camera(self.T_world_cam)

    @property
    def position_sigma_m(self) -> float:
        """Root of the mean position variance, metres."""
        # Plain arithmetic: this is asked for tens of times per picture.
        variances = self.covariance.diagonal()[:3].tolist()
        return math.sqrt(sum(variances) / 3.0)


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """One picture as the seed geometry needs it: what was seen, and from where.

    Attributes:
        pose: Camera pose at that moment.
        intrinsics: Camera.
        box: Box of the object.
        region: Its region, for the slices.
    """

    pose: CameraPose
    intrinsics: Intrinsics
    box: Box
    region: Region


@dataclass(frozen=True, slots=True, eq=False)
class Priority:
    """A part of the object that the operator wants seen better (or less well) than the rest.

    Attributes:
        box: The part, world metres.
        weight: How many times as much as elsewhere a patch of surface in it counts, above zero.

    Raises:
        ValueError: If the weight is not finite and above zero.
    """

    box: Box3
    weight: float

    def __post_init__(self) -> None:
        if not (np.isfinite(self.weight) and self.weight > 0.0):
            raise ValueError(f"weight must be finite and above zero, got {self.weight}")


@dataclass(frozen=True, slots=True, eq=False)
class SeedGeometry:
    """The crude geometry of the object: one outer box and the slices inside it.

    Attributes:
        outer: Box around the whole object, world.
        boxes: Slices, each inside ``outer``; together they are the object's crude surface.
        views: Number of pictures it was made from.
        confidences: Per box, 0 to 1: how surely the object fills it; empty when unknown.
        priorities: Parts that matter more to the operator.
    """

    outer: Box3
    boxes: tuple[Box3, ...]
    views: int
    confidences: tuple[float, ...] = ()
    priorities: tuple[Priority, ...] = ()

    @property
    def box_confidences(self) -> tuple[float, ...]:
        """Confidence of each box, 0 where it is unknown."""
        return self.confidences or (0.0,) * len(self.boxes)


@dataclass(frozen=True, slots=True, eq=False)
class Viewpoint:
    """A pose a drone can take: a place and a heading; the camera's tilt is fixed.

    Attributes:
        position_world: Camera centre ``(3,)``, world metres.
        yaw_rad: Heading, counter-clockwise about +Z.
    """

    position_world: Array
    yaw_rad: float

    def T_world_cam(self, tilt_rad: float) -> Array:
        """Return the ``(4, 4)`` camera pose of a camera tilted ``tilt_rad`` down."""
        return camera_pose(self.position_world, self.yaw_rad, tilt_rad)


BoundKind = Literal["linear program", "submodular"]


@dataclass(frozen=True, slots=True, eq=False)
class Placement:
    """A chosen set O of viewpoints.

    Attributes:
        viewpoints: The K chosen poses.
        fitness: Value of the weighted fitness (larger is better).
        terms: Value of each named term before weighting.
        candidates: D, how many poses they were chosen from.
        bound: Upper bound of the fitness over all choices, or None when it was not computed.
        bound_kind: How it was computed, None with ``bound``.
        spare: The candidates that were not chosen.
        spare_gains: ``(D - K,)`` by how much one picture more, from there, would raise the fitness.
    """

    viewpoints: tuple[Viewpoint, ...]
    fitness: float
    terms: Mapping[str, float]
    candidates: int
    bound: float | None = None
    spare: tuple[Viewpoint, ...] = ()
    spare_gains: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))
    bound_kind: BoundKind | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Assignment:
    """Which drone takes which viewpoint in which round.

    Attributes:
        rounds: One mapping from drone id to viewpoint per round, in flying order.
    """

    rounds: tuple[Mapping[str, Viewpoint], ...]


@dataclass(frozen=True, slots=True, eq=False)
class Setpoint:
    """What a drone shall do now; it expires by itself when it is not renewed.

    Attributes:
        velocity_m_s: Wanted body FLU velocity ``(3,)``.
        yaw_rate_rad_s: Wanted yaw rate, counter-clockwise positive.
    """

    velocity_m_s: Array
    yaw_rate_rad_s: float


HOVER = Setpoint(np.zeros(3), 0.0)


@dataclass(frozen=True, slots=True, eq=False)
class Capture:
    """One picture taken for the dataset, with everything known when it was taken.

    Attributes:
        index: Order of taking within the run, from 0.
        round_index: Which round, from 0.
        pose: Believed camera pose.
        intrinsics: Camera.
        telemetry: Newest state report.
        box: Box of the object, or None when it was not seen.
        file: Path of the picture relative to the run folder.
        captured_at: Aware UTC.
        sharpness: See ``vision.sharpness``; None while nobody measured it.
        damaged_before: Damaged pictures of its drone that were passed over for it.
    """

    index: int
    round_index: int
    pose: CameraPose
    intrinsics: Intrinsics
    telemetry: Telemetry
    box: Box | None
    file: str
    captured_at: datetime
    sharpness: float | None = None
    damaged_before: int = 0


@dataclass(frozen=True, slots=True)
class Metrics:
    """How well held-out pictures are reproduced; every value is a mean over pictures.

    Attributes:
        images: All pictures.
        images_held_out: Pictures that training has not seen.
        psnr_db: Whole picture.
        ssim: Whole picture, 11x11 Gaussian window, sigma 1.5.
        flip: Whole picture, smaller is better.
        psnr_db_object: Inside the object's masks, None without masks.
    """

    images: int
    images_held_out: int
    psnr_db: float
    ssim: float
    flip: float
    psnr_db_object: float | None


class StopControl(Protocol):
    """The three stops. The fleet implements it; a stop passes through nothing else."""

    def hold(self, drone_id: str | None = None) -> None:
        """Hover and refuse motion until re-armed: one drone, or all when None."""
        ...

    def land(self, drone_id: str | None = None) -> None:
        """Land where it is: one drone, or all when None."""
        ...

    def cut_motors(self, drone_id: str | None = None) -> None:
        """Stop the motors at once, the drone falls: one drone, or all when None."""
        ...
