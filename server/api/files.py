"""Finding files in a folder without ever leaving it.

Everything here blocks: call it in a thread.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path, PurePosixPath


@dataclass(frozen=True, slots=True)
class FoundFile:
    """A file below a folder.

    Attributes:
        path: Relative to the folder, with forward slashes.
        size_bytes: Its size.
        modified_at: Aware UTC.
    """

    path: str
    size_bytes: int
    modified_at: datetime


def inside(folder: Path, relative: str) -> Path | None:
    """Return the file ``relative`` names below ``folder``, or None when there is no such file.

    Absolute paths, ``..``, hidden names and links that lead out of the folder name no file.
    """
    parts = PurePosixPath(relative).parts
    if not parts or "\0" in relative or "\\" in relative or ":" in relative:
        return None
    if relative.startswith("/") or any(part.startswith(".") for part in parts):
        return None
    root = folder.resolve()
    try:
        path = root.joinpath(*parts).resolve(strict=True)
    except (OSError, RuntimeError):
        return None
    return path if path.is_relative_to(root) and path.is_file() else None


def files_below(folder: Path, limit: int, after: str = "") -> list[FoundFile]:
    """Return up to ``limit`` visible regular files below ``folder``, sorted by path.

    Those whose path does not come later than ``after`` are left out.
    """
    found: list[FoundFile] = []
    told = ((path.relative_to(folder), path) for path in folder.rglob("*"))
    for relative, path in sorted(told, key=lambda each: each[0].as_posix()):
        if path.is_symlink() or any(part.startswith(".") for part in relative.parts):
            continue
        if relative.as_posix() <= after:
            continue
        try:
            status = path.stat()
        except OSError:
            continue  # It was moved away meanwhile: writers replace files by renaming.
        if not path.is_file():
            continue
        modified_at = datetime.fromtimestamp(status.st_mtime, UTC)
        found.append(FoundFile(relative.as_posix(), status.st_size, modified_at))
        if len(found) >= limit:
            break
    return found
