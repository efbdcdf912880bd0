"""Doing something inside a named network namespace (Linux, as root).

Only the calling thread moves, and it never comes back, so the work is done in a thread of its own.
Sockets opened there stay in the namespace whoever uses them afterwards.
"""

from __future__ import annotations

import ctypes
import os
import threading
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

T = TypeVar("T")

_FOLDER = Path("/var/run/netns")
_CLONE_NEWNET = 0x40000000


class NamespaceError(OSError):
    """A network namespace cannot be entered; the text is one line that says why."""


def in_namespace(name: str, work: Callable[[], T]) -> T:
    """Return what ``work`` returns when called inside the namespace ``name``.

    Raises:
        NamespaceError: If there is no such namespace or it may not be entered.
    """
    results: list[T] = []
    failures: list[BaseException] = []

    def run() -> None:
        try:
            _enter(name)
            results.append(work())
        except BaseException as error:  # noqa: BLE001  # Handed on to the caller's thread.
            failures.append(error)

    thread = threading.Thread(target=run, name=f"namespace {name}")
    thread.start()
    thread.join()
    if failures:
        raise failures[0]
    return results[0]


def _enter(name: str) -> None:
    try:
        descriptor = os.open(_FOLDER / name, os.O_RDONLY)
    except OSError as error:
        raise NamespaceError(
            f"there is no network namespace {name!r}; `ip netns add {name}` makes it"
        ) from error
    try:
        libc = ctypes.CDLL(None, use_errno=True)
        if libc.setns(descriptor, _CLONE_NEWNET) != 0:
            reason = os.strerror(ctypes.get_errno())
            raise NamespaceError(f"cannot enter network namespace {name!r}: {reason}")
    finally:
        os.close(descriptor)
