"""The scenes by name."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from server.sim.meshes import ObjectModel, SceneError
from server.sim.scenes.guitar import build_guitar
from server.sim.scenes.human import build_human
from server.sim.scenes.loading import SUFFIXES, load_mesh
from server.sim.scenes.recycle_bin import build_recycle_bin
from server.sim.scenes.robot_dog import build_robot_dog

SCENES: dict[str, Callable[[], ObjectModel]] = {
    "human": build_human,
    "guitar": build_guitar,
    "robot_dog": build_robot_dog,
    "recycle_bin": build_recycle_bin,
}


def load_object(name_or_path: str) -> ObjectModel:
    """Return the object of a scene, by its name or from a ``.glb`` or ``.obj`` file.

    Raises:
        SceneError: With one line that says what is wrong with the name or the file.
    """
    if name_or_path in SCENES:
        return SCENES[name_or_path]()
    path = Path(name_or_path).expanduser()
    if not path.suffix and not path.exists():
        known = ", ".join(SCENES)
        raise SceneError(
            f"unknown scene {name_or_path!r}: use {known}, or a {' or '.join(SUFFIXES)} file"
        )
    return load_mesh(path)
