"""The command line as people meet it: real processes, their exit codes and what they say."""

from __future__ import annotations

import json
import os
import re
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

pytestmark = pytest.mark.slow

DRONERF = Path(sys.executable).with_name("dronerf")
COMMANDS = (
    "demo",
    "serve",
    "sim",
    "capture",
    "plan",
    "train",
    "render",
    "export",
    "doctor",
    "calibrate",
    "record",
    "replay",
    "library",
    "token",
    "bench",
)


def run(folder: Path, *arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run ``dronerf`` in ``folder`` with no settings but ``environment``."""
    inherited = {k: v for k, v in os.environ.items() if not k.startswith("DRONERF_")}
    return subprocess.run(
        [DRONERF, *arguments],
        cwd=folder,
        env=inherited | {"OMP_NUM_THREADS": "1"} | environment,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


def refused(folder: Path, *arguments: str, **environment: str) -> str:
    """Run ``dronerf``, demand a proper refusal and return its one line."""
    before = sorted(folder.rglob("*"))
    answer = run(folder, *arguments, **environment)
    assert answer.returncode == 2, answer.stderr
    assert answer.stdout == ""
    lines = answer.stderr.splitlines()
    assert len(lines) == 1, answer.stderr
    assert re.match(r"dronerf( bench)?: ", lines[0])
    assert sorted(folder.rglob("*")) == before, "something was left behind"
    return lines[0]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A place to stand in, beside the input."""
    folder = tmp_path / "here"
    folder.mkdir()
    return folder


@pytest.fixture
def taken_port() -> Iterator[int]:
    with socket.socket() as sock:
        sock.bind(("127.0.0.1", 0))
        sock.listen()
        yield sock.getsockname()[1]


# Help ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_explains_itself(folder: Path, command: str) -> None:
    answer = run(folder, command, "--help")
    assert answer.returncode == 0
    assert answer.stdout.startswith(f"usage: dronerf {command}")
    assert answer.stderr == ""


def test_the_help_lists_exactly_the_commands(folder: Path) -> None:
    text = run(folder, "--help").stdout
    assert tuple(re.findall(r"^    ([a-z]+)(?:  |$)", text, re.MULTILINE)) == COMMANDS


# Wrong usage --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ((), "COMMAND"),
        (("fly",), "fly"),
        (("demo", "--drones", "9"), "--drones"),
        (("demo", "--drones", "0"), "--drones"),
        (("demo", "--pictures", "0"), "--pictures"),
        (("demo", "--pictures", "many"), "many"),
        (("demo", "--pictures", "3", "--drones", "4"), "--pictures"),
        (("demo", "--seed", "-1"), "--seed"),
        (("demo", "--train-seconds", "nan"), "--train-seconds"),
        (("demo", "--mode", "best"), "best"),
        (("serve", "--port", "65536"), "--port"),
        (("serve", "--fleet", "a.toml", "--sim", "human"), "--sim"),
        (("serve", "--fleet", "a.toml", "--fault", "loss=0.1"), "--fault"),
        (("serve", "--port", "0", "--fault", "lose=0.1"), "no_valid_imu"),
        (("serve", "--port", "0", "--drones", "2", "--fault", "reboot:drone-3"), "drone-3"),
        (("sim", "--drones", "9"), "--drones"),
        (("sim", "--address", "10.0.0.1"), "10.0.0.1"),
        (("train",), "dataset"),
        (("train", ".", "--seconds", "1", "--steps", "1"), "--steps"),
        (("train", ".", "--test-every", "0"), "--test-every"),
        (("render", ".", "--size", "640"), "640"),
        (("export", ".", "--format", "stl"), "stl"),
        (("export", ".", "--cells", "4"), "--cells"),
    ],
)
def test_wrong_usage_is_said_in_one_line(
    folder: Path, arguments: tuple[str, ...], says: str
) -> None:
    assert says in refused(folder, *arguments)


# Scenes -------------------------------------------------------------------------------------------


def test_an_unknown_scene_names_the_known_ones(folder: Path) -> None:
    line = refused(folder, "demo", "--headless", "--scene", "teapot")
    assert "'teapot'" in line
    assert all(name in line for name in ("human", "guitar", "robot_dog", "recycle_bin"))


