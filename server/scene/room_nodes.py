"""The room in the scene: floor, axes, start circle, and the volumes that no drone may enter."""

from __future__ import annotations

from viser import LineSegmentsHandle, SceneApi

from server.mission.events import NoGoChanged
from server.scene.config import SceneConfig
from server.scene.shapes import Rgb, box_edges, circle

_START: Rgb = (90, 140, 200)
_NO_GO: Rgb = (220, 60, 50)


class RoomLayer:
    """Draws what stays from capture to capture; call it from one thread."""

    def __init__(self, scene: SceneApi, config: SceneConfig) -> None:
        self._scene = scene
        self._no_go: LineSegmentsHandle | None = None
        scene.add_grid("/world/floor", config.floor_m, config.floor_m, plane="xy", cell_size=0.5)
        scene.add_frame("/world/axes", axes_length=0.5, axes_radius=0.01)
        scene.add_line_segments(
            "/world/start_circle",
            # A little above the floor, so that the two do not flicker through each other.
            points=circle(config.start_radius_m, 0.005),
            colors=_START,
            thickness=2.0,
            thickness_units="screen",
        )

    def draw_no_go(self, event: NoGoChanged) -> None:
        """Draw the no-go volumes as wire frames; drawn over or hidden, never removed."""
        if not event.volumes:
            if self._no_go is not None:
                self._no_go.visible = False
            return
        self._no_go = self._scene.add_line_segments(
            "/world/no_go",
            points=box_edges(tuple(volume.box for volume in event.volumes)),
            colors=_NO_GO,
            thickness=3.0,
            thickness_units="screen",
        )
