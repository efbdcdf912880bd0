"""A run folder on its way to another machine and back, over a store that both reach by fsspec."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

from fsspec.core import url_to_fs

from server.drafts import draft_name, drafted, is_draft

# What no reconstruction reads; a recording alone may have gigabytes, and hidden files are not ours
# to send.
_STAYS = frozenset({"jobs", "recording.mcap", "log.jsonl"})


class Staging:
    """A place in the store where the files of one job go one way.

    Args:
        url: The fsspec URL of that place.

    Raises:
        ValueError: If the URL's kind is unknown, or what it needs is not installed.
    """

    def __init__(self, url: str) -> None:
        try:
            self._fs, self._root = url_to_fs(url)
        except ImportError as error:
            raise ValueError(f"{url.split(':')[0]}: {error}") from error
        self._sent: dict[str, tuple[int, int]] = {}

    def skip(self, folder: Path) -> None:
        """Take what is in ``folder`` now for sent."""
        self._sent = _marks(folder)

    def push(self, folder: Path, under: str = "") -> None:
        """Send what is new or changed in ``folder`` since the last time.

        Args:
            folder: The folder.
            under: The folder's name in the store; empty for the place itself.

        Raises:
            OSError: If it cannot be sent; the rest of it is sent with the next push.
        """
        for name, mark in _marks(folder).items():
            if self._sent.get(name) != mark:
                self.push_file(folder / name, f"{under}/{name}" if under else name)
                self._sent[name] = mark

    def push_file(self, file: Path, name: str) -> None:
        """Send one file as ``name``; raises OSError if it cannot be sent."""
        folder, _, base = f"{self._root}/{name}".rpartition("/")
        self._fs.makedirs(folder, exist_ok=True)
        # A name in the store stands for a whole file, whenever somebody looks.
        draft = f"{folder}/{draft_name(base)}"
        self._fs.put_file(str(file), draft)
        self._fs.mv(draft, f"{folder}/{base}")

    def pull(self, folder: Path, only: str | None = None) -> None:
        """Fetch all, or the file ``only``, into ``folder``; raises OSError if that fails."""
        for path in self._fs.find(self._root) if only is None else [f"{self._root}/{only}"]:
            name = path[len(self._root) :].lstrip("/")
            if is_draft(name):
                continue
            target = folder / name
            if not target.resolve().is_relative_to(folder.resolve()):
                raise OSError(f"{name} in the store would leave the folder")
            target.parent.mkdir(parents=True, exist_ok=True)
            with drafted(target) as draft:
                self._fs.get_file(path, str(draft))

    def clear(self) -> None:
        """Delete the place; raises OSError if that fails."""
        if self._fs.exists(self._root):
            self._fs.rm(self._root, recursive=True)


def _marks(folder: Path) -> dict[str, tuple[int, int]]:
    """Return size and time of change of every file that travels, by its name in the folder."""
    marks: dict[str, tuple[int, int]] = {}
    for inside, folders, names in os.walk(folder):
        folders[:] = [name for name in folders if not is_draft(name)]
        if Path(inside) == folder:
            folders[:] = [name for name in folders if name not in _STAYS]
            names = [name for name in names if name not in _STAYS]
        for name in names:
            if is_draft(name) or name.startswith("."):
                continue
            path = Path(inside) / name
            with contextlib.suppress(FileNotFoundError):  # It was renamed meanwhile.
                found = path.stat()
                marks[path.relative_to(folder).as_posix()] = (found.st_size, found.st_mtime_ns)
    return marks
