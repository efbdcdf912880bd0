"""Checks of the machine: software, disk, memory, clock, GPU, settings. Values in, findings out."""

from __future__ import annotations

import difflib
import os
import re
import shutil
import tempfile
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path

from server.doctor.config import DoctorConfig
from server.doctor.finding import Finding
from server.settings import Settings, SettingsError, load_settings

_GB = 1e9
_PYTHON = ((3, 11), (3, 13))
# Set and read outside the settings, see ``server.settings``.
_OTHER_VARIABLES = ("DRONERF_CONFIG", "DRONERF_FUZZ")


def check_python(version: tuple[int, int]) -> Finding:
    """Judge the version of Python as (major, minor)."""
    text = f"{version[0]}.{version[1]}"
    if not _PYTHON[0] <= version <= _PYTHON[1]:
        return Finding("Python", "fail", text, "Python 3.11, 3.12 or 3.13 is needed: make setup")
    return Finding("Python", "ok", text)


def check_packages(requirements: Iterable[str], installed: Callable[[str], str | None]) -> Finding:
    """Judge whether all packages are there.

    Args:
        requirements: As the package's metadata lists them, extras included.
        installed: Returns the version of a package, None when it is missing.
    """
    wanted = [text for text in requirements if "extra ==" not in text]
    names = [found[0] for text in wanted if (found := re.match(r"[A-Za-z0-9._-]+", text))]
    missing = [name for name in names if installed(name) is None]
    if not names:
        return Finding("packages", "warn", "dronerf is not installed as a package", "make setup")
    if missing:
        return Finding("packages", "fail", f"missing: {', '.join(missing)}", "make setup")
    return Finding("packages", "ok", f"all {len(names)} are installed")


def check_opencv(installed: Mapping[str, str], loaded: str) -> Finding:
    """Judge whether another OpenCV package has overwritten the headless one.

    Args:
        installed: Versions of the installed packages whose names begin with ``opencv``.
        loaded: The version that ``import cv2`` gives.
    """
    others = sorted(name for name in installed if name != "opencv-python-headless")
    again = "pip install --force-reinstall --no-deps opencv-python-headless"
    if others:
        return Finding(
            "OpenCV",
            "fail",
            f"{', '.join(others)} lies over opencv-python-headless in the same folder",
            f"pip uninstall {' '.join(others)}; {again}",
        )
    headless = installed.get("opencv-python-headless", "")
    if not headless.startswith(loaded):
        detail = f"{loaded} is loaded, {headless or 'nothing'} is installed"
        return Finding("OpenCV", "fail", detail, again)
    return Finding("OpenCV", "ok", f"{loaded}, headless")


def check_x11(load: Callable[[str], object]) -> Finding:
    """Judge whether the library that the simulator's renderer needs can be loaded."""
    try:
        load("libX11.so.6")
    except OSError as error:
        return Finding(
            "libX11",
            "warn",
            f"{error}; only the simulator needs it",
            "Debian, Ubuntu: apt install libx11-6; Fedora: dnf install libX11",
        )
    return Finding("libX11", "ok", "can be loaded")


def check_web(dist: Path) -> Finding:
    """Judge whether the dashboard is built."""
    if not (dist / "index.html").is_file():
        detail = "the dashboard is not built; REST and the 3D scene work without it"
        return Finding("dashboard", "warn", detail, "make web")
    return Finding("dashboard", "ok", "built")


def check_runs(folder: Path, config: DoctorConfig) -> Finding:
    """Judge the folder of the runs by writing into it, or into the nearest one that exists."""
    name = "runs folder"
    nearest = folder.absolute()
    while not nearest.exists() and nearest != nearest.parent:
        nearest = nearest.parent
    choose = "choose another with --runs or DRONERF_RUNS"
    if not nearest.is_dir():
        return Finding(name, "fail", f"{folder}: {nearest} is not a folder", choose)
    try:
        # A full disk, a quota and a read-only mount show only in the writing.
        with tempfile.NamedTemporaryFile(dir=nearest, prefix=".dronerf-doctor-") as probe:
            probe.write(b"\0" * (1 << 20))
            probe.flush()
            os.fsync(probe.fileno())
        free_gb = shutil.disk_usage(nearest).free / _GB
    except OSError as error:
        detail = f"{folder} cannot be written: {error.strerror or error}"
        return Finding(name, "fail", detail, f"free space, mend its rights, or {choose}")
    detail = f"{folder}, {free_gb:.1f} GB free"
    if free_gb < config.disk_fail_gb:
        return Finding(name, "fail", detail, f"free space, or {choose}")
    if free_gb < config.disk_warn_gb:
        return Finding(name, "warn", detail, "a capture with its recording takes up to 1 GB")
    return Finding(name, "ok", detail)


