"""A camera is calibrated from the pictures of a drone that stands; nothing else is disturbed."""

from __future__ import annotations

import asyncio
import os
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from fake_camera import LENS, FakeCamera, board_shown
from numpy.typing import NDArray
from virtual_console import REQUEST, tell
from virtual_console import until as virtually

from server.bench.missions.virtual_flight import VirtualFlight
from server.geometry.cameras import TELLO_INTRINSICS
from server.mission.board_views import GatherConfig
from server.mission.calibration_record import CalibrationRecord
from server.mission.calibrations import Calibrations
from server.mission.commands import RefusedError, UnknownError
from server.mission.control import Control
from server.mission.events import EventStream, Noted
from server.swarm.fleet import Fleet
from server.swarm.fleet_file import load_fleet
from server.vision.calibration_board import BoardFinder

FLEET = (
    '[[drones]]\nid = "drone-1"  # the red one\n[[drones]]\nid = "drone-2"\naddress = "10.0.0.2"\n'
)
QUICK = GatherConfig(views=12, patience_s=60.0)


@pytest.fixture(scope="module")
def pictures() -> list[NDArray[np.uint8]]:
    return board_shown()


@dataclass
class Bench:
    """Two cameras and their calibrations."""

    capture: bool = False
    cameras: dict[str, FakeCamera] = field(
        default_factory=lambda: {name: FakeCamera(name) for name in ("drone-1", "drone-2")}
    )
    events: EventStream = field(default_factory=EventStream)

    def desk(self, file: Path | None = None, gathering: GatherConfig = QUICK) -> Calibrations:
        return Calibrations(self.cameras, lambda: self.capture, self.events, file, gathering)


async def until(
    desk: Calibrations, holds: Callable[[CalibrationRecord], bool], drone_id: str = "drone-1"
) -> CalibrationRecord:
    async with asyncio.timeout(60.0):
        while not holds(desk.record(drone_id)):  # noqa: ASYNC110 - It is asked, as browsers do.
            await asyncio.sleep(0.01)
    return desk.record(drone_id)


@pytest.mark.slow
async def test_a_camera_is_found_written_and_used(
    tmp_path: Path, pictures: list[NDArray[np.uint8]]
) -> None:
    file = tmp_path / "fleet.toml"
    file.write_text(FLEET)
    bench = Bench()
    bench.cameras["drone-1"].pictures = pictures
    desk = bench.desk(file)
    assert desk.record("drone-1").state == "idle"
    begun = desk.start("drone-1")
    assert (begun.state, begun.progress.views, begun.views_wanted) == ("collecting", 0, 12)
    half = await until(desk, lambda r: r.progress.views >= 6)
    assert half.hint is not None
    assert half.progress.coverage.sum() >= 6 * 8
    done = await until(desk, lambda r: r.state == "solved")
    assert done.hint is None
    assert done.result is not None
    found = done.result.calibration
    assert found.intrinsics.fx == pytest.approx(LENS.fx, rel=0.01)
    assert found.mean_px < 0.3
    assert done.result.coverage_png.startswith(b"\x89PNG")
    assert "[drones.intrinsics]" in done.result.toml
    # Found is not used yet.
    assert bench.cameras["drone-1"].config.intrinsics == TELLO_INTRINSICS
    assert file.read_text() == FLEET

    used = await desk.apply("drone-1")
    assert used.applied is not None
    assert used.applied.backup is not None
    assert used.applied.backup.read_text() == FLEET
    assert bench.cameras["drone-1"].config.intrinsics == found.intrinsics
    one, two = load_fleet(file).drones
    assert one.intrinsics.fx == pytest.approx(found.intrinsics.fx, abs=1e-3)
    assert two.intrinsics == TELLO_INTRINSICS
    assert "# the red one" in file.read_text()
    # The snippet is what was written.
    assert done.result.toml.splitlines()[-1] in file.read_text()
    assert not bench.cameras["drone-1"].videos, "the video was on and is left alone"
    assert desk.cancel("drone-1").state == "idle"


async def test_without_a_file_it_is_used_until_the_console_ends(
    pictures: list[NDArray[np.uint8]],
) -> None:
    bench = Bench()
    bench.cameras["drone-1"].pictures = pictures
    desk = bench.desk()
    desk.start("drone-1")
    await until(desk, lambda r: r.state == "solved")
    used = await desk.apply("drone-1")
    assert used.applied is not None
    assert (used.applied.file, used.applied.problem) == (None, "")
    assert bench.cameras["drone-1"].config.intrinsics != TELLO_INTRINSICS


