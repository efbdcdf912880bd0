"""What every bench is asked, and how its finished parts are kept."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

CORES = os.cpu_count() or 1


@dataclass(frozen=True, slots=True)
class Options:
    """What is to be measured.

    Attributes:
        scenes: Scenes' names or files.
        seed: Seed of everything random.
        quick: Whether to be done within 12 minutes.
        faults: For missions: whether something shall go wrong in them.
        only: For missions: fly those alone whose name holds this, empty for all.
        out: Folder for pictures and finished parts, None for none.
        resume: Whether to go on from the parts in ``out``.
        pictures: For the table: counts of pictures to draw a curve over, none for no curve.
        drones: For the table: counts of drones likewise.
        ablations: For table, fields and planner: whether to leave out each part in turn.
        threads: To compute with, unless more of them is what is measured.
    """

    scenes: tuple[str, ...]
    seed: int
    quick: bool
    faults: bool
    only: str
    out: Path | None
    resume: bool
    pictures: tuple[int, ...] = ()
    drones: tuple[int, ...] = ()
    ablations: bool = False
    threads: int = CORES


@dataclass(frozen=True, slots=True)
class Figures:
    """What was measured.

    Attributes:
        scenes: The figures of each scene.
        overall: Over all scenes.
    """

    scenes: dict[str, dict[str, Any]]
    overall: dict[str, Any]


def each_scene(
    name: str, options: Options, measure: Callable[[str], dict[str, Any]]
) -> dict[str, dict[str, Any]]:
    """Return ``measure(scene)`` of every scene; parts kept in ``out`` are not measured again."""
    return {
        scene: kept_part(
            f"{name}-{Path(scene).name}-{options.seed}", options, lambda s=scene: measure(s)
        )
        for scene in options.scenes
    }


def kept_part(name: str, options: Options, measure: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """Return ``measure()``, kept in ``out`` under this name, or what an earlier run has kept."""
    file = None
    if options.out is not None:
        options.out.mkdir(parents=True, exist_ok=True)
        file = options.out / f"{name}.json"
    if options.resume and file is not None and file.exists():
        return json.loads(file.read_text())
    print(name, file=sys.stderr, flush=True)
    part = measure()
    if file is not None:
        file.write_text(json.dumps(part, indent=1))
    return part
