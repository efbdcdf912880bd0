"""``dronerf calibrate``: from pictures, from a live drone, into a fleet file."""

from __future__ import annotations

import asyncio
import json
import os
import re
import tomllib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from board_pictures import BoardCamera, various_poses
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from PIL import Image
from rig import HARMLESS, Rig, rig

from server.doctor import network
from server.doctor.board_sheet import SheetError, write_board
from server.doctor.calibrate import CalibrateOptions, run_calibrate, views_of_pictures
from server.doctor.calibration_report import coverage_map
from server.doctor.config import DoctorConfig, LiveConfig
from server.doctor.network import Holder
from server.geometry.cameras import TELLO_INTRINSICS, Intrinsics
from server.store.fleet_edit import write_intrinsics
from server.swarm.fleet_file import FleetFileError, load_fleet
from server.vision.calibration_board import BoardFinder, parse_board

BOARD = "charuco:7x5:38:28"
CAMERA = Intrinsics(960, 720, 931.0, 927.0, 468.0, 352.0, (-0.035, 0.105, 0.0013, -0.0016, 0.0))

FLEET = """\
# Ours.
start_radius_m = 2.0  # the big room

[[drones]]
id = "red"        # the red one
address = "192.168.1.20"
[drones.intrinsics]
fx = 900.0  # guessed

[[drones]]
id = "blue"
address = "192.168.1.21"
"""


@pytest.fixture(scope="module")
def pictures() -> list[NDArray[np.uint8]]:
    """What somebody careful would show to the camera."""
    camera = BoardCamera(CAMERA, parse_board(BOARD))
    poses = various_poses(camera, 14, np.random.default_rng(3))
    return [camera.picture(*pose) for pose in poses]


def saved(folder: Path, pictures: Sequence[NDArray[np.uint8]]) -> Path:
    folder.mkdir(exist_ok=True)
    for index, picture in enumerate(pictures):
        cv2.imwrite(str(folder / f"{index:02d}.png"), picture)
    return folder


async def calibrate(**options: object) -> int:
    made = CalibrateOptions(**{"board": BOARD, **options})  # pyright: ignore[reportArgumentType]
    return await run_calibrate(made, asyncio.Event())


@pytest.mark.slow
async def test_from_pictures_into_a_fleet_file(
    tmp_path: Path, pictures: list[NDArray[np.uint8]], capsys: pytest.CaptureFixture[str]
) -> None:
    folder = saved(tmp_path / "pictures", pictures)
    (folder / "13b.png").write_bytes(b"no picture")
    (folder / "notes.txt").write_text("not looked at")
    fleet = tmp_path / "fleet.toml"
    fleet.write_text(FLEET)
    given_options = {"pictures": folder, "drone_id": "blue", "out": fleet}
    assert await calibrate(**given_options, out_dir=tmp_path / "out", as_json=True) == 0
    printed = capsys.readouterr()
    result = json.loads(printed.out)
    assert result["fx"] == pytest.approx(CAMERA.fx, rel=0.005)
    assert result["fy"] == pytest.approx(CAMERA.fy, rel=0.005)
    assert result["reprojection_px_mean"] < 0.3
    assert 0.0 < result["sd"]["fx"] < 5.0
    assert result["written"] == str(fleet)
    assert "13b.png: no readable picture" in printed.err
    assert "found in 14 of 15 pictures" in printed.err
    read = {drone.id: drone.intrinsics for drone in load_fleet(fleet).drones}
    assert read["blue"].fx == pytest.approx(result["fx"], abs=1e-3)
    assert read["blue"].distortion == pytest.approx(result["distortion"], abs=1e-6)
    assert read["red"].fx == 900.0
    coverage = cv2.imread(str(tmp_path / "out" / "coverage.png"))
    assert coverage is not None
    assert coverage.shape == (720, 960, 3)


@pytest.mark.slow
async def test_the_text_for_people_tells_errors_and_coverage(
    tmp_path: Path, pictures: list[NDArray[np.uint8]], capsys: pytest.CaptureFixture[str]
) -> None:
    assert await calibrate(pictures=saved(tmp_path / "p", pictures)) == 0
    text = capsys.readouterr().out
    assert "reprojection error" in text
    assert "coverage" in text
    assert "07.png" in text