def check_memory(available_bytes: float, total_bytes: float, config: DoctorConfig) -> Finding:
    """Judge the memory."""
    available_gb, total_gb = available_bytes / _GB, total_bytes / _GB
    detail = f"{available_gb:.1f} of {total_gb:.1f} GB available"
    remedy = "end other programs; training needs about 1 GB, a four-drone console another one"
    if available_gb < config.memory_fail_gb:
        return Finding("memory", "fail", detail, remedy)
    if available_gb < config.memory_warn_gb:
        return Finding("memory", "warn", detail, remedy)
    return Finding("memory", "ok", detail)


def check_processors(count: int, load: float) -> Finding:
    """Judge the processors: how many, and the load over the last minute."""
    detail = f"{count}, load {load:.1f}"
    if count < 2:
        return Finding("processors", "warn", detail, "four drones' video needs two processors")
    if load > count:
        return Finding("processors", "warn", detail, "busy: end other programs before a flight")
    return Finding("processors", "ok", detail)


def check_clock(synchronised: bool | None, step_s: float, config: DoctorConfig) -> Finding:
    """Judge the wall clock.

    Args:
        synchronised: Whether it follows a time server; None when that cannot be read.
        step_s: How far it moved against the steady clock during the checks, seconds.
        config: The limit.
    """
    if abs(step_s) > config.clock_step_s:
        detail = f"the wall clock moved by {step_s:+.2f} s against the steady one meanwhile"
        return Finding("clock", "warn", detail, "let the time service settle before a capture")
    if synchronised is None:
        return Finding("clock", "ok", "steady; whether a time server sets it cannot be read")
    if not synchronised:
        detail = "steady, but not set by a time server"
        remedy = "dates of captures may be wrong: timedatectl set-ntp true"
        return Finding("clock", "warn", detail, remedy)
    return Finding("clock", "ok", "steady, set by a time server")


def check_gpu(driver: str | None, torch_says: str | None) -> Finding:
    """Judge the GPU; none is needed.

    Args:
        driver: What the driver's tool reports, None without it.
        torch_says: The device torch would use, empty for none, None when torch did not say.
    """
    if torch_says:
        return Finding("GPU", "ok", torch_says)
    if driver:
        detail = f"{driver}, which torch cannot use"
        return Finding("GPU", "warn", detail, "install torch with CUDA: make setup TORCH_INDEX=...")
    if torch_says is None:
        remedy = "training needs torch: make setup"
        return Finding("GPU", "warn", "torch does not start", remedy)
    return Finding("GPU", "ok", "none, training uses the processor's kernels")


def check_settings(environment: Mapping[str, str]) -> Finding:
    """Judge the settings as they stand in the environment and in the settings file."""
    try:
        load_settings()
    except SettingsError as error:
        return Finding("settings", "fail", str(error), "docs/operations.md lists the settings")
    known = {f"DRONERF_{name.upper()}" for name in Settings.model_fields} | {*_OTHER_VARIABLES}
    given = sorted(name for name in environment if name.startswith("DRONERF_"))
    strange = [name for name in given if name not in known and "__" not in name]
    if strange:
        like = difflib.get_close_matches(strange[0], known, 1)
        guess = f"is {like[0]} meant?" if like else "docs/operations.md lists the settings"
        return Finding("settings", "warn", f"{strange[0]} is no setting and is ignored", guess)
    return Finding("settings", "ok", f"{len(given)} DRONERF_ variables" if given else "defaults")