async def test_two_cameras_used_at_once_are_both_written(
    tmp_path: Path, pictures: list[NDArray[np.uint8]]
) -> None:
    file = tmp_path / "fleet.toml"
    file.write_text(FLEET)
    bench = Bench()
    desk = bench.desk(file)
    for drone_id, camera in bench.cameras.items():
        camera.pictures = pictures
        desk.start(drone_id)
        await until(desk, lambda r: r.state == "solved", drone_id)
    used = await asyncio.gather(*(desk.apply(drone_id) for drone_id in bench.cameras))
    assert len({record.applied.backup for record in used if record.applied}) == 2
    for drone in load_fleet(file).drones:
        assert drone.intrinsics != TELLO_INTRINSICS


async def test_a_file_that_cannot_be_written_is_told(
    tmp_path: Path, pictures: list[NDArray[np.uint8]]
) -> None:
    file = tmp_path / "fleet.toml"
    file.write_text('[[drones]]\nid = "another"\n')
    bench = Bench()
    bench.cameras["drone-1"].pictures = pictures
    desk = bench.desk(file)
    desk.start("drone-1")
    await until(desk, lambda r: r.state == "solved")
    with bench.events.subscribe(8) as news:
        used = await desk.apply("drone-1")
        told = await anext(aiter(news))
    assert isinstance(told, Noted)
    assert (told.level, "until the console ends: " in told.text) == ("warning", True)
    assert used.applied is not None
    assert "there is no drone 'drone-1'" in used.applied.problem
    assert used.applied.file is None
    assert bench.cameras["drone-1"].config.intrinsics != TELLO_INTRINSICS
    assert [path.name for path in os.scandir(tmp_path)] == ["fleet.toml"]


async def test_too_few_views_are_refused_and_gone_on_with(
    pictures: list[NDArray[np.uint8]],
) -> None:
    bench = Bench()
    camera = bench.cameras["drone-1"]
    camera.pictures = pictures
    desk = bench.desk()
    with pytest.raises(RefusedError, match="not being calibrated"):
        desk.finish("drone-1")
    desk.start("drone-1")
    await until(desk, lambda r: r.progress.views >= 2)
    desk.finish("drone-1")
    refused = await until(desk, lambda r: r.state == "refused")
    assert refused.lack == "few_views"
    assert "10 are needed" in refused.reason
    with pytest.raises(RefusedError, match="no calibration of drone-1 to use"):
        await desk.apply("drone-1")
    spent_s = refused.spent_s
    again = desk.start("drone-1", go_on=True)
    assert again.progress.views == refused.progress.views
    assert again.spent_s >= spent_s
    solved = await until(desk, lambda r: r.state == "solved")
    assert solved.progress.views == 12
    assert desk.start("drone-1").progress.views == 0, "begun anew"
    await desk.close()


@pytest.mark.parametrize(
    ("ends", "ending"),
    [
        (lambda bench: setattr(bench, "capture", True), "capture"),
        (lambda bench: setattr(bench.cameras["drone-2"], "airborne", True), "flight"),
        (lambda bench: setattr(bench.cameras["drone-1"], "activity", "flying"), "flight"),
        (lambda bench: setattr(bench.cameras["drone-1"], "activity", "offline"), "offline"),
        (lambda bench: setattr(bench.cameras["drone-1"], "gone", True), "offline"),
    ],
)
async def test_it_gives_way_to_what_flies_and_needs_a_drone_that_stands(
    ends: Callable[[Bench], None], ending: str
) -> None:
    bench = Bench()
    bench.cameras["drone-1"].pictures = [np.zeros((360, 480, 3), np.uint8)]
    desk = bench.desk()
    desk.start("drone-1")
    await until(desk, lambda r: r.hint == "show_board")
    ends(bench)
    over = await until(desk, lambda r: r.state == "ended")
    assert over.ending == ending
    assert over.reason
    assert over.hint is None
    if ending != "offline" or not bench.cameras["drone-1"].gone:
        with pytest.raises(RefusedError):
            desk.start("drone-1")


