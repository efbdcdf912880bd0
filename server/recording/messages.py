"""Foxglove's messages about one drone: video, camera, pose, what is seen in a picture; the log.

Frames: ``world`` is ours (metres, +Z up); ``<drone>/camera`` is its camera's OpenCV frame, which is
also Foxglove's for pictures.
"""

from __future__ import annotations

import cv2
import numpy as np
from foxglove_schemas_protobuf.CameraCalibration_pb2 import CameraCalibration
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.CompressedVideo_pb2 import CompressedVideo
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.ImageAnnotations_pb2 import ImageAnnotations
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.Point2_pb2 import Point2
from foxglove_schemas_protobuf.PointsAnnotation_pb2 import PointsAnnotation
from foxglove_schemas_protobuf.Pose_pb2 import Pose
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.TextAnnotation_pb2 import TextAnnotation
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from numpy.typing import NDArray

from server.geometry.cameras import Intrinsics
from server.geometry.poses import wxyz_from_rotation
from server.recording.times import timestamp
from server.stages import Box, Region

WORLD = "world"
_LEVELS = {"info": Log.INFO, "warning": Log.WARNING, "error": Log.ERROR}
_LINE_PX = 2.0
_FONT_PX = 18.0


def camera_frame(drone_id: str) -> str:
    """Return the name of a drone's camera frame."""
    return f"{drone_id}/camera"


def colour_of(html: str, opacity: float = 1.0) -> Color:
    """Return ``#rrggbb`` as Foxglove's colour."""
    red, green, blue = (int(html[i : i + 2], 16) / 255.0 for i in (1, 3, 5))
    return Color(r=red, g=green, b=blue, a=opacity)


def video_message(drone_id: str, data: bytes, captured_ns: int) -> CompressedVideo:
    """Return one coded picture: Annex B, parameter sets in front of a key picture."""
    return CompressedVideo(
        timestamp=timestamp(captured_ns),
        frame_id=camera_frame(drone_id),
        data=data,
        format="h264",
    )


def calibration_message(drone_id: str, camera: Intrinsics, at_ns: int) -> CameraCalibration:
    """Return a drone's camera; the picture is as the drone sends it, not rectified."""
    K = camera.K
    return CameraCalibration(
        timestamp=timestamp(at_ns),
        frame_id=camera_frame(drone_id),
        width=camera.width,
        height=camera.height,
        distortion_model="plumb_bob",
        D=camera.distortion,
        K=K.ravel().tolist(),
        R=np.eye(3).ravel().tolist(),
        P=np.column_stack([K, np.zeros(3)]).ravel().tolist(),
    )


def pose_of(T_parent_child: NDArray[np.float64]) -> Pose:
    """Return a ``(4, 4)`` pose as Foxglove's."""
    x, y, z = (float(value) for value in T_parent_child[:3, 3])
    return Pose(position=Vector3(x=x, y=y, z=z), orientation=_orientation(T_parent_child))


def _orientation(T: NDArray[np.float64]) -> Quaternion:
    w, x, y, z = (float(value) for value in wxyz_from_rotation(T[:3, :3]))
    return Quaternion(x=x, y=y, z=z, w=w)


def pose_message(T_world_cam: NDArray[np.float64], at_ns: int) -> PoseInFrame:
    """Return a believed camera pose."""
    return PoseInFrame(timestamp=timestamp(at_ns), frame_id=WORLD, pose=pose_of(T_world_cam))


def transforms_message(
    drone_id: str, T_world_cam: NDArray[np.float64], at_ns: int
) -> FrameTransforms:
    """Return the same pose as the place of the drone's camera frame in the world."""
    x, y, z = (float(value) for value in T_world_cam[:3, 3])
    transform = FrameTransform(
        timestamp=timestamp(at_ns),
        parent_frame_id=WORLD,
        child_frame_id=camera_frame(drone_id),
        translation=Vector3(x=x, y=y, z=z),
        rotation=_orientation(T_world_cam),
    )
    return FrameTransforms(transforms=[transform])


def annotations_message(
    label: str, colour: str, region: Region | None, box: Box | None, captured_ns: int
) -> ImageAnnotations:
    """Return what was found in a picture: box, outline, centroid, the drone's name.

    The timestamp is that of the picture, by which Foxglove joins the two.
    """
    at, ink = timestamp(captured_ns), colour_of(colour)
    found = ImageAnnotations(timestamp=at)
    name = f"{label}: nothing found" if box is None else f"{label} {box.confidence:.2f}"
    found.texts.append(
        TextAnnotation(
            timestamp=at,
            position=Point2(x=12.0, y=28.0),
            text=name,
            font_size=_FONT_PX,
            text_color=ink,
            background_color=Color(a=0.5),
        )
    )
    if box is not None:
        left, top, right, bottom = (float(value) for value in box.xyxy_px)
        corners = [(left, top), (right, top), (right, bottom), (left, bottom)]
        found.points.append(_line_loop(corners, ink, captured_ns))
        centre = [(float(box.centroid_px[0]), float(box.centroid_px[1]))]
        mark = _line_loop(centre, ink, captured_ns)
        mark.type, mark.thickness = PointsAnnotation.POINTS, 8.0
        found.points.append(mark)
    for outline in _outlines(region):
        found.points.append(_line_loop(outline, colour_of(colour, 0.6), captured_ns))
    return found


def _line_loop(points: list[tuple[float, float]], ink: Color, at_ns: int) -> PointsAnnotation:
    return PointsAnnotation(
        timestamp=timestamp(at_ns),
        type=PointsAnnotation.LINE_LOOP,
        points=[Point2(x=x, y=y) for x, y in points],
        outline_color=ink,
        thickness=_LINE_PX,
    )


def _outlines(region: Region | None) -> list[list[tuple[float, float]]]:
    """Return the outlines of a region's mask in full-picture pixels."""
    if region is None:
        return []
    contours, _ = cv2.findContours(
        region.mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE
    )
    scale = region.mask_scale
    return [
        [((x + 0.5) * scale - 0.5, (y + 0.5) * scale - 0.5) for x, y in contour[:, 0].tolist()]
        for contour in contours
    ]


def log_message(level: str, text: str, name: str, at_ns: int) -> Log:
    """Return a line of the log; ``level`` is ``info``, ``warning`` or ``error``."""
    return Log(
        timestamp=timestamp(at_ns), level=_LEVELS[level], message=text, name=name, file="", line=0
    )