def test_a_bad_mesh_is_named(folder: Path) -> None:
    missing = folder.parent / "missing.glb"
    broken, empty = folder.parent / "broken.glb", folder.parent / "empty.obj"
    broken.write_bytes(np.random.default_rng(0).bytes(500))
    empty.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\n")
    assert "no such file" in refused(folder, "demo", "--headless", "--scene", str(missing))
    assert "cannot be read" in refused(folder, "demo", "--headless", "--scene", str(broken))
    assert "no triangles" in refused(folder, "serve", "--port", "0", "--sim", str(empty))
    assert "no such file" in refused(folder, "sim", "--scene", str(missing))
    assert "no such file" in refused(folder, "bench", "nerf", "--scene", str(missing))


# Datasets -----------------------------------------------------------------------------------------


def _pose(azimuth_rad: float) -> list[list[float]]:
    c, s = np.cos(azimuth_rad), np.sin(azimuth_rad)
    return [[-s, 0.0, c, 2 * c], [c, 0.0, s, 2 * s], [0.0, 1.0, 0.0, 0.5], [0.0, 0.0, 0.0, 1.0]]


def dataset(path: Path, pictures: int = 4, **changes: Any) -> Path:
    """Write a small sound dataset, then spoil its description by ``changes``."""
    (path / "images").mkdir(parents=True)
    frames = []
    for index in range(pictures):
        file = f"images/{index}.png"
        cv2.imwrite(str(path / file), np.full((24, 32, 3), 20 * index, np.uint8))
        pose = _pose(2 * np.pi * index / pictures)
        frames.append({"file_path": file, "transform_matrix": pose})
    description = {"w": 32, "h": 24, "fl_x": 30.0, "fl_y": 30.0, "frames": frames} | changes
    (path / "transforms.json").write_text(json.dumps(description))
    return path


def test_a_folder_that_is_no_dataset(folder: Path) -> None:
    nowhere = folder.parent / "nowhere"
    assert "transforms.json" in refused(folder, "train", str(nowhere))
    assert "transforms.json" in refused(folder, "train", ".")


def test_a_broken_description(folder: Path) -> None:
    path = dataset(folder.parent / "data")
    (path / "transforms.json").write_text('{"frames": [')
    assert "JSON" in refused(folder, "train", str(path))


def test_missing_pictures_are_counted(folder: Path) -> None:
    path = dataset(folder.parent / "data")
    (path / "images/1.png").unlink()
    (path / "images/3.png").unlink()
    assert "2 of 4 pictures are missing, first images/1.png" in refused(folder, "train", str(path))


def test_a_singular_pose(folder: Path) -> None:
    path = dataset(folder.parent / "data")
    description = json.loads((path / "transforms.json").read_text())
    description["frames"][2]["transform_matrix"] = np.zeros((4, 4)).tolist()
    (path / "transforms.json").write_text(json.dumps(description))
    assert "pose of 2.png is singular" in refused(folder, "train", str(path))


def test_an_unknown_camera_model(folder: Path) -> None:
    path = dataset(folder.parent / "data", camera_model="ORTHOGRAPHIC")
    assert "ORTHOGRAPHIC" in refused(folder, "train", str(path))


def test_nothing_left_to_train_on(folder: Path) -> None:
    path = dataset(folder.parent / "data")
    assert "training" in refused(folder, "train", str(path), "--test-every", "1", "--steps", "1")


def test_nothing_to_go_on_with(folder: Path) -> None:
    assert "no training to go on with" in refused(folder, "train", "--resume", ".")


def test_training_prints_one_object(folder: Path) -> None:
    path = dataset(folder.parent / "data", pictures=9)
    answer = run(
        folder, "train", str(path), "--steps", "3", "--test-every", "4", "--json", "--seed", "5",
        "--field-only",
    )  # fmt: skip
    assert answer.returncode == 0, answer.stderr
    result = json.loads(answer.stdout)
    keys = {"run", "dataset", "images", "images_held_out", "psnr_db", "ssim", "flip", "wall_s"}
    assert keys <= result.keys()
    assert (result["images"], result["images_held_out"]) == (9, 3)
    assert json.loads((Path(result["run"]) / "metrics.json").read_text())["images"] == 9
    assert (Path(result["run"]) / "checkpoint.npz").is_file()
    assert not (Path(result["run"]) / "orbit.mp4").exists()


