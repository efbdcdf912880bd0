"""The main job, for real: simulated Tellos, whole missions, the command line's promises."""

import json
import subprocess
from pathlib import Path

import pytest
from programs import COMMAND

from server.nerf.dataset import load_dataset

pytestmark = [pytest.mark.loopback, pytest.mark.slow, pytest.mark.timeout(900)]


_ARGUMENTS = ["--scene", "recycle_bin", "--pictures=12", "--train-seconds=10", "--seed=1"]


@pytest.fixture(scope="module")
def result(tmp_path_factory) -> dict:
    runs = tmp_path_factory.mktemp("runs")
    done = subprocess.run(
        [*COMMAND, "demo", "--headless", "--json", *_ARGUMENTS, "--runs", str(runs)],
        capture_output=True,
        text=True,
        timeout=800,
    )
    assert done.returncode == 0, done.stderr[-3000:]
    return json.loads(done.stdout)


def test_the_result_is_one_object_with_all_figures(result):
    assert result["scene"] == "recycle_bin"
    assert result["mode"] == "optimized"
    assert result["images"] == 12
    assert result["images_held_out"] == 2
    for key in ("psnr_db", "ssim", "flip", "samples_per_s", "wall_s"):
        assert isinstance(result[key], float)
    for phase in ("take_off", "centre", "plan", "fly", "capture", "land", "refine", "train"):
        assert result["seconds"][phase] >= 0.0


def test_the_field_reproduces_what_it_has_not_seen(result):
    # A picture of the mean colour alone reaches about 13 dB here.
    assert result["psnr_db"] > 15.0


def test_the_run_folder_opens_as_a_dataset_and_says_it_is_complete(result):
    from_disk = load_dataset(_run(result))
    assert len(from_disk) == 12
    state = json.loads((_run(result) / "capture.json").read_text())
    assert state["complete"] is True
    assert state["status"]["state"] == "succeeded"
    for file in ("checkpoint.npz", "orbit.mp4"):
        assert (_run(result) / file).stat().st_size > 10_000
    # On a busy machine ten seconds may be too short for a surface; then the result says so.
    mesh = _run(result) / "mesh.glb"
    if result["missing"] is None:
        assert mesh.stat().st_size > 10_000
    else:
        assert "no surface" in result["missing"]
        assert not mesh.exists()


def _run(result) -> Path:
    return Path(result["run"])