async def test_one_at_a_time_and_known_drones_only() -> None:
    bench = Bench()
    desk = bench.desk()
    for call in (desk.record, desk.start, desk.finish, desk.cancel):
        with pytest.raises(UnknownError, match="no drone 'drone-9'"):
            call("drone-9")
    desk.start("drone-1")
    with pytest.raises(RefusedError, match="the camera of drone-1 is being calibrated"):
        desk.start("drone-2")
    with pytest.raises(RefusedError, match="the camera of drone-1 is being calibrated"):
        desk.start("drone-1")
    cancelled = desk.cancel("drone-1")
    assert (cancelled.state, cancelled.ending) == ("ended", "cancelled")
    assert desk.start("drone-2").state == "collecting"
    desk.end_for("capture", "a capture begins")
    over = desk.record("drone-2")
    assert (over.state, over.ending, over.reason) == ("ended", "capture", "a capture begins")
    at_s = over.spent_s
    await asyncio.sleep(0.05)
    assert desk.record("drone-2").spent_s == at_s
    await desk.close()


async def test_video_that_was_off_is_on_only_meanwhile() -> None:
    bench = Bench()
    camera = bench.cameras["drone-1"]
    camera.video_wanted = False
    desk = bench.desk()
    desk.start("drone-1")
    assert camera.videos == [True]
    # Also for a capture that may well fly without it; whoever is to fly gets it back on.
    for end in (lambda: desk.cancel("drone-1"), lambda: desk.end_for("capture", "it begins")):
        end()
        assert not camera.video_wanted
        await asyncio.sleep(0.02)
        assert not camera.video_wanted
        desk.start("drone-1")
    await desk.close()
    assert camera.videos == [True, False] * 3


async def test_no_calibration_takes_the_pictures_of_a_drone_that_rises() -> None:
    bench = Bench()
    camera = bench.cameras["drone-1"]
    camera.video_wanted = False
    desk = bench.desk()
    desk.start("drone-1")
    await asyncio.sleep(0.02)
    desk.cancel("drone-1")
    # The take-off comes in the same breath, before the calibration has tidied up.
    camera.set_video(True)
    camera.activity, camera.airborne = "taking_off", True
    await asyncio.sleep(0.02)
    await desk.close()
    assert camera.video_wanted


async def test_nothing_new_for_long_ends_it() -> None:
    desk = Bench().desk(gathering=GatherConfig(views=12, patience_s=0.05))
    desk.start("drone-1")
    over = await until(desk, lambda r: r.state == "refused")
    assert over.lack == "few_views"


async def test_what_breaks_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    def break_down(*_: object) -> None:
        raise OSError("broken")

    monkeypatch.setattr(BoardFinder, "find", break_down)
    bench = Bench()
    bench.cameras["drone-1"].pictures = [np.zeros((360, 480, 3), np.uint8)]
    desk = bench.desk()
    desk.start("drone-1")
    over = await until(desk, lambda r: r.state == "ended")
    assert (over.ending, "log says why" in over.reason) == ("failed", True)


async def test_a_slow_search_holds_nothing_up(monkeypatch: pytest.MonkeyPatch) -> None:
    busy, go = threading.Event(), threading.Event()
    looked: list[float] = []

    def find(*_: object) -> None:
        looked.append(0.0)
        busy.set()
        go.wait(10.0)

    monkeypatch.setattr(BoardFinder, "find", find)
    bench = Bench()
    bench.cameras["drone-1"].pictures = [np.zeros((360, 480, 3), np.uint8)]
    desk = bench.desk()
    desk.start("drone-1")
    await asyncio.to_thread(busy.wait, 10.0)
    loop = asyncio.get_running_loop()
    before_s = loop.time()
    for _ in range(20):
        await asyncio.sleep(0.005)
    assert loop.time() - before_s < 5.0
    assert len(looked) == 1, "one picture at a time"
    bench.capture = True
    desk.end_for("capture", "a capture begins")
    assert desk.record("drone-1").state == "ended"
    go.set()
    await desk.close()


@pytest.mark.slow
@pytest.mark.parametrize("flies", ["takeoff", "capture"])
def test_the_console_flies_and_the_calibration_gives_way(tmp_path: Path, flies: str) -> None:
    async def story(flight: VirtualFlight, control: Control, fleet: Fleet) -> None:
        drone = fleet.drones["drone-1"]
        await virtually(lambda: drone.activity == "ground" and drone.newest_frame is not None)
        control.calibrations.start("drone-1")
        await asyncio.sleep(0.5)
        assert control.calibrations.record("drone-1").state == "collecting"
        if flies == "takeoff":
            await control.command_drone("drone-2", "takeoff")
        else:
            await control.start_capture(REQUEST)
        over = control.calibrations.record("drone-1")
        assert over.state == "ended"
        assert over.ending == ("flight" if flies == "takeoff" else "capture")
        with pytest.raises(RefusedError, match="capture" if flies == "capture" else "in the air"):
            control.calibrations.start("drone-1")

    tell(story, tmp_path)
