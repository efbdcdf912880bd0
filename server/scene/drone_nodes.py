"""The drones in the scene: camera frustum with a live thumbnail, label and trail."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from viser import (
    CameraFrustumHandle,
    FrameHandle,
    LabelHandle,
    LineSegmentsHandle,
    SceneApi,
)

from server.geometry.cameras import Intrinsics
from server.mission.events import DroneReported, FrameAnnotated, PoseEstimated
from server.scene.config import SceneConfig
from server.scene.shapes import (
    Rgb,
    node_name,
    path_segments,
    picture_from_jpeg,
    placed,
    rgb_from_hex,
)


@dataclass(slots=True)
class _DroneNodes:
    """The nodes of one drone and the path it flew."""

    frame: FrameHandle
    frustum: CameraFrustumHandle
    label: LabelHandle
    trail: LineSegmentsHandle
    colour: Rgb
    path: deque[NDArray[np.float64]] = field(default_factory=deque)
    trail_drawn_s: float = float("-inf")


class DroneLayer:
    """Draws drones; call it from one thread."""

    def __init__(self, scene: SceneApi, config: SceneConfig) -> None:
        self._scene = scene
        self._config = config
        self._drones: dict[str, _DroneNodes] = {}
        self._names: dict[str, str] = {}

    def draw_pose(self, event: PoseEstimated, now_s: float) -> None:
        """Move a drone to its believed pose; its nodes are made when it is seen first."""
        drone_id = event.pose.drone_id
        colour = rgb_from_hex(event.colour)
        nodes = self._drones.get(drone_id)
        if nodes is None:
            nodes = self._drones[drone_id] = self._add(drone_id, colour, event.intrinsics)
        nodes.frame.wxyz, nodes.frame.position = placed(event.pose.T_world_cam)
        nodes.frame.visible = True
        if colour != nodes.colour:
            nodes.colour = colour
            nodes.frustum.color = colour
        self._extend(nodes, event.pose.position_world, now_s)

    def draw_report(self, event: DroneReported) -> None:
        """Show a drone's name; a drone that is offline is hidden, its trail stays."""
        self._names[event.drone_id] = event.name
        nodes = self._drones.get(event.drone_id)
        if nodes is None:
            return
        if nodes.label.text != event.name:
            nodes.label.text = event.name
        nodes.frame.visible = event.activity != "offline"

    def draw_frame(self, event: FrameAnnotated) -> None:
        """Show a drone's newest picture in its frustum."""
        nodes = self._drones.get(event.drone_id)
        if nodes is not None:
            nodes.frustum.image = picture_from_jpeg(event.jpeg, small=True)

    def clear_trails(self) -> None:
        """Start all trails anew."""
        for nodes in self._drones.values():
            nodes.path.clear()
            nodes.trail.visible = False

    def _add(self, drone_id: str, colour: Rgb, intrinsics: Intrinsics) -> _DroneNodes:
        base = f"/drones/{node_name(drone_id)}"
        frame = self._scene.add_frame(base, show_axes=False)
        frustum = self._scene.add_camera_frustum(
            f"{base}/camera",
            fov=intrinsics.vertical_fov_rad,
            aspect=intrinsics.width / intrinsics.height,
            scale=self._config.drone_frustum_m,
            thickness=0.008,
            color=colour,
            format="jpeg",
            jpeg_quality=60,
            cast_shadow=False,
            receive_shadow=False,
        )
        label = self._scene.add_label(
            f"{base}/name", self._names.get(drone_id, drone_id), position=(0.0, -0.15, 0.0)
        )
        trail = self._scene.add_line_segments(
            f"/trails/{node_name(drone_id)}",
            points=np.zeros((1, 2, 3), np.float32),
            colors=colour,
            thickness=2.0,
            thickness_units="screen",
            visible=False,
        )
        return _DroneNodes(
            frame, frustum, label, trail, colour, deque(maxlen=self._config.trail_points)
        )

    def _extend(self, nodes: _DroneNodes, position: NDArray[np.float64], now_s: float) -> None:
        path = nodes.path
        if path and np.linalg.norm(position - path[-1]) < self._config.trail_step_m:
            return
        path.append(np.array(position, float))
        if len(path) < 2 or now_s - nodes.trail_drawn_s < 1.0 / self._config.trail_hz:
            return
        nodes.trail_drawn_s = now_s
        nodes.trail.points = path_segments(np.array(path))
        nodes.trail.visible = True
