"""Writes a calibration into a fleet file and leaves everything else in it as it is."""

from __future__ import annotations

import contextlib
import os
import shutil
from pathlib import Path

import tomlkit
from tomlkit.exceptions import TOMLKitError
from tomlkit.items import AoT, Table

from server.geometry.cameras import Intrinsics
from server.store.atomic import write_atomic
from server.swarm.fleet_file import FleetFileError, load_fleet


def write_intrinsics(path: Path, drone_id: str, intrinsics: Intrinsics, remark: str) -> Path:
    """Write the ``[drones.intrinsics]`` of one drone; comments and order of the file stay.

    Args:
        path: The fleet file; it must be valid before and is checked to be valid afterwards.
        drone_id: Whose camera it is.
        intrinsics: The camera.
        remark: One line that becomes a comment in front of the numbers.

    Returns:
        The copy of the file as it was before.

    Raises:
        FleetFileError: If the file is no fleet file, lacks the drone or cannot be written.
    """
    ids = [drone.id for drone in load_fleet(path).drones]
    if drone_id not in ids:
        raise FleetFileError(f"{path}: there is no drone {drone_id!r} (there are {', '.join(ids)})")
    text = path.read_text(encoding="utf-8")
    try:
        document = tomlkit.parse(text)
    except TOMLKitError as error:
        raise FleetFileError(f"{path}: not valid TOML: {error}") from error
    tables = document["drones"]
    table = tables[ids.index(drone_id)]  # pyright: ignore[reportIndexIssue, reportArgumentType]
    table["intrinsics"] = _table(intrinsics, remark, inline=not isinstance(tables, AoT))  # pyright: ignore[reportIndexIssue]
    changed = tomlkit.dumps(document)
    try:
        return _replace(path, changed, drone_id, intrinsics)
    except OSError as error:
        raise FleetFileError(f"{path}: cannot be written: {error.strerror or error}") from error


def intrinsics_toml(drone_id: str, intrinsics: Intrinsics, remark: str) -> str:
    """Return the ``[drones.intrinsics]`` of one drone as a piece of a fleet file."""
    document = tomlkit.document()
    document.add(tomlkit.comment(f"Goes behind the lines of {drone_id} in its [[drones]] table."))
    heading = "[drones.intrinsics]\n"
    return tomlkit.dumps(document) + heading + _table(intrinsics, remark, inline=False).as_string()


def _table(intrinsics: Intrinsics, remark: str, inline: bool) -> Table:
    table = tomlkit.inline_table() if inline else tomlkit.table()
    if not inline:
        table.add(tomlkit.comment(remark))  # pyright: ignore[reportArgumentType]
    table["width"], table["height"] = intrinsics.width, intrinsics.height
    for key in ("fx", "fy", "cx", "cy"):
        table[key] = round(getattr(intrinsics, key), 4)
    table["distortion"] = [round(float(term), 7) for term in intrinsics.distortion]
    return table  # pyright: ignore[reportReturnType]  # An inline table serves as well.


def _replace(path: Path, text: str, drone_id: str, intrinsics: Intrinsics) -> Path:
    """Put ``text`` in place of the file, once a copy of it reads back as it should."""
    trial = path.with_name(f".{path.name}.{os.getpid()}.trial.toml")
    try:
        trial.write_text(text, encoding="utf-8")
        read = next(drone for drone in load_fleet(trial).drones if drone.id == drone_id)
    finally:
        with contextlib.suppress(FileNotFoundError):
            trial.unlink()
    if abs(read.intrinsics.fx - intrinsics.fx) > 1e-3:
        raise FleetFileError(f"{path}: left as it was, the change would not have read back")
    backup = _free_name(path)
    shutil.copy2(path, backup)
    write_atomic(path, text.encode())
    return backup


def _free_name(path: Path) -> Path:
    """Return a name for a copy beside ``path`` that overwrites no earlier one."""
    backup = path.with_name(path.name + ".bak")
    number = 1
    while backup.exists():
        number += 1
        backup = path.with_name(f"{path.name}.bak{number}")
    return backup
