"""Files that are complete or not there, whatever ends the program or fills the disk.

They are written beside their place, as drafts, which then take it. A draft's name is hidden, so
that lists of a run's files never show what is still being written, and ends in ``.part``.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import BinaryIO

_ENDING = ".part"


def draft_name(name: str, writer: str = "") -> str:
    """Return what the draft of a file or folder ``name`` is called.

    Where several may write the same file at once, each gives another ``writer``.
    """
    return f".{name}.{writer}{_ENDING}" if writer else f".{name}{_ENDING}"


def is_draft(name: str) -> bool:
    """Return whether ``name`` is that of a draft."""
    return name.endswith(_ENDING)


def draft_of(path: Path, writer: str = "") -> Path:
    """Return where the draft of ``path`` is, see ``draft_name``."""
    return path.with_name(draft_name(path.name, writer))


@contextmanager
def drafted(path: Path) -> Iterator[Path]:
    """Give the place of a draft of ``path``, which takes its place in the end.

    Whatever is raised meanwhile, the old file stays and no draft is left behind.

    Raises:
        OSError: If the draft cannot take its place.
    """
    draft = draft_of(path)
    try:
        yield draft
        draft.replace(path)
    except BaseException:
        draft.unlink(missing_ok=True)
        raise


@contextmanager
def whole_file(path: Path) -> Iterator[BinaryIO]:
    """Open a draft of ``path``, which takes its place once it is on disk; see ``drafted``.

    Raises:
        OSError: If it cannot be written.
    """
    with drafted(path) as draft, draft.open("wb") as stream:
        yield stream
        stream.flush()
        os.fsync(stream.fileno())