@pytest.mark.loopback
@pytest.mark.slow
async def test_from_a_live_drone_in_the_hand(
    tmp_path: Path, pictures: list[NDArray[np.uint8]], capsys: pytest.CaptureFixture[str]
) -> None:
    async with rig(pictures=pictures, each=14) as made:
        fleet = tmp_path / "fleet.toml"
        where = f'address = "{made.config.address}"\nlocal_address = "{made.config.local_address}"'
        fleet.write_text(f'[[drones]]\nid = "red"\n{where}\n')
        code = await calibrate(
            drone_id="red",
            fleet=fleet,
            out=fleet,
            as_json=True,
            live=LiveConfig(views=12, patience_s=60.0),
        )
        streaming = made.drones[0].sdk.streaming
        phase = made.drones[0].airframe.phase
    printed = capsys.readouterr()
    assert code == 0, printed.err
    result = json.loads(printed.out)
    assert result["fx"] == pytest.approx(CAMERA.fx, rel=0.01)
    assert len(result["views"]) + len(result["dropped"]) == 12
    assert "views 12 of 12" in printed.err
    assert load_fleet(fleet).drones[0].intrinsics.fx == pytest.approx(result["fx"], abs=1e-3)
    assert set(made.heard) <= HARMLESS
    assert (streaming, phase) == (False, "standing")


def station_file(folder: Path, made: Rig, serial: str) -> Path:
    """Write the fleet file of a station known by its serial number, with ports of its own."""
    drone = made.config
    fleet = folder / "fleet.toml"
    fleet.write_text(
        f'[station]\nsubnet = "{drone.address.rsplit(".", 1)[0]}.0/29"\n'
        f'[[drones]]\nid = "red"\nlink = "station"\nserial = "{serial}"\n'
        f'local_address = "{drone.local_address}"\nstate_port = 8990\nvideo_port = 11990\n'
    )
    return fleet


@pytest.mark.loopback
@pytest.mark.slow
async def test_a_station_known_by_its_serial_number_is_found_and_told_its_ports(
    tmp_path: Path, pictures: list[NDArray[np.uint8]], capsys: pytest.CaptureFixture[str]
) -> None:
    async with rig(pictures=pictures, each=14, station=True) as made:
        serial = made.drones[0].sdk._serial
        options = CalibrateOptions(BOARD, fleet=station_file(tmp_path, made, serial))
        stop = asyncio.Event()
        running = asyncio.create_task(run_calibrate(options, stop))
        told = ""
        async with asyncio.timeout(60.0):
            while "views 1 of" not in told and not running.done():
                await asyncio.sleep(0.05)
                told += capsys.readouterr().err
            stop.set()
            assert await running == 1
        streaming = made.drones[0].sdk.streaming
    told += capsys.readouterr().err
    assert "Looking for red in 127." in told
    assert "too few" in told, "it was ended early, but its reports and its video had come"
    assert set(made.heard) - HARMLESS == {"port 8990 11990"}
    assert not streaming


