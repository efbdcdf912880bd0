"""Writes a calibration into a fleet file and leaves everything else in it as it is."""

from __future__ import annotations

import contextlib
import os
import shutil
from pathlib import Path
from typing import Any, TypeVar

import tomlkit
from tomlkit.exceptions import TOMLKitError
from tomlkit.items import InlineTable, Item, Key, Table, Whitespace

from server.geometry.cameras import Intrinsics
from server.store.atomic import write_atomic
from server.swarm.fleet_file import FleetFileError, load_fleet

_AnyTable = TypeVar("_AnyTable", Table, InlineTable)

# An earlier calibration's remark begins so.
_EARLIER = "# Calibrated with"


def write_intrinsics(path: Path, drone_id: str, intrinsics: Intrinsics, remark: str) -> Path:
    """Write the ``[drones.intrinsics]`` of one drone; comments and order of the file stay.

    Comments beside the numbers that are replaced go with them, and an earlier calibration's remark.

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
    drone: Any = document["drones"][ids.index(drone_id)]  # pyright: ignore[reportIndexIssue, reportArgumentType]
    if isinstance(drone, Table) and not isinstance(drone.get("intrinsics"), InlineTable):
        _put_table(drone, intrinsics, remark)
    else:
        drone["intrinsics"] = _fill(tomlkit.inline_table(), intrinsics)
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
    table = tomlkit.table().add(tomlkit.comment(remark))
    return tomlkit.dumps(document) + heading + _fill(table, intrinsics).as_string()


def _put_table(drone: Table, intrinsics: Intrinsics, remark: str) -> None:
    """Write the table of one drone's intrinsics, without the lines that lead up to what follows."""
    tail = _cut_tail(drone)
    table = tomlkit.table().add(tomlkit.comment(remark))
    before = drone.get("intrinsics")
    for key, item in before.value.body if isinstance(before, Table) else ():
        if key is not None:
            table.append(key.key, item.unwrap())  # A comment beside an old number goes with it.
        elif not item.as_string().strip().startswith(_EARLIER):
            table.append(None, item)
    drone["intrinsics"] = _fill(table, intrinsics)
    _last_body(drone).extend(tail)


def _cut_tail(drone: Table) -> list[tuple[Key | None, Item]]:
    """Take the lines off a drone's end that belong to what follows in the file, and return them.

    tomlkit counts all comments in front of a heading to the table before. What comes directly
    below the last key stays there, if an empty line parts it from the rest.
    """
    body = _last_body(drone)
    start = len(body)
    while start > 0 and body[start - 1][0] is None:
        start -= 1
    spaces = (k for k in range(start, len(body)) if isinstance(body[k][1], Whitespace))
    start = next(spaces, start)
    tail = body[start:]
    del body[start:]
    return tail


def _last_body(table: Table) -> list[tuple[Key | None, Item]]:
    """Return what stands in the last of the tables within ``table``, or in itself."""
    body = table.value.body
    last = body[-1][1] if body else None
    return _last_body(last) if isinstance(last, Table) else body


def _fill(table: _AnyTable, intrinsics: Intrinsics) -> _AnyTable:
    table["width"], table["height"] = intrinsics.width, intrinsics.height
    for key in ("fx", "fy", "cx", "cy"):
        table[key] = round(getattr(intrinsics, key), 4)
    table["distortion"] = [round(float(term), 7) for term in intrinsics.distortion]
    return table


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
