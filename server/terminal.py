"""What a person at the terminal sees: the mission's course, a training bar, the table of results.

Everything but the table goes to stderr. Also what a person types: numbers of the command line are
read here, and what is wrong with them is said in one line.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import sys
from collections.abc import Callable
from typing import Any, NoReturn

from server.mission.events import (
    EventStream,
    Noted,
    TrainingProgressed,
)

# Adds a subcommand to a parser's: its place, its name, what it runs, what it is for.
AddCommand = Callable[[Any, str, Any, str], argparse.ArgumentParser]

SCENES = "human, guitar, robot_dog, recycle_bin, or a path to a .glb or .obj file"
_BAR = 24


class TrainingBar:
    """One line on stderr that a training keeps rewriting; plain lines where it is no terminal."""

    def __init__(self) -> None:
        self._live = sys.stderr.isatty()
        self._open = False
        self._shown_s = -10.0
        self._stage = ""

    def show(self, event: dict[str, Any]) -> None:
        """Show one ``progressed`` event of the worker; others are ignored."""
        if event.get("event") != "progressed":
            return
        stage, seconds, total = event["stage"], event["seconds"], event["seconds_total"]
        if not self._live and stage == self._stage and seconds - self._shown_s < 10.0:
            return
        self._shown_s, self._stage = seconds, stage
        text = f"{stage:<9}"
        if total:
            share = min(1.0, seconds / total)
            filled = "#" * round(share * _BAR)
            text += f"[{filled:.<{_BAR}}] {max(0.0, total - seconds):4.0f} s left"
        if event["psnr_db"] is not None:
            text += f"  {event['psnr_db']:5.2f} dB on training rays"
        if event["samples_per_s"]:
            text += f"  {event['samples_per_s'] / 1e6:.2f} M samples/s"
        end = "" if self._live else "\n"
        print(("\r\x1b[K" if self._live else "") + text, end=end, file=sys.stderr, flush=True)
        self._open = self._live

    def close(self) -> None:
        """End the line."""
        if self._open:
            print(file=sys.stderr)
        self._open = False


class CaptureFollower:
    """Prints a capture's course to stderr, a line per news."""

    def __init__(self, events: EventStream) -> None:
        self._events = events
        self._bar = TrainingBar()
        self._task: asyncio.Task[None] | None = None

    def start(self) -> CaptureFollower:
        """Begin to follow; returns itself."""
        self._task = asyncio.create_task(self._follow(), name="terminal")
        return self

    def stop(self) -> None:
        """Stop following."""
        self._bar.close()
        if self._task is not None:
            self._task.cancel()

    async def _follow(self) -> None:
        with self._events.subscribe(1024) as subscription:
            async for event in subscription:
                with contextlib.suppress(BrokenPipeError):
                    self._tell(event)

    def _tell(self, event: object) -> None:
        match event:
            case TrainingProgressed():
                self._bar.show(
                    {
                        "event": "progressed",
                        "stage": event.stage,
                        "seconds": event.seconds,
                        "seconds_total": event.seconds_total,
                        "psnr_db": event.psnr_db,
                        "samples_per_s": event.samples_per_s,
                    }
                )
            case Noted():
                who = f"{event.drone_id}: " if event.drone_id else ""
                level = "" if event.level == "info" else f"{event.level}: "
                self._bar.close()
                print(f"{level}{who}{event.text}", file=sys.stderr, flush=True)


_ROWS = (
    ("PSNR, held-out pictures", "psnr_db", "{:.2f} dB"),
    ("PSNR, object alone", "psnr_db_object", "{:.2f} dB"),
    ("SSIM", "ssim", "{:.3f}"),
    ("FLIP (smaller is better)", "flip", "{:.3f}"),
    ("pictures", "images", "{}"),
    ("of them held out", "images_held_out", "{}"),
    ("training samples per second", "samples_per_s", "{:,.0f}"),
    ("wall time", "wall_s", "{:.0f} s"),
)


def metrics_table(result: dict[str, Any]) -> str:
    """Return the result of a mission or a training as a table for people."""
    lines = [f"{result.get('scene') or result.get('dataset')}, {result.get('mode') or 'training'}"]
    for label, key, form in _ROWS:
        value = result.get(key)
        if value is not None:
            lines.append(f"  {label:<30}{form.format(value)}")
    for phase, seconds in (result.get("seconds") or {}).items():
        lines.append(f"    {phase:<28}{seconds:.1f} s")
    lines.append(f"  {'run':<30}{result['run']}")
    return "\n".join(lines)


class OneLineParser(argparse.ArgumentParser):
    """A parser that says in one line what is wrong; the usage is one ``--help`` away."""

    def error(self, message: str) -> NoReturn:
        """Print one line and end with exit code 2."""
        self.exit(2, f"dronerf: {message} (see {self.prog} --help)\n")


def _whole(text: str, least: int, most: int, rule: str) -> int:
    if not text.isascii() or not text.isdecimal() or not least <= int(text) <= most:
        raise argparse.ArgumentTypeError(f"must be {rule}, not {text}")
    return int(text)


def count(text: str) -> int:
    """Read a number of things; like all below it raises ``argparse.ArgumentTypeError``."""
    return _whole(text, 1, 10**9, "a whole number, at least 1")


def fleet_size(text: str) -> int:
    """Read a number of drones."""
    return _whole(text, 1, 8, "1 to 8")


def seed(text: str) -> int:
    """Read a seed."""
    return _whole(text, 0, 2**32 - 1, "a whole number from 0 to 4294967295")


def port(text: str) -> int:
    """Read a TCP port."""
    return _whole(text, 0, 65535, "a port from 0 (any free one) to 65535")


def seconds(text: str) -> float:
    """Read a positive duration, seconds."""
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0.0 < value < 1e6:
        raise argparse.ArgumentTypeError(f"must be a positive number of seconds, not {text}")
    return value