@pytest.mark.loopback
@pytest.mark.slow
async def test_a_serial_number_nobody_has(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    async with rig(station=True) as made:
        assert await calibrate(fleet=station_file(tmp_path, made, "0TQDG3UEDBSP12")) == 1
    assert "no drone with the serial number 0TQDG3UEDBSP12 in 127." in capsys.readouterr().err
    assert set(made.heard) <= HARMLESS


@pytest.mark.loopback
async def test_nothing_is_searched_beside_a_running_console(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    console = Holder(4711, "/x/bin/python /x/bin/dronerf serve --fleet f.toml")
    monkeypatch.setattr(network, "read_holders", lambda port, where: [console])
    async with rig(station=True) as made:
        assert await calibrate(fleet=station_file(tmp_path, made, "0TQDG3UEDBSP12")) == 1
    assert "a console has the drones, process 4711" in capsys.readouterr().err
    assert made.heard == []


@pytest.mark.loopback
@pytest.mark.slow
async def test_a_drone_in_the_air_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    async with rig() as made:
        made.drones[0].airframe.take_off()
        fleet = tmp_path / "fleet.toml"
        where = f'address = "{made.config.address}"\nlocal_address = "{made.config.local_address}"'
        fleet.write_text(f'[[drones]]\nid = "red"\n{where}\n')
        assert await calibrate(drone_id="red", fleet=fleet) == 1
    assert "motors of red run" in capsys.readouterr().err
    assert set(made.heard) == {"command"}


@pytest.mark.loopback
@pytest.mark.slow
async def test_a_drone_that_takes_off_meanwhile_ends_it(
    tmp_path: Path, pictures: list[NDArray[np.uint8]], capsys: pytest.CaptureFixture[str]
) -> None:
    async with rig(pictures=pictures[:1]) as made:
        fleet = tmp_path / "fleet.toml"
        where = f'address = "{made.config.address}"\nlocal_address = "{made.config.local_address}"'
        fleet.write_text(f'[[drones]]\nid = "red"\n{where}\n')
        running = asyncio.create_task(calibrate(drone_id="red", fleet=fleet))
        async with asyncio.timeout(30.0):
            while "streamon" not in made.heard:  # noqa: ASYNC110 - The truth raises no events.
                await asyncio.sleep(0.05)
            made.drones[0].airframe.take_off()
            assert await running == 1
    assert "motors of red run" in capsys.readouterr().err
    assert set(made.heard) <= HARMLESS


@pytest.mark.loopback
async def test_nobody_there(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    fleet = tmp_path / "fleet.toml"
    fleet.write_text('[[drones]]\naddress = "127.9.9.9"\nlocal_address = "127.9.9.109"\n')
    hasty = DoctorConfig(reply_s=0.05)
    assert await calibrate(drone_id="drone-1", fleet=fleet, waits=hasty) == 1
    assert "does not answer at 127.9.9.9" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"board": "chess"}, "a board is written like"),
        ({"pictures": Path("no-such-folder")}, "is not a folder"),
        ({"drone_id": "red", "live": LiveConfig(views=3)}, "--views must be at least 10"),
        ({"pictures": Path(), "out": Path("no-such.toml")}, "cannot be read"),
    ],
)
async def test_what_does_not_fit_together(
    options: dict[str, object], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert await calibrate(**options) == 2
    printed = capsys.readouterr()
    assert words in printed.err
    assert printed.out == ""
    assert len(printed.err.splitlines()) == 1


async def test_which_drone_must_be_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    fleet = tmp_path / "fleet.toml"
    fleet.write_text(FLEET)
    assert await calibrate(pictures=tmp_path, out=fleet) == 2
    assert "name one with --drone: red, blue" in capsys.readouterr().err
    assert await calibrate(pictures=tmp_path, out=fleet, drone_id="green") == 2
    assert "has no drone 'green'" in capsys.readouterr().err


async def test_too_few_pictures_change_no_file(
    tmp_path: Path, pictures: list[NDArray[np.uint8]], capsys: pytest.CaptureFixture[str]
) -> None:
    fleet = tmp_path / "fleet.toml"
    fleet.write_text(FLEET)
    folder = saved(tmp_path / "pictures", pictures[:4])
    assert await calibrate(pictures=folder, drone_id="red", out=fleet) == 1
    assert "4 good views are too few" in capsys.readouterr().err
    assert fleet.read_text() == FLEET
    assert sorted(os.listdir(tmp_path)) == ["fleet.toml", "pictures"]


async def test_the_wrong_board_is_explained(
    tmp_path: Path, pictures: list[NDArray[np.uint8]], capsys: pytest.CaptureFixture[str]
) -> None:
    folder = saved(tmp_path / "pictures", pictures[:2])
    assert await calibrate(pictures=folder, board="charuco:7x5:38:28:6x6_250") == 1
    assert "another dictionary are seen: try :5x5_100" in capsys.readouterr().err


async def test_pictures_of_two_sizes(
    tmp_path: Path, pictures: list[NDArray[np.uint8]], capsys: pytest.CaptureFixture[str]
) -> None:
    small = cv2.resize(pictures[0], (640, 480))
    folder = saved(tmp_path / "pictures", [*pictures[:2], np.asarray(small, np.uint8)])
    assert await calibrate(pictures=folder) == 1
    assert "640x480 (02.png)" in capsys.readouterr().err


def test_everything_else_in_the_fleet_file_stays(tmp_path: Path) -> None:
    fleet = tmp_path / "fleet.toml"
    fleet.write_text(FLEET)
    backup = write_intrinsics(fleet, "red", CAMERA, "By a test.")
    assert backup.read_text() == FLEET
    changed = fleet.read_text()
    for line in (
        "# Ours.",
        "start_radius_m = 2.0  # the big room",
        'id = "red"        # the red one',
    ):
        assert line in changed
    assert "By a test." in changed
    assert "guessed" not in changed
    red, blue = load_fleet(fleet).drones
    assert red.intrinsics == CAMERA
    assert blue.intrinsics == TELLO_INTRINSICS
    again = write_intrinsics(fleet, "blue", CAMERA, "Again.")
    assert again != backup
    assert backup.read_text() == FLEET
    assert again.read_text() == changed
    assert load_fleet(fleet).drones[1].intrinsics == CAMERA


PULLS = """\
[[drones]]
id = "drone-1"
address = "10.0.0.1"
# interface = "wlan1"

# drone-2 pulls to the left
[[drones]]
id = "drone-2"
address = "10.0.0.2"

# The room's network.
[station]
subnet = "192.168.1.0/24"
"""


def test_comments_between_drones_stay_where_they_are(tmp_path: Path) -> None:
    fleet = tmp_path / "fleet.toml"
    fleet.write_text(PULLS)
    for drone_id in ("drone-1", "drone-2"):
        write_intrinsics(fleet, drone_id, CAMERA, "Calibrated with a board, 20 views.")
    once = fleet.read_text()
    # Nothing but the two tables has come, each at the end of its drone.
    first, second, rest = once.split("[drones.intrinsics]\n")
    assert first == PULLS[: PULLS.index("\n# drone-2")] + "\n"
    numbers = second[: second.index("\n\n") + 1]
    assert (
        second == numbers + PULLS[PULLS.index("\n# drone-2") : PULLS.index("\n# The room")] + "\n"
    )
    assert rest == numbers + PULLS[PULLS.index("\n# The room") :]
    assert numbers.startswith("# Calibrated with a board, 20 views.\nwidth = 960\n")
    once = once.replace("cx = ", "# The lens was changed.\ncx = ", 1)
    fleet.write_text(once)
    for drone_id in ("drone-2", "drone-1"):
        write_intrinsics(fleet, drone_id, CAMERA, "Calibrated with a board, 30 views.")
    assert fleet.read_text() == once.replace("20 views", "30 views")


@pytest.mark.parametrize(
    "lines",
    [
        'intrinsics = {fx = 900.0, fy = 900.0} # in one line\nname = "One"',
        'intrinsics.fx = 900.0\nintrinsics.fy = 900.0\nname = "One"',
        'name = "One"\n  [drones.intrinsics]  # mine\n  fx = 900.0',
        'name = "One"',
    ],
)
def test_however_a_camera_was_written_its_numbers_are_replaced(tmp_path: Path, lines: str) -> None:
    fleet = tmp_path / "fleet.toml"
    text = PULLS.replace('# interface = "wlan1"', lines)
    fleet.write_text(text)
    for _ in range(2):
        write_intrinsics(fleet, "drone-1", CAMERA, "Calibrated with a board.")
        first, second = load_fleet(fleet).drones
        assert (first.name, first.intrinsics) == ("One", CAMERA)
        assert second.intrinsics == TELLO_INTRINSICS
        assert fleet.read_text().endswith(text[text.index("\n\n# drone-2") :])
        for comment in re.findall("# (?:mine|in one line)", lines):
            assert comment in fleet.read_text()


def test_drones_written_in_one_line_and_without_ids(tmp_path: Path) -> None:
    fleet = tmp_path / "fleet.toml"
    fleet.write_text('drones = [{address = "10.0.0.1"}, {address = "10.0.0.2"}]\n')
    write_intrinsics(fleet, "drone-2", CAMERA, "By a test.")
    assert [drone.intrinsics for drone in load_fleet(fleet).drones] == [TELLO_INTRINSICS, CAMERA]


def test_a_broken_or_foreign_file_is_left_alone(tmp_path: Path) -> None:
    fleet = tmp_path / "fleet.toml"
    for text in ("drones = [", "[[drones]]\nheight = 3\n", FLEET):
        fleet.write_text(text)
        with pytest.raises(FleetFileError, match=r"fleet\.toml"):
            write_intrinsics(fleet, "green", CAMERA, "")
        assert fleet.read_text() == text
    assert [path.name for path in tmp_path.iterdir()] == ["fleet.toml"]


@given(
    fx=st.floats(100.0, 5000.0),
    cx=st.floats(0.0, 2000.0),
    terms=st.tuples(*[st.floats(-10.0, 10.0)] * 5),
)
def test_any_camera_is_read_back(
    tmp_path_factory: pytest.TempPathFactory, fx: float, cx: float, terms: tuple[float, ...]
) -> None:
    fleet = tmp_path_factory.mktemp("fleet") / "fleet.toml"
    fleet.write_text(FLEET)
    k1, k2, p1, p2, k3 = terms
    camera = replace(CAMERA, fx=fx, cx=cx, distortion=(k1, k2, p1, p2, k3))
    write_intrinsics(fleet, "blue", camera, "By a test.")
    read = load_fleet(fleet).drones[1].intrinsics
    assert read.fx == pytest.approx(fx, abs=1e-4)
    assert read.cx == pytest.approx(cx, abs=1e-4)
    assert read.distortion == pytest.approx(terms, abs=1e-6)
    table = tomllib.loads(fleet.read_text())["drones"][0]
    assert table["intrinsics"] == {"fx": 900.0}


@pytest.mark.parametrize("ending", ["png", "pdf"])
async def test_the_board_can_be_printed(
    tmp_path: Path, ending: str, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / f"board.{ending}"
    assert await calibrate(board_image=file) == 0
    assert f"print {file} on A4 at actual size" in capsys.readouterr().err
    if ending == "pdf":
        box = re.search(rb"/MediaBox \[ ?0 0 ([\d.]+) ([\d.]+) ?\]", file.read_bytes())
        assert box is not None
        # A4 lying down, in points.
        assert [float(edge) for edge in box.groups()] == pytest.approx([842, 595], abs=1.0)
        return
    with Image.open(file) as sheet:
        dpi = float(sheet.info["dpi"][0])
        picture = np.asarray(sheet.convert("L"), np.uint8)
    small = cv2.resize(picture, None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA)
    view = BoardFinder(parse_board(BOARD)).find(np.asarray(small, np.uint8))
    assert view is not None
    assert len(view.ids) == 24
    order = np.argsort(view.ids)
    span_px = 4.0 * (view.pixels[order[5]] - view.pixels[order[0]])[0]
    assert span_px / dpi * 25.4 == pytest.approx(5 * 38.0, rel=0.002)


def test_a_board_is_only_written_in_forms_it_can_be(tmp_path: Path) -> None:
    with pytest.raises(SheetError, match=r"\.png or \.pdf"):
        write_board(parse_board(BOARD), tmp_path / "board.gif")
    with pytest.raises(SheetError, match="cannot be written"):
        write_board(parse_board(BOARD), tmp_path / "missing" / "board.png")


def test_a_folder_without_pictures(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="holds no pictures"):
        views_of_pictures(tmp_path, parse_board(BOARD))


def test_the_map_is_darker_where_more_was_seen() -> None:
    lines = coverage_map(np.array([[0, 1], [4, 100]])).splitlines()
    assert lines == ["+----+", "|  ..|", "|::##|", "+----+"]