# Console and fleet --------------------------------------------------------------------------------


def test_a_taken_port(folder: Path, taken_port: int) -> None:
    for command in ("serve", "demo"):
        line = refused(folder, command, "--port", str(taken_port))
        assert f"port {taken_port}" in line
        assert "--port" in line


def test_an_address_that_is_not_ours(folder: Path) -> None:
    assert "192.0.2.1" in refused(folder, "serve", "--host", "192.0.2.1", "--port", "0")


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("[[drones]]\nid = 'a'\nwheels = 4\n", "wheels"),
        ("colour = 'red'\n[[drones]]\n", "colour"),
        ("", "drones"),
        ("[[drones]\n", "TOML"),
        ("[[drones]]\nazimuth_deg = 'north'\n", "azimuth_deg"),
        ("[[drones]]\nid = 'a'\n[[drones]]\nid = 'a'\naddress = '10.0.0.2'\n", "unique"),
        ("[[drones]]\ninterface = 'nosuchwlan9'\n", "nosuchwlan9"),
    ],
)
def test_a_bad_fleet_file(folder: Path, text: str, says: str) -> None:
    file = folder.parent / "fleet.toml"
    file.write_text(text)
    assert says in refused(folder, "serve", "--port", "0", "--fleet", str(file))


def test_a_start_circle_outside_the_fence(folder: Path) -> None:
    file = folder.parent / "fleet.toml"
    file.write_text('start_radius_m = 4.2\n[[drones]]\naddress = "127.9.9.9"\n')
    line = refused(folder, "serve", "--port", "0", "--fleet", str(file))
    assert "start_radius_m is 4.2, must be at most 4" in line


def test_a_missing_fleet_file(folder: Path) -> None:
    assert "none.toml" in refused(folder, "serve", "--port", "0", "--fleet", "none.toml")


@pytest.mark.parametrize(
    ("environment", "says"),
    [
        ({"DRONERF_SAFETY__FENCE_RADIUS_M": "-1"}, "fence_radius_m"),
        ({"DRONERF_SAFETY__FENCE_RADIUS": "3"}, "DRONERF_SAFETY__FENCE_RADIUS"),
        ({"DRONERF_SAFETY": "tight"}, "safety"),
        ({"DRONERF_CONFIG": "none.toml"}, "none.toml"),
        ({"DRONERF_PORT": "http"}, "port"),
        ({"DRONERF_TOKEN": "short"}, "8"),
        ({"DRONERF_TOKEN": "with space in it"}, "token"),
        ({"DRONERF_TOKEN_FILE": "none.txt"}, "none.txt"),
        ({"DRONERF_HOST": "0.0.0.0"}, "DRONERF_TOKEN"),
        ({"DRONERF_HOST": "::"}, "DRONERF_TOKEN"),
        ({"DRONERF_PATH_PREFIX": "drones"}, "path_prefix"),
        ({"DRONERF_TLS_KEY": "key.pem"}, "tls_certificate"),
        ({"DRONERF_TLS_KEY": "key.pem", "DRONERF_TLS_CERTIFICATE": "none.pem"}, "none.pem"),
        ({"DRONERF_WEBHOOK__URL": "file:///etc/passwd"}, "url"),
        ({"DRONERF_RUNS": "/dev/null/runs"}, "/dev/null"),
        ({"DRONERF_SAFETY": '{"failsafes": {"batery_pct": {"land": 18}}}'}, "failsafes.batery_pct"),
        ({"DRONERF_SAFETY__FAILSAFES__BATTERY_PCT__LND": "18"}, "BATTERY_PCT__LND"),
    ],
)
def test_bad_settings(folder: Path, environment: dict[str, str], says: str) -> None:
    assert says in refused(folder, "serve", "--fleet", "none.toml", **environment)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("port = [", "TOML"),
        ("[safety]\nfence = 3\n", "safety.fence"),
        ("[planner.fitness]\nweight = 1\n", "planner.fitness.weight"),
        ("[mission]\narrive_m = 'near'\n", "arrive_m"),
        ("[safety.failsafes]\nbattery_pct = { lnd = 18 }\n", "safety.failsafes.battery_pct.lnd"),
        ("[safety.failsafes]\nbattery_pct = {}\n", "failsafes.battery_pct must land"),
        ("[safety]\nfence_radius_m = 0.4\n", "fence_radius_m"),
        ("[planner.tracking]\ntravel_speed_m_s = 0.9\n", "travel_speed_m_s is 0.9 m/s"),
    ],
)
def test_a_bad_settings_file(folder: Path, text: str, says: str) -> None:
    file = folder.parent / "console.toml"
    file.write_text(text)
    assert says in refused(folder, "serve", "--fleet", "none.toml", DRONERF_CONFIG=str(file))


