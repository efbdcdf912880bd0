"""One capture in the scene: seed boxes, planned viewpoints, pictures taken, the field's preview."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray
from viser import CameraFrustumHandle, LineSegmentsHandle, PointCloudHandle, SceneApi

from server.geometry.boxes import Box3
from server.geometry.cameras import Intrinsics
from server.mission.events import (
    CaptureTaken,
    PlanFound,
    PlanViewChosen,
    PosesRefined,
    PreviewRendered,
    PrioritiesChanged,
    SeedFitted,
    SurfaceSeen,
)
from server.scene.config import SceneConfig
from server.scene.shapes import (
    EDGES_PER_BOX,
    Rgb,
    box_edges,
    dimmed,
    node_name,
    picture_from_jpeg,
    placed,
)
from server.stages import Assignment, Placement, Viewpoint

_OUTER: Rgb = (240, 190, 40)
_UNSURE_SLICE, _SURE_SLICE = np.array([110.0, 95.0, 70.0]), np.array([255.0, 200.0, 100.0])
_PRIORITY: Rgb = (230, 80, 200)
_PREVIEW: Rgb = (60, 60, 60)
_UNKNOWN: Rgb = (150, 150, 150)
# What a picture more would add, from next to nothing to most: perceptually even, and also told
# apart where red and green are not.
_GAIN_SCALE = cv2.COLORMAP_VIRIDIS
# From dark to bright, so that they are told apart without red and green, too.
_UNSEEN, _SEEN_ONCE = np.array([150.0, 30.0, 40.0]), np.array([70.0, 110.0, 150.0])
_SEEN_OFTEN = np.array([190.0, 240.0, 170.0])
_SEEN_WELL = 3.0
# Patches stay apart, so that what is behind them can be made out.
_PATCH_SHARE = 0.7


@dataclass(slots=True)
class _Planned:
    """A planned viewpoint: its node, whose it is, where it is, and whether it was taken."""

    node: CameraFrustumHandle
    drone_id: str
    position_world: NDArray[np.float64]
    done: bool = False


class CaptureLayer:
    """Draws what belongs to one capture; call it from one thread.

    Every node has a fixed name and is drawn over or hidden, never removed: the viewer keeps a
    tombstone of every name it has ever removed.
    """

    def __init__(self, scene: SceneApi, config: SceneConfig) -> None:
        self._scene = scene
        self._config = config
        self._capture_id: str | None = None
        self._colours: dict[str, Rgb] = {}
        self._boxes: dict[str, LineSegmentsHandle] = {}
        self._planned: dict[str, _Planned] = {}
        self._routes: list[LineSegmentsHandle] = []
        self._ring: list[CameraFrustumHandle] = []
        self._spare: PointCloudHandle | None = None
        self._seen: PointCloudHandle | None = None
        self._shown: Literal["planned", "ring", "both"] = "planned"
        self._pictures: dict[int, CameraFrustumHandle] = {}
        self._preview: CameraFrustumHandle | None = None

    def set_colour(self, drone_id: str, colour: Rgb) -> None:
        """Remember a drone's colour."""
        self._colours[drone_id] = colour

    def begin(self, capture_id: str) -> bool:
        """Hide what belongs to an earlier capture; return whether this one is new."""
        if capture_id == self._capture_id:
            return False
        self._capture_id = capture_id
        nodes = [*self._boxes.values(), *self._pictures.values()]
        nodes += [planned.node for planned in self._planned.values()]
        nodes += [*self._ring, *self._routes]
        nodes += [node for node in (self._preview, self._spare, self._seen) if node is not None]
        for node in nodes:
            node.visible = False
        self._planned.clear()
        self._ring.clear()
        self._routes.clear()
        self._spare = self._seen = None
        self._pictures.clear()
        return True

    def draw_seed(self, event: SeedFitted) -> None:
        """Draw the outer box and the slices as wire frames, the surer the brighter."""
        self._draw_boxes("outer", (event.seed.outer,), _OUTER, 3.0)
        sureness = np.repeat(event.seed.box_confidences, 2 * EDGES_PER_BOX)[:, None]
        colours = (1.0 - sureness) * _UNSURE_SLICE + sureness * _SURE_SLICE
        by_edge = colours.reshape(-1, 2, 3).astype(np.uint8)
        self._draw_boxes("slices", event.seed.boxes, by_edge, 1.5)

    def draw_seen(self, event: SurfaceSeen) -> None:
        """Paint the surface: red where no picture shows it, else the brighter the more do."""
        share = np.clip((event.pictures - 1.0) / (_SEEN_WELL - 1.0), 0.0, 1.0)[:, None]
        colours = np.where(
            event.pictures[:, None] == 0, _UNSEEN, (1.0 - share) * _SEEN_ONCE + share * _SEEN_OFTEN
        )
        self._seen = self._scene.add_point_cloud(
            "/seed/seen",
            points=event.points.astype(np.float32),
            colors=colours.astype(np.uint8),
            point_size=_PATCH_SHARE * event.patch_m,
            point_shape="square",
        )

    def draw_priorities(self, event: PrioritiesChanged) -> None:
        """Draw the operator's parts of priority that have been found on the object."""
        boxes = tuple(part.box for part in event.parts if part.box is not None)
        self._draw_boxes("priorities", boxes, _PRIORITY, 4.0)

    def draw_plan(self, event: PlanFound) -> None:
        """Draw planned viewpoints and routes in their drones' colours, and the ring beside them.

        The candidates left over are points, the brighter the more a picture from there would add.
        The former plan is hidden.
        """
        planned = [planned.node for planned in self._planned.values()]
        for node in (*planned, *self._ring, *self._routes):
            node.visible = False
        self._planned = {
            name: _Planned(node, drone_id, viewpoint.position_world)
            for name, drone_id, viewpoint, node in self._viewpoints("/plan", event.assignment)
        }
        ring = [] if event.ring is None else self._viewpoints("/ring", event.ring)
        self._ring = [node for *_, node in ring]
        self._routes = self._draw_routes(event.assignment)
        self._draw_spare(event.placement)
        self._show_chosen()

    def _draw_routes(self, assignment: Assignment) -> list[LineSegmentsHandle]:
        ways: dict[str, list[NDArray[np.float64]]] = {}
        for row in assignment.rounds:
            for drone_id, viewpoint in row.items():
                ways.setdefault(drone_id, []).append(viewpoint.position_world)
        return [
            self._scene.add_line_segments(
                f"/plan/routes/{node_name(drone_id)}",
                points=np.stack([way[:-1], way[1:]], axis=1).astype(np.float32),
                colors=dimmed(self._colours.get(drone_id, _UNKNOWN)),
                thickness=1.0,
                thickness_units="screen",
            )
            for drone_id, way in ways.items()
            if len(way) > 1
        ]

    def _draw_spare(self, placement: Placement) -> None:
        if not placement.spare:
            if self._spare is not None:
                self._spare.visible = False
                self._spare = None
            return
        gains = placement.spare_gains - placement.spare_gains.min()
        levels = np.uint8(np.round(255.0 * gains / max(float(gains.max()), 1e-12)))
        colours_bgr = cv2.applyColorMap(levels.reshape(-1, 1), _GAIN_SCALE).reshape(-1, 3)
        self._spare = self._scene.add_point_cloud(
            "/plan/candidates",
            points=np.array([view.position_world for view in placement.spare], np.float32),
            colors=np.ascontiguousarray(colours_bgr[:, ::-1]),
            point_size=self._config.candidate_m,
            point_shape="circle",
        )

    def choose(self, event: PlanViewChosen) -> None:
        """Show the planned viewpoints, the ring, or both."""
        self._shown = event.shown
        self._show_chosen()

    def _show_chosen(self) -> None:
        for planned in self._planned.values():
            planned.node.visible = self._shown != "ring"
        for route in self._routes:
            route.visible = self._shown != "ring"
        for node in self._ring:
            node.visible = self._shown != "planned"
        if self._spare is not None:
            self._spare.visible = self._shown != "ring"

    def _viewpoints(
        self, below: str, assignment: Assignment
    ) -> list[tuple[str, str, Viewpoint, CameraFrustumHandle]]:
        """Draw viewpoints below a node; returns name, drone, viewpoint and node of each."""
        camera, tilt_rad = self._config.planned_intrinsics, self._config.planned_tilt_rad
        drawn = []
        for index, assigned in enumerate(assignment.rounds):
            for drone_id, viewpoint in assigned.items():
                name = f"{below}/{index:02d}/{node_name(drone_id)}"
                colour = self._colours.get(drone_id, _UNKNOWN)
                pose, size = viewpoint.T_world_cam(tilt_rad), self._config.small_frustum_m
                node = self._frustum(
                    name, camera, pose, size, dimmed(colour) if below == "/ring" else colour
                )
                drawn.append((name, drone_id, viewpoint, node))
        return drawn

    def draw_picture(self, event: CaptureTaken) -> None:
        """Draw a picture where it was taken and dim the viewpoint it was planned for."""
        capture = event.capture
        drone_id = capture.pose.drone_id
        self._pictures[capture.index] = self._frustum(
            f"/pictures/{capture.index:03d}",
            capture.intrinsics,
            capture.pose.T_world_cam,
            self._config.small_frustum_m,
            self._colours.get(drone_id, _UNKNOWN),
            picture_from_jpeg(event.thumbnail_jpeg),
        )
        # A later plan may start counting rounds anew, so the place tells, not the number.
        todo = [p for p in self._planned.values() if p.drone_id == drone_id and not p.done]
        if todo:
            position = capture.pose.position_world
            nearest = min(todo, key=lambda p: float(np.linalg.norm(p.position_world - position)))
            nearest.done = True
            nearest.node.color = dimmed(self._colours.get(drone_id, _UNKNOWN))

    def move_pictures(self, event: PosesRefined) -> None:
        """Move the pictures to their refined poses."""
        for index, T_world_cam in enumerate(event.T_world_cam):
            node = self._pictures.get(index)
            if node is not None:
                node.wxyz, node.position = placed(T_world_cam)

    def draw_preview(self, event: PreviewRendered) -> None:
        """Draw the field's newest rendering at the camera it was rendered from."""
        picture = picture_from_jpeg(event.jpeg)
        if self._preview is None:
            self._preview = self._frustum(
                "/preview",
                event.intrinsics,
                event.T_world_cam,
                self._config.preview_frustum_m,
                _PREVIEW,
                picture,
            )
            return
        self._preview.fov = event.intrinsics.vertical_fov_rad
        self._preview.aspect = event.intrinsics.width / event.intrinsics.height
        self._preview.wxyz, self._preview.position = placed(event.T_world_cam)
        self._preview.image = picture
        self._preview.visible = True

    def _draw_boxes(
        self,
        name: str,
        boxes: tuple[Box3, ...],
        colour: Rgb | NDArray[np.uint8],
        width_px: float,
    ) -> None:
        if not boxes:
            if name in self._boxes:
                self._boxes[name].visible = False
            return
        self._boxes[name] = self._scene.add_line_segments(
            f"/seed/{name}",
            points=box_edges(boxes),
            colors=colour,
            thickness=width_px,
            thickness_units="screen",
        )

    def _frustum(
        self,
        name: str,
        intrinsics: Intrinsics,
        T_world_cam: NDArray[np.float64],
        scale_m: float,
        colour: Rgb,
        image_rgb: NDArray[np.uint8] | None = None,
    ) -> CameraFrustumHandle:
        wxyz, position = placed(T_world_cam)
        return self._scene.add_camera_frustum(
            name,
            fov=intrinsics.vertical_fov_rad,
            aspect=intrinsics.width / intrinsics.height,
            scale=scale_m,
            thickness=0.004,
            color=colour,
            image=image_rgb,
            format="jpeg",
            jpeg_quality=70,
            wxyz=wxyz,
            position=position,
            cast_shadow=False,
            receive_shadow=False,
        )
