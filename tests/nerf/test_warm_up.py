"""Training's compiled code is there before the first pictures, and all of it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.nerf.tiny_scene import write_tiny_scene

_LIVE = """
import sys
from pathlib import Path
from server.nerf.config import FieldConfig, TrainConfig
from server.nerf.dataset import load_dataset
from server.nerf.preview import render_preview
from server.nerf.training import Trainer
dataset = load_dataset(Path(sys.argv[1]))
trainer = Trainer(dataset, FieldConfig(), TrainConfig(), held_out=[], threads=1)
trainer.run(steps=40)
render_preview(trainer, 0.3)
"""


def kernels_after(cache: Path, program: str, *arguments: str) -> set[str]:
    """Run a program and return the names of all compiled kernels' files."""
    subprocess.run(
        [sys.executable, "-P", "-c", program, *arguments],
        env=os.environ | {"NUMBA_CACHE_DIR": str(cache)},
        check=True,
    )
    return {file.name for file in cache.rglob("*.nb?")}


@pytest.mark.slow
def test_a_live_training_finds_all_it_needs_compiled(tmp_path: Path) -> None:
    scene = write_tiny_scene(tmp_path / "scene", 4)
    warm = "from server.nerf.warm_up import warm_up; warm_up(threads=1)"
    ready = kernels_after(tmp_path / "kernels", warm)
    assert ready
    assert kernels_after(tmp_path / "kernels", _LIVE, str(scene)) == ready
