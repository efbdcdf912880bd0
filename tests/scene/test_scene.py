"""Events become nodes of a real viser server, and nothing of it reaches the mission."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from datetime import UTC, datetime
from importlib.metadata import version

import cv2
import msgspec
import numpy as np
import pytest
import viser
from numpy.typing import NDArray
from websockets.asyncio.client import connect
from websockets.typing import Subprotocol

from server.geometry.boxes import Box3
from server.geometry.cameras import TELLO_INTRINSICS, TELLO_TILT_RAD
from server.geometry.poses import camera_pose, look_at
from server.mission.events import (
    CaptureChanged,
    CaptureTaken,
    Coverage,
    DroneReported,
    Event,
    EventStream,
    FieldView,
    FrameAnnotated,
    NoGoChanged,
    NoGoVolume,
    PlanFound,
    PlanViewChosen,
    PoseEstimated,
    PosesRefined,
    PreviewRendered,
    PrioritiesChanged,
    PriorityPart,
    SeedFitted,
    SurfaceSeen,
)
from server.scene.config import SceneConfig
from server.scene.mailbox import Mailbox
from server.scene.scene import SceneView, Stage
from server.scene.shapes import dimmed
from server.stages import (
    Assignment,
    CameraPose,
    Capture,
    Placement,
    SeedGeometry,
    Telemetry,
    Viewpoint,
)

pytestmark = pytest.mark.loopback

VISER = Subprotocol(f"viser-v{version('viser')}")
BLUE, ORANGE = (0x1F, 0x77, 0xB4), (0xFF, 0x7F, 0x0E)


WHOLE = Coverage(1.0, 1.0)


def jpeg(width: int, height: int) -> bytes:
    return cv2.imencode(".jpg", np.full((height, width, 3), 99, np.uint8))[1].tobytes()


def pose(drone_id: str = "d1", x: float = 2.0, colour: str = "#1f77b4") -> PoseEstimated:
    T_world_cam = camera_pose(np.array([x, 0.0, 1.0]), np.pi, TELLO_TILT_RAD)
    return PoseEstimated(
        CameraPose(drone_id, 0.0, T_world_cam, np.eye(4) * 1e-3), TELLO_INTRINSICS, colour
    )


def frame(drone_id: str = "d1", sequence: int = 0) -> FrameAnnotated:
    return FrameAnnotated(drone_id, sequence, 0.0, jpeg(640, 480), damaged=False)


def report(drone_id: str = "d1", activity: str = "flying") -> DroneReported:
    return DroneReported(
        drone_id, "Red one", "#1f77b4", activity, False, 80, 60.0, 1.0, 0.0, 0.1, 0.1, 30.0, 0.05
    )


def capture_changed(capture_id: str, state: str = "running") -> CaptureChanged:
    return CaptureChanged(
        capture_id, state, "flying", 0.1, None, "runs/x", None, "optimized", 0, 6, 0, 24
    )


def viewpoint(azimuth_rad: float) -> Viewpoint:
    place = np.array([2.0 * np.cos(azimuth_rad), 2.0 * np.sin(azimuth_rad), 1.0])
    return Viewpoint(place, azimuth_rad + np.pi)


def plan(*azimuths_rad: float) -> PlanFound:
    rounds = tuple({"d1": viewpoint(azimuth)} for azimuth in azimuths_rad)
    viewpoints = tuple(r["d1"] for r in rounds)
    return PlanFound(Placement(viewpoints, 0.5, {}, 100), Assignment(rounds), WHOLE)


def taken(index: int, azimuth_rad: float) -> CaptureTaken:
    telemetry = Telemetry(
        "d1", 0.0, 0.0, 0.0, 0.0, np.zeros(3), np.zeros(3), 1.0, 1.0, 0.0, 80, 60.0, 10.0
    )
    T_world_cam = viewpoint(azimuth_rad).T_world_cam(TELLO_TILT_RAD)
    capture = Capture(
        index=index,
        round_index=0,
        pose=CameraPose("d1", 0.0, T_world_cam, np.eye(4) * 1e-3),
        intrinsics=TELLO_INTRINSICS,
        telemetry=telemetry,
        box=None,
        file="images/000.jpg",
        captured_at=datetime.now(UTC),
    )
    return CaptureTaken(capture, jpeg(160, 120))


def seed(slices: int = 2) -> SeedFitted:
    outer = Box3(np.array([-0.5, -0.5, 0.0]), np.array([0.5, 0.5, 1.5]))
    return SeedFitted(SeedGeometry(outer, (outer,) * slices, views=4))


def preview() -> PreviewRendered:
    T_world_cam = look_at(np.array([1.5, 1.5, 1.5]), np.array([0.0, 0.0, 0.7]))
    return PreviewRendered(
        jpeg(320, 240), T_world_cam, TELLO_INTRINSICS.scaled(1 / 3), FieldView(0.0, 0.3, 1.0)
    )


async def until(condition: Callable[[], bool]) -> None:
    while not condition():  # noqa: ASYNC110 - what is waited for sets no event.
        await asyncio.sleep(0.01)


class Drawn:
    """A stage on a real viser server that nobody watches."""

    def __init__(self, server: viser.ViserServer, config: SceneConfig | None = None) -> None:
        self.scene = server.scene
        self.stage = Stage(server.scene, config or SceneConfig(trail_hz=1000.0))
        self.now_s = 0.0

    def draw(self, *events: Event) -> None:
        for event in events:
            self.now_s += 1.0
            self.stage.draw(event, self.now_s)

    def node(self, name: str) -> viser.SceneNodeHandle:
        node = self.scene.get_handle_by_name(name)
        assert node is not None, name
        return node

    def frustum(self, name: str) -> viser.CameraFrustumHandle:
        node = self.node(name)
        assert isinstance(node, viser.CameraFrustumHandle)
        return node


@pytest.fixture(scope="module")
def server() -> Iterator[viser.ViserServer]:
    server = viser.ViserServer("127.0.0.1", 0, verbose=False)
    yield server
    server.stop()


@pytest.fixture
def drawn(server: viser.ViserServer) -> Drawn:
    server.scene.reset()
    return Drawn(server)


def test_a_drone_stands_where_it_is_believed(drawn: Drawn) -> None:
    drawn.draw(pose(x=2.0), report())
    node = drawn.node("/drones/d1")
    np.testing.assert_allclose(node.position, [2.0, 0.0, 1.0])
    frustum = drawn.frustum("/drones/d1/camera")
    assert frustum.color == BLUE
    assert frustum.fov == pytest.approx(TELLO_INTRINSICS.vertical_fov_rad)
    label = drawn.node("/drones/d1/name")
    assert isinstance(label, viser.LabelHandle)
    assert label.text == "Red one"
    drawn.draw(pose(x=1.5, colour="#ff7f0e"))
    np.testing.assert_allclose(drawn.node("/drones/d1").position, [1.5, 0.0, 1.0])
    assert drawn.frustum("/drones/d1/camera").color == ORANGE
    drawn.draw(report(activity="offline"))
    assert not drawn.node("/drones/d1").visible
    drawn.draw(pose())
    assert drawn.node("/drones/d1").visible


def test_pictures_appear_small_in_the_frustum(drawn: Drawn) -> None:
    drawn.draw(frame())  # Before the drone has a pose there is nowhere to show it.
    drawn.draw(pose(), frame())
    image = drawn.frustum("/drones/d1/camera").image
    assert image is not None
    assert image.shape == (120, 160, 3)


def test_a_trail_is_one_node_of_bounded_length(server: viser.ViserServer) -> None:
    server.scene.reset()
    drawn = Drawn(server, SceneConfig(trail_hz=1000.0, trail_points=10, trail_step_m=0.05))
    for step in range(50):
        drawn.draw(pose(x=2.0 + 0.1 * step), pose(x=2.0 + 0.1 * step + 0.001))
    trail = drawn.node("/trails/d1")
    assert isinstance(trail, viser.LineSegmentsHandle)
    points: NDArray[np.float32] = np.asarray(trail.points)
    assert points.shape == (9, 2, 3)
    assert points[-1, 1, 0] == pytest.approx(2.0 + 4.9)
    assert trail.visible


def test_seed_boxes_are_redrawn_in_place(drawn: Drawn) -> None:
    drawn.draw(seed(6))
    slices = drawn.node("/seed/slices")
    assert isinstance(slices, viser.LineSegmentsHandle)
    assert np.asarray(slices.points).shape == (72, 2, 3)
    drawn.draw(seed(2))
    slices = drawn.node("/seed/slices")
    assert isinstance(slices, viser.LineSegmentsHandle)
    assert np.asarray(slices.points).shape == (24, 2, 3)
    assert drawn.node("/seed/outer").visible
    drawn.draw(seed(0))
    assert not drawn.node("/seed/slices").visible


def test_sure_slices_are_brighter_than_unsure_ones(drawn: Drawn) -> None:
    fitted = seed(2).seed
    drawn.draw(SeedFitted(replace(fitted, confidences=(0.9, 0.1))))
    slices = drawn.node("/seed/slices")
    assert isinstance(slices, viser.LineSegmentsHandle)
    colours = np.asarray(slices.colors).astype(float)
    assert colours.shape == (24, 2, 3)
    assert (colours[:12] == colours[0, 0]).all()
    assert colours[0, 0].sum() > colours[12, 0].sum() + 150.0


def test_the_surface_is_painted_by_the_pictures_that_show_it(drawn: Drawn) -> None:
    points = np.array([[0.1, 0.0, 0.2], [0.2, 0.0, 0.2], [0.3, 0.0, 0.2], [0.4, 0.0, 0.2]])
    drawn.draw(SurfaceSeen(points, np.array([0, 1, 3, 9]), 0.05, Coverage(0.75, 0.5)))
    cloud = drawn.node("/seed/seen")
    assert isinstance(cloud, viser.PointCloudHandle)
    assert cloud.visible
    np.testing.assert_allclose(np.asarray(cloud.points), points, atol=1e-3)
    never, once, thrice, more = np.asarray(cloud.colors).astype(int)
    brightness = [colour.sum() for colour in (never, once, thrice)]
    assert brightness == sorted(brightness)
    assert never[0] > never[1:].max()  # Red.
    np.testing.assert_array_equal(thrice, more)
    drawn.draw(capture_changed("another"))
    assert not cloud.visible


def test_a_taken_picture_dims_the_viewpoint_it_was_planned_for(drawn: Drawn) -> None:
    drawn.draw(pose(), plan(0.0, 1.0, 2.0), taken(0, 1.05))
    colours = [drawn.frustum(f"/plan/{index:02d}/d1").color for index in range(3)]
    assert colours == [BLUE, dimmed(BLUE), BLUE]
    picture = drawn.frustum("/pictures/000")
    assert picture.image is not None
    np.testing.assert_allclose(picture.position[:2], [2 * np.cos(1.05), 2 * np.sin(1.05)])
    drawn.draw(taken(1, 1.0))  # The nearest one is done already, so another one is.
    assert drawn.frustum("/plan/00/d1").color == dimmed(BLUE)


def test_a_route_goes_from_viewpoint_to_viewpoint_and_away_with_its_plan(drawn: Drawn) -> None:
    drawn.draw(pose(), plan(0.0, 1.0, 2.0))
    route = drawn.node("/plan/routes/d1")
    assert isinstance(route, viser.LineSegmentsHandle)
    points = np.asarray(route.points)
    assert points.shape == (2, 2, 3)
    np.testing.assert_array_equal(points[0, 1], points[1, 0])
    assert route.visible
    drawn.draw(PlanViewChosen("ring"))
    assert not route.visible
    drawn.draw(PlanViewChosen("planned"), plan(0.5))
    assert not drawn.node("/plan/routes/d1").visible


def test_a_new_plan_hides_the_old_one(drawn: Drawn) -> None:
    drawn.draw(pose(), plan(0.0, 1.0, 2.0), plan(0.5))
    visible = [drawn.node(f"/plan/{index:02d}/d1").visible for index in range(3)]
    assert visible == [True, False, False]


def test_the_ring_is_shown_beside_the_plan_or_instead_of_it(drawn: Drawn) -> None:
    compared = replace(plan(0.0, 1.0), ring=plan(0.5).assignment)
    drawn.draw(capture_changed("run-1"), pose(), compared)

    def shown() -> tuple[bool, bool]:
        return drawn.node("/plan/01/d1").visible, drawn.node("/ring/00/d1").visible

    assert shown() == (True, False)
    drawn.draw(PlanViewChosen("ring"))
    assert shown() == (False, True)
    drawn.draw(PlanViewChosen("both"))
    assert shown() == (True, True)
    # What was chosen stands for the next plan, too, and an old ring goes with its plan.
    drawn.draw(PlanViewChosen("ring"), replace(plan(0.0, 1.0), ring=plan(0.5).assignment))
    assert shown() == (False, True)
    drawn.draw(plan(0.0, 1.0))
    assert not drawn.node("/ring/00/d1").visible
    drawn.draw(PlanViewChosen("planned"), capture_changed("run-2"))
    assert shown() == (False, False)


def test_candidates_left_over_are_brighter_the_more_they_would_add(drawn: Drawn) -> None:
    spare = tuple(Viewpoint(np.array([1.0 * n, 0.0, 1.0]), 0.0) for n in range(3))
    gains = np.array([0.0, 0.01, 0.02])
    placement = Placement((), 0.5, {}, 100, spare=spare, spare_gains=gains)
    drawn.draw(PlanFound(placement, Assignment(()), WHOLE))
    points = drawn.node("/plan/candidates")
    assert isinstance(points, viser.PointCloudHandle)
    brightness = points.colors.astype(float).sum(axis=1)
    assert (np.diff(brightness) > 0.0).all()
    np.testing.assert_allclose(points.points[:, 0], [0.0, 1.0, 2.0], atol=1e-3)
    drawn.draw(PlanViewChosen("ring"))
    assert not points.visible
    # Those of an earlier capture stay away, whatever is chosen.
    drawn.draw(capture_changed("another"))
    drawn.draw(PlanViewChosen("planned"))
    assert not points.visible


def test_refined_poses_move_the_pictures(drawn: Drawn) -> None:
    drawn.draw(pose(), taken(0, 0.0), taken(1, 1.0))
    refined = np.stack([camera_pose(np.array([9.0, float(i), 1.0]), 0.0, 0.0) for i in range(3)])
    drawn.draw(PosesRefined(refined, np.array([True, True, False])))
    np.testing.assert_allclose(drawn.node("/pictures/001").position, [9.0, 1.0, 1.0])


def test_the_preview_stands_at_its_camera(drawn: Drawn) -> None:
    drawn.draw(preview(), preview())
    node = drawn.frustum("/preview")
    np.testing.assert_allclose(node.position, [1.5, 1.5, 1.5])
    assert node.image is not None
    assert node.image.shape == (240, 320, 3)


def test_a_new_capture_starts_with_an_empty_scene(drawn: Drawn) -> None:
    drawn.draw(capture_changed("run-1"), pose(), pose(x=3.0), seed(), plan(0.0), taken(0, 0.0))
    drawn.draw(preview(), capture_changed("run-1"))
    names = ["/seed/outer", "/plan/00/d1", "/pictures/000", "/preview", "/trails/d1"]
    assert all(drawn.node(name).visible for name in names)
    drawn.draw(capture_changed("run-2"))
    assert not any(drawn.node(name).visible for name in names)
    assert drawn.node("/drones/d1").visible
    drawn.draw(seed(), preview())
    assert drawn.node("/seed/outer").visible
    assert drawn.node("/preview").visible


def test_a_failure_is_logged_once_and_goes_no_further(
    drawn: Drawn, caplog: pytest.LogCaptureFixture
) -> None:
    broken = FrameAnnotated("d1", 0, 0.0, b"no picture", damaged=False)
    drawn.draw(pose(), broken, broken, pose(x=5.0))
    assert [r.message for r in caplog.records if r.levelname == "ERROR"] == [
        "FrameAnnotated could not be drawn; further ones fail quietly"
    ]
    np.testing.assert_allclose(drawn.node("/drones/d1").position, [5.0, 0.0, 1.0])


def test_the_mailbox_keeps_the_newest_and_the_order() -> None:
    mailbox = Mailbox(thumbnail_hz=2.0)
    started, newer = capture_changed("run-1"), pose(x=2.5)
    events: list[Event] = [started, pose(x=2.0), taken(0, 0.0), taken(1, 0.0), newer]
    for event in [*events, capture_changed("run-1")]:
        assert mailbox.offer(event)
    assert not mailbox.offer(capture_changed("run-1", "succeeded"))
    assert mailbox.take(0.0) == [started, events[2], events[3], newer]
    assert mailbox.take(0.0) == []


def test_the_mailbox_lets_thumbnails_through_only_so_often() -> None:
    mailbox = Mailbox(thumbnail_hz=2.0)
    shown = []
    for step in range(101):
        mailbox.offer(frame("d1", step))
        mailbox.offer(frame("d2", step))
        shown += [e.sequence for e in mailbox.take(step * 0.01) if isinstance(e, FrameAnnotated)]
    assert shown == [0, 0, 50, 50, 100, 100]


async def test_the_view_follows_a_mission_and_ends_with_it() -> None:
    events = EventStream()
    async with SceneView() as view, asyncio.timeout(20):
        assert view.port > 0
        box = Box3(np.array([1.0, -1.0, 0.0]), np.array([2.0, 1.0, 3.0]))
        standing = [NoGoChanged((NoGoVolume("no-go-1", box),))]
        following = asyncio.create_task(view.follow(events, standing))
        await asyncio.sleep(0)
        # What stood before anybody looked is drawn without any news.
        while view.nodes.get_handle_by_name("/world/no_go") is None:  # noqa: ASYNC110
            await asyncio.sleep(0.01)
        while view.nodes.get_handle_by_name("/drones/d1/camera") is None:
            events.publish(pose())
            events.publish(frame())
            await asyncio.sleep(0.01)
        following.cancel()
        with pytest.raises(asyncio.CancelledError):
            await following


async def test_drawing_never_holds_up_the_mission(monkeypatch: pytest.MonkeyPatch) -> None:
    """While the drawing thread is stuck, the event loop goes on and the newest event wins."""
    events = EventStream()
    drawn: list[float] = []

    def slow(_: Stage, event: Event, now_s: float) -> None:
        assert isinstance(event, PoseEstimated)
        time.sleep(0.2)
        drawn.append(float(event.pose.position_world[0]))

    monkeypatch.setattr(Stage, "draw", slow)
    async with SceneView() as view, asyncio.timeout(20):
        following = asyncio.create_task(view.follow(events))
        await asyncio.sleep(0)
        for step in range(1000):
            events.publish(pose(x=float(step)))
            await asyncio.sleep(0)
        await until(lambda: drawn[-1:] == [999.0])
        following.cancel()
        await asyncio.gather(following, return_exceptions=True)
    assert len(drawn) < 100


async def test_no_viewer_may_open_a_public_tunnel(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[object] = []
    monkeypatch.setattr(viser.ViserServer, "request_share_url", lambda *_, **__: opened.append(1))
    async with SceneView() as view, asyncio.timeout(20):
        url = f"ws://127.0.0.1:{view.port}/"
        async with connect(url, subprotocols=[VISER], proxy=None, max_size=None) as viewer:
            await viewer.send(msgspec.msgpack.encode({"type": "ShareUrlRequest"}))
            await until(lambda: "refused" in caplog.text or bool(opened))
    assert opened == []


def test_nothing_is_printed_and_nothing_works_unstarted(
    capfd: pytest.CaptureFixture[str],
) -> None:
    view = SceneView()
    with pytest.raises(RuntimeError, match="not started"):
        _ = view.port
    view.start()
    view.stop()
    view.stop()
    captured = capfd.readouterr()
    assert captured.out == ""


def test_parts_of_priority_are_boxes_once_they_are_found(drawn: Drawn) -> None:
    waiting = PriorityPart("p1", "d1", (0.1, 0.1, 0.5, 0.5), 4.0)
    box = Box3(np.array([-0.1, -0.1, 0.5]), np.array([0.1, 0.1, 0.8]))
    drawn.draw(PrioritiesChanged((waiting,)))
    assert drawn.scene.get_handle_by_name("/seed/priorities") is None
    drawn.draw(PrioritiesChanged((waiting, replace(waiting, id="p2", box=box))))
    node = drawn.node("/seed/priorities")
    assert isinstance(node, viser.LineSegmentsHandle)
    points = np.asarray(node.points)
    assert points.shape == (12, 2, 3)
    assert points.min(axis=(0, 1)) == pytest.approx(box.lower)
    assert points.max(axis=(0, 1)) == pytest.approx(box.upper)
    drawn.draw(PrioritiesChanged(()))
    assert not drawn.node("/seed/priorities").visible


def test_no_go_volumes_are_boxes_of_the_room(drawn: Drawn) -> None:
    drawn.draw(NoGoChanged(()))
    assert drawn.scene.get_handle_by_name("/world/no_go") is None
    box = Box3(np.array([1.0, -1.0, 0.0]), np.array([2.0, 1.0, 1.5]))
    drawn.draw(NoGoChanged((NoGoVolume("no-go-1", box),)))
    node = drawn.node("/world/no_go")
    assert isinstance(node, viser.LineSegmentsHandle)
    points = np.asarray(node.points)
    assert points.min(axis=(0, 1)) == pytest.approx(box.lower)
    assert points.max(axis=(0, 1)) == pytest.approx(box.upper)
    drawn.draw(NoGoChanged(()))
    assert not drawn.node("/world/no_go").visible
    mailbox, newest = Mailbox(thumbnail_hz=5.0), NoGoChanged(())
    assert mailbox.offer(NoGoChanged(()))
    assert mailbox.offer(newest)
    assert mailbox.take(0.0) == [newest]


def test_priorities_replace_those_that_wait_to_be_drawn() -> None:
    mailbox = Mailbox(thumbnail_hz=5.0)
    newest = PrioritiesChanged(())
    assert mailbox.offer(PrioritiesChanged(()))
    assert mailbox.offer(newest)
    assert mailbox.take(0.0) == [newest]
