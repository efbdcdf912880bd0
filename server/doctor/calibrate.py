"""``dronerf calibrate``: a camera's intrinsics from a board, from pictures or the live stream."""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np

from server.doctor.board_sheet import SheetError, write_board
from server.doctor.calibration_report import (
    calibration_json,
    calibration_text,
    write_pictures,
)
from server.doctor.config import DoctorConfig, LiveConfig
from server.doctor.live_views import LiveViewsError, collect_views, find_drone
from server.store.fleet_edit import write_intrinsics
from server.swarm.config import DroneConfig, FleetConfig
from server.swarm.fleet_file import FleetFileError, load_fleet
from server.vision.calibration import Calibration, CalibrationRefusedError, calibrate
from server.vision.calibration_board import (
    Board,
    BoardError,
    BoardFinder,
    BoardView,
    parse_board,
)
from server.vision.calibration_views import (
    CalibrationConfig,
    Hint,
    Picked,
    ViewPicker,
    coverage_of,
)

_ENDINGS = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff")
_HINTS: Mapping[Hint, str] = {
    "show_board": "show the board",
    "hold_still": "hold still",
    "blurred": "hold still, blurred",
    "left": "show it at the left",
    "right": "show it at the right",
    "top": "show it at the top",
    "bottom": "show it at the bottom",
    "tilt_sideways": "tilt it left or right",
    "tilt_up_down": "tilt it up or down",
    "nearer": "nearer, into the corners",
    "another": "another place or tilt",
}


class CalibrateUsageError(ValueError):
    """What was asked for does not fit together; the text is one line that says why."""


@dataclass(frozen=True, slots=True)
class CalibrateOptions:
    """What is calibrated, from what, and where the result goes.

    Attributes:
        board: The board as ``server.vision.calibration_board.parse_board`` reads it.
        pictures: Folder of pictures; None for the live stream.
        drone_id: Whose camera it is; empty for the only drone of the fleet file.
        fleet: Fleet file that says how the drone is reached; None for a drone at the usual address.
        out: Fleet file the result is written into; None for none.
        out_dir: Folder for the picture of the coverage; None for none.
        board_image: The board is written here, and nothing else is done; None for none.
        as_json: Whether the result is printed as one JSON object.
        live: How views are collected.
        waits: Waits for replies.
    """

    board: str
    pictures: Path | None = None
    drone_id: str = ""
    fleet: Path | None = None
    out: Path | None = None
    out_dir: Path | None = None
    board_image: Path | None = None
    as_json: bool = False
    live: LiveConfig = field(default_factory=LiveConfig)
    waits: DoctorConfig = field(default_factory=DoctorConfig)


async def run_calibrate(options: CalibrateOptions, stop: asyncio.Event) -> int:
    """Calibrate, print and write; returns 0, 1 when it failed, 2 for what does not fit together.

    Args:
        options: What to do.
        stop: Ends a live collection; what was collected is used.
    """
    try:
        board = parse_board(options.board)
        if options.board_image is not None:
            sys.stderr.write(write_board(board, options.board_image) + "\n")
            return 0
        fleet = _fleet(options)
        drone = _drone(fleet, options)
        if options.pictures is not None:
            views = await asyncio.to_thread(views_of_pictures, options.pictures, board)
        else:
            views = await _live_views(drone, fleet, board, options, stop)
        calibration = await asyncio.to_thread(calibrate, views)
        if options.out_dir is not None:
            write_pictures(options.out_dir, calibration, views)
        written = None
        if options.out is not None:
            written = _write(options.out, drone, calibration, board)
    except (BoardError, CalibrateUsageError, FleetFileError, SheetError) as error:
        sys.stderr.write(f"dronerf: {error}\n")
        return 2
    except (CalibrationRefusedError, LiveViewsError, OSError) as error:
        sys.stderr.write(f"dronerf: {error}\n")
        return 1
    if options.as_json:
        text = calibration_json(calibration, board.name, written)
    else:
        text = calibration_text(calibration)
    sys.stdout.write(text + "\n")
    return 0


def _fleet(options: CalibrateOptions) -> FleetConfig:
    """Return the fleet of the drone meant: without a file, one drone at the usual address."""
    source = options.fleet or options.out
    if source is None:
        return FleetConfig((DroneConfig(id=options.drone_id or "drone-1"),))
    return load_fleet(source)


