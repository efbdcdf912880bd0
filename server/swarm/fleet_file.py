"""Reads the fleet file: TOML whose keys are the field names of ``server.swarm.config``."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from dataclasses import fields
from itertools import combinations
from pathlib import Path
from typing import Any

from server.geometry.cameras import TELLO_INTRINSICS, Intrinsics
from server.swarm.config import (
    DRONE_COLOURS,
    MAX_DRONES,
    DroneConfig,
    FleetConfig,
    StationConfig,
)


class FleetFileError(ValueError):
    """A fleet file cannot be used; the text is one line naming the file and the key."""


_INTRINSICS_KEYS = ("width", "height", "fx", "fy", "cx", "cy", "distortion")


def load_fleet(path: Path) -> FleetConfig:
    """Read a fleet file.

    The file holds ``start_radius_m``, an optional ``[station]`` and one ``[[drones]]`` table per
    drone, with an optional ``[drones.intrinsics]``. Left-out azimuths are spread evenly; left-out
    ids count from 1.

    Raises:
        FleetFileError: If the file cannot be read or anything in it is unknown, of a wrong type
            or out of range.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "not UTF-8 text"
        raise FleetFileError(f"{path}: cannot be read: {reason}") from error
    try:
        document = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        reason = " ".join(str(error).split())
        raise FleetFileError(f"{path}: not valid TOML: {reason}") from error
    try:
        return _fleet_from(document)
    except ValueError as error:
        raise FleetFileError(f"{path}: {error}") from error


def _fleet_from(document: Mapping[str, object]) -> FleetConfig:
    known = ("start_radius_m", "station", "drones")
    for key in document:
        if key not in known:
            raise ValueError(f"unknown key {key!r} (known: {', '.join(known)})")
    tables = document.get("drones")
    if not isinstance(tables, list) or not tables:
        raise ValueError("drones: at least one [[drones]] table is needed")
    if len(tables) > MAX_DRONES:
        raise ValueError(f"drones: at most {MAX_DRONES} drones, not {len(tables)}")
    drones: list[DroneConfig] = []
    for index, table in enumerate(tables):
        where = f"drones[{index + 1}]"
        if not isinstance(table, dict):
            raise ValueError(f"{where} must be a table")
        drones.append(_drone_from(table, index, len(tables), where))
    radius = document.get("start_radius_m", 1.8)
    station = _station_from(document.get("station", {}))
    fleet = FleetConfig(tuple(drones), _number(radius, "start_radius_m"), station)
    for other, drone in combinations(fleet.drones, 2):
        _check_starts_apart(other, drone, fleet.start_radius_m)
    return fleet


# Drones set down nearer to each other than this meet on their way up.
_STARTS_APART_M = 0.6


def _check_starts_apart(other: DroneConfig, drone: DroneConfig, radius_m: float) -> None:
    """Raise ValueError when two drones would take off beneath each other's propellers."""
    half_turn = math.radians(drone.azimuth_deg - other.azimuth_deg) / 2.0
    apart_m = 2.0 * radius_m * abs(math.sin(half_turn))
    if apart_m < _STARTS_APART_M:
        raise ValueError(
            f"azimuth_deg: {other.id} and {drone.id} start {apart_m:.2f} m apart, must be at least"
            f" {_STARTS_APART_M:g} m (start_radius_m is {radius_m:g})"
        )


def _station_from(table: object) -> StationConfig:
    if not isinstance(table, dict):
        raise ValueError("station must be a table")
    defaults = StationConfig()
    known = [item.name for item in fields(StationConfig)]
    values: dict[str, Any] = {}
    for key, value in table.items():
        if key not in known:
            raise ValueError(f"station: unknown key {key!r} (known: {', '.join(known)})")
        values[key] = _typed(value, getattr(defaults, key), f"station.{key}")
    return StationConfig(**values)


def _drone_from(table: Mapping[str, object], index: int, count: int, where: str) -> DroneConfig:
    defaults = DroneConfig()
    known = [item.name for item in fields(DroneConfig)]
    values: dict[str, object] = {
        "id": f"drone-{index + 1}",
        "colour": DRONE_COLOURS[index],
        "azimuth_deg": 360.0 * index / count,
    }
    if (
        "serial" in table
        and not {"address", "interface"} & set(table)
        and table.get("link") != "ap"
    ):
        values["address"] = ""  # Known by its serial number alone.
    for key, value in table.items():
        label = f"{where}.{key}"
        if key not in known:
            raise ValueError(f"{where}: unknown key {key!r} (known: {', '.join(known)})")
        if key == "intrinsics":
            values[key] = _intrinsics_from(value, label)
        else:
            values[key] = _typed(value, getattr(defaults, key), label)
    try:
        return DroneConfig(**values)  # pyright: ignore[reportArgumentType]  # Typed just above.
    except ValueError as error:
        raise ValueError(f"{where}.{error}") from error


def _typed(value: object, example: object, label: str) -> object:
    if isinstance(example, float):
        return _number(value, label)
    # bool is a subclass of int, so the exact type is asked for.
    if type(value) is not type(example):
        raise ValueError(f"{label} must be of type {type(example).__name__}, not {value!r}")
    return value


def _number(value: object, label: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"{label} must be a number, not {value!r}")
    return float(value)


def _intrinsics_from(value: object, label: str) -> Intrinsics:
    if not isinstance(value, dict):
        raise ValueError(f"{label} must be a table")
    numbers: dict[str, Any] = {}
    for key, item in value.items():
        if key not in _INTRINSICS_KEYS:
            raise ValueError(f"{label}: unknown key {key!r} (known: {', '.join(_INTRINSICS_KEYS)})")
        if key == "distortion":
            if not isinstance(item, list) or len(item) != 5:
                raise ValueError(f"{label}.distortion must be five numbers k1, k2, p1, p2, k3")
            numbers[key] = tuple(_number(k, f"{label}.distortion") for k in item)
        elif key in ("width", "height"):
            numbers[key] = _typed(item, 1, f"{label}.{key}")
        else:
            numbers[key] = _number(item, f"{label}.{key}")
    merged = {key: numbers.get(key, getattr(TELLO_INTRINSICS, key)) for key in _INTRINSICS_KEYS}
    for key in ("width", "height", "fx", "fy", "cx", "cy"):
        if not math.isfinite(merged[key]):
            raise ValueError(f"{label}.{key} must be finite, not {merged[key]!r}")
    if not all(map(math.isfinite, merged["distortion"])):
        raise ValueError(f"{label}.distortion must be finite, not {merged['distortion']!r}")
    for key in ("width", "height", "fx", "fy"):
        if not merged[key] > 0:
            raise ValueError(f"{label}.{key} must be positive, not {merged[key]!r}")
    return Intrinsics(**merged)