def test_good_settings_are_taken(folder: Path) -> None:
    file = folder.parent / "console.toml"
    file.write_text(
        "[safety]\nfence_radius_m = 3.5\n[planner.tracking.roll]\np = 0.5\n"
        "[safety.failsafes]\nbattery_pct = { land = 18 }\nobject_age_s = {}\n"
    )
    line = refused(
        folder,
        "serve",
        "--fleet",
        "none.toml",
        DRONERF_CONFIG=str(file),
        DRONERF_PLANNER__FITNESS__VIEWS_WANTED="2",
    )
    assert "none.toml" in line, "the settings are fine, only the fleet is missing"


def test_elsewhere_than_loopback_a_token_is_enough(folder: Path) -> None:
    for token in ({"DRONERF_TOKEN": "long-enough"}, {"DRONERF_MAKE_TOKEN": "true"}):
        line = refused(folder, "serve", "--fleet", "none.toml", "--host", "0.0.0.0", **token)
        assert "none.toml" in line, "the token is fine, only the fleet is missing"


# Capture and plan ---------------------------------------------------------------------------------


def test_capture_needs_a_token_and_a_console(folder: Path) -> None:
    assert "DRONERF_TOKEN" in refused(folder, "capture")
    with socket.socket() as sock:  # Bound but not listening: nobody answers there.
        sock.bind(("127.0.0.1", 0))
        url = f"http://127.0.0.1:{sock.getsockname()[1]}"
        assert url in refused(folder, "capture", "--url", url, DRONERF_TOKEN="long-enough")
    assert "nonsense" in refused(
        folder, "capture", "--url", "nonsense", DRONERF_TOKEN="long-enough"
    )


def test_a_plan_for_a_box_needs_no_console(folder: Path) -> None:
    wanted = ["plan", "--size", "0.8x0.4x0.6", "--drones", "2", "--pictures", "4", "--enough", "90"]
    answer = run(folder, *wanted, "--json")
    assert answer.returncode == 0, answer.stderr
    plan = json.loads(answer.stdout)
    assert {view["drone_id"] for view in plan["viewpoints"]} == {"drone-1", "drone-2"}
    assert len(plan["viewpoints"]) == 4
    assert plan["fitness"] <= plan["bound"]
    assert plan["bound_kind"] == "linear program"
    assert plan["enough"]["needed"] <= plan["enough"]["sufficient"]
    assert sorted(folder.iterdir()) == []
    table = run(folder, *wanted).stdout
    assert "4 viewpoints" in table
    assert "90% of the boxes' surface" in table


def test_what_cannot_be_planned_for(folder: Path) -> None:
    assert "larger than the fence" in refused(folder, "plan", "--size", "9x9x9")
    assert "size" in refused(folder, "plan", "--size", "0.9x0.4")
    assert "unknown scene" in refused(folder, "plan", "--object", "nothing")
    assert "evenly" in refused(folder, "plan", "--size", "1x1x1", "--pictures", "7")
    assert "percentage" in refused(folder, "plan", "--size", "1x1x1", "--enough", "101")
    assert "DRONERF_TOKEN" in refused(folder, "plan")