def _drone(fleet: FleetConfig, options: CalibrateOptions) -> DroneConfig:
    """Return the drone meant; it is only needed to fly the stream or to name a table."""
    source = options.fleet or options.out
    drones = {drone.id: drone for drone in fleet.drones}
    known = ", ".join(drones)
    if options.drone_id:
        if options.drone_id not in drones:
            raise CalibrateUsageError(f"{source} has no drone {options.drone_id!r}, it has {known}")
        return drones[options.drone_id]
    if len(drones) > 1 and options.out is not None:
        raise CalibrateUsageError(f"{source} has several drones, name one with --drone: {known}")
    return next(iter(drones.values()))


def _write(out: Path, drone: DroneConfig, calibration: Calibration, board: Board) -> str:
    remark = (
        f"Calibrated with {board.name}, {len(calibration.views)} views,"
        f" {calibration.mean_px:.2f} px."
    )
    backup = write_intrinsics(out, drone.id, calibration.intrinsics, remark)
    sys.stderr.write(f"{drone.id} written into {out}; as it was: {backup}\n")
    return str(out)


def views_of_pictures(folder: Path, board: Board) -> list[BoardView]:
    """Return the views of a board in the pictures of a folder, in order of their names.

    Raises:
        CalibrateUsageError: If there is no such folder or no picture in it.
        CalibrationRefusedError: If no picture shows the board.
    """
    if not folder.is_dir():
        raise CalibrateUsageError(f"{folder} is not a folder")
    files = sorted(path for path in folder.iterdir() if path.suffix.lower() in _ENDINGS)
    if not files:
        raise CalibrateUsageError(f"{folder} holds no pictures ({', '.join(_ENDINGS)})")
    finder = BoardFinder(board)
    views: list[BoardView] = []
    reason = ""
    for path in files:
        image = _read_picture(path)
        view = None if image is None else finder.find(image, path.name)
        if view is not None:
            views.append(view)
        elif image is None:
            sys.stderr.write(f"{path.name}: no readable picture\n")
        else:
            reason = finder.explain(image)
            sys.stderr.write(f"{path.name}: {reason}\n")
    sys.stderr.write(f"{board.name} found in {len(views)} of {len(files)} pictures\n")
    if not views:
        raise CalibrationRefusedError(
            "few_views", f"no picture shows the board {board.name}: {reason}"
        )
    return views


def _read_picture(path: Path) -> np.ndarray | None:
    """Return a picture as it is stored: a camera's pixels are not turned by its Exif tag."""
    data = np.frombuffer(path.read_bytes(), np.uint8)
    if not len(data):
        return None
    return cv2.imdecode(data, cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)


async def _live_views(
    drone: DroneConfig,
    fleet: FleetConfig,
    board: Board,
    options: CalibrateOptions,
    stop: asyncio.Event,
) -> Sequence[BoardView]:
    least = CalibrationConfig().views_least
    if options.live.views < least:
        raise CalibrateUsageError(f"--views must be at least {least}, not {options.live.views}")
    if not drone.address:
        sys.stderr.write(f"Looking for {drone.id} in {fleet.station.subnet}.\n")
    drone = await find_drone(drone, fleet)
    sys.stderr.write(
        f"Hold {drone.id} or the board by hand, propellers off is best. Show the board near and"
        " far, in all corners, tilted to all sides; pause in each place. Ctrl-C ends early.\n"
    )
    picker = ViewPicker()
    progress = _Progress(picker, options.live.views)
    try:
        return await collect_views(
            drone,
            BoardFinder(board),
            picker,
            options.live,
            options.waits,
            progress.show,
            stop,
        )
    finally:
        progress.close()


class _Progress:
    """One line on stderr about the views so far; plain lines where it is no terminal."""

    def __init__(self, picker: ViewPicker, wanted: int) -> None:
        self._picker = picker
        self._wanted = wanted
        self._live = sys.stderr.isatty()

    def show(self, picked: Picked) -> None:
        if not self._live and picked.view is None:
            return
        views = self._picker.views
        share = float((coverage_of(views) > 0).mean())
        text = f"views {len(views)} of {self._wanted}, coverage {share:.0%}: {_HINTS[picked.hint]}"
        sys.stderr.write(f"\r\x1b[K{text}" if self._live else f"{text}\n")
        sys.stderr.flush()

    def close(self) -> None:
        if self._live:
            sys.stderr.write("\n")
