"""The scenes that measurements of the whole range of objects cover."""

from __future__ import annotations

import os
from pathlib import Path

from server.sim.scenes.catalogue import SCENES


def named_and_shared_scenes() -> tuple[str, ...]:
    """Return the named scenes, then the meshes of the test data, where there are any.

    Some of the meshes bear a scene's name and are other objects all the same.
    """
    folder = os.environ.get("DRONERF_TEST_DATA")
    meshes = sorted((Path(folder) / "meshes").glob("*.glb")) if folder else []
    return (*SCENES, *map(str, meshes))
