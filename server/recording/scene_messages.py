"""Foxglove's scene: fence, drones, seed boxes, planned viewpoints; world frame, metres.

An entity stays until one of the same id replaces it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from foxglove_schemas_protobuf.ArrowPrimitive_pb2 import ArrowPrimitive
from foxglove_schemas_protobuf.CubePrimitive_pb2 import CubePrimitive
from foxglove_schemas_protobuf.LinePrimitive_pb2 import LinePrimitive
from foxglove_schemas_protobuf.Point3_pb2 import Point3
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.TextPrimitive_pb2 import TextPrimitive
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from numpy.typing import NDArray

from server.geometry.boxes import Box3
from server.geometry.poses import camera_pose, transform_from
from server.recording.messages import WORLD, camera_frame, colour_of, pose_of
from server.recording.times import timestamp
from server.stages import SeedGeometry, Viewpoint

_FENCE_COLOUR, _OUTER_COLOUR, _SLICE_COLOUR = "#d55e00", "#f0e442", "#56b4e9"
_NO_GO_COLOUR = "#cc3311"
_FENCE_CORNERS = 48
_EYE_LENGTH_M = 0.2
# An arrow points along its x, a camera looks along its z.
_T_CAM_ARROW = transform_from(
    np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]), np.zeros(3)
)


def _entity(name: str, at_ns: int, frame: str = WORLD) -> SceneEntity:
    return SceneEntity(timestamp=timestamp(at_ns), frame_id=frame, id=name)


def fence_message(radius_m: float, floor_m: float, ceiling_m: float, at_ns: int) -> SceneUpdate:
    """Return the fence as its lower and upper circle."""
    entity = _entity("fence", at_ns)
    angles = np.linspace(0.0, 2.0 * np.pi, _FENCE_CORNERS, endpoint=False)
    for height_m in (floor_m, ceiling_m):
        corners = [
            Point3(x=radius_m * float(np.cos(a)), y=radius_m * float(np.sin(a)), z=height_m)
            for a in angles
        ]
        entity.lines.append(
            LinePrimitive(
                type=LinePrimitive.LINE_LOOP,
                pose=pose_of(np.eye(4)),
                thickness=0.02,
                points=corners,
                color=colour_of(_FENCE_COLOUR, 0.7),
            )
        )
    return SceneUpdate(entities=[entity])


def drones_message(drones: Iterable[tuple[str, str, str]], at_ns: int) -> SceneUpdate:
    """Return the drones, each fixed to its camera frame.

    Args:
        drones: Id, label and colour of each.
        at_ns: The time.
    """
    entities = []
    for drone_id, label, colour in drones:
        entity = _entity(f"drone {drone_id}", at_ns, camera_frame(drone_id))
        entity.frame_locked = True
        entity.arrows.append(_arrow(_T_CAM_ARROW, colour))
        entity.texts.append(
            TextPrimitive(
                pose=pose_of(transform_from(np.eye(3), np.array([0.0, -0.15, 0.0]))),
                billboard=True,
                font_size=0.1,
                color=colour_of(colour),
                text=label,
            )
        )
        entities.append(entity)
    return SceneUpdate(entities=entities)


def no_go_message(boxes: Iterable[Box3], at_ns: int) -> SceneUpdate:
    """Return the volumes that no drone may enter; without any, those shown before go."""
    entity = _entity("no-go", at_ns)
    entity.cubes.extend(_cube(box, _NO_GO_COLOUR, 0.25) for box in boxes)
    return SceneUpdate(entities=[entity])


def seed_message(seed: SeedGeometry, at_ns: int) -> SceneUpdate:
    """Return the seed geometry: the outer box faint, its slices inside, the surer the denser."""
    entity = _entity("seed", at_ns)
    entity.cubes.append(_cube(seed.outer, _OUTER_COLOUR, 0.15))
    for box, confidence in zip(seed.boxes, seed.box_confidences, strict=True):
        entity.cubes.append(_cube(box, _SLICE_COLOUR, 0.15 + 0.35 * confidence))
    return SceneUpdate(entities=[entity])


def plan_message(
    rounds: Sequence[Iterable[tuple[str, Viewpoint]]],
    tilts_rad: dict[str, float],
    colours: dict[str, str],
    at_ns: int,
) -> SceneUpdate:
    """Return the planned viewpoints as arrows along the line of sight, in the drones' colours."""
    entity = _entity("plan", at_ns)
    for number, row in enumerate(rounds):
        for drone_id, viewpoint in row:
            tilt_rad = tilts_rad[drone_id]
            T_world_cam = camera_pose(viewpoint.position_world, viewpoint.yaw_rad, tilt_rad)
            entity.arrows.append(_arrow(T_world_cam @ _T_CAM_ARROW, colours[drone_id]))
            place = transform_from(np.eye(3), viewpoint.position_world)
            entity.texts.append(
                TextPrimitive(
                    pose=pose_of(place),
                    billboard=True,
                    font_size=0.06,
                    color=colour_of(colours[drone_id]),
                    text=str(number + 1),
                )
            )
    return SceneUpdate(entities=[entity])


def _arrow(T: NDArray[np.float64], colour: str) -> ArrowPrimitive:
    return ArrowPrimitive(
        pose=pose_of(T),
        shaft_length=0.7 * _EYE_LENGTH_M,
        shaft_diameter=0.03,
        head_length=0.3 * _EYE_LENGTH_M,
        head_diameter=0.06,
        color=colour_of(colour),
    )


def _cube(box: Box3, colour: str, opacity: float) -> CubePrimitive:
    x, y, z = (float(value) for value in box.size)
    return CubePrimitive(
        pose=pose_of(transform_from(np.eye(3), box.centre)),
        size=Vector3(x=x, y=y, z=z),
        color=colour_of(colour, opacity),
    )
