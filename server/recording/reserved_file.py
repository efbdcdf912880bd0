"""A file that keeps room for its own end: when the disk is full, the end can still be written."""

from __future__ import annotations

import errno
import os
from pathlib import Path

_FULL = {errno.ENOSPC, errno.EDQUOT}


class ReservedFile:
    """A new file for writing, with a hidden one beside it that holds room on the disk.

    The first write that the disk refuses frees that room and is written there.

    Attributes:
        full: Whether that has happened: only the room set aside is left.
    """

    def __init__(self, path: Path, reserve_bytes: int) -> None:
        """Create both.

        Args:
            path: The file.
            reserve_bytes: Room to set aside.

        Raises:
            OSError: If there is no such room; neither file is left behind then.
            FileExistsError: If the file is there already.
        """
        self.full = False
        self._fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644)
        self._reserve = _beside(path)
        try:
            reserve = os.open(
                self._reserve, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC, 0o600
            )
            try:
                os.posix_fallocate(reserve, 0, reserve_bytes)
            finally:
                os.close(reserve)
        except BaseException:
            self.close()
            path.unlink()
            raise

    def fileno(self) -> int:
        """Return the file's descriptor."""
        return self._fd

    def tell(self) -> int:
        """Return where the next byte goes."""
        return os.lseek(self._fd, 0, os.SEEK_CUR)

    def write(self, data: bytes) -> int:
        """Write all of ``data``, into the room set aside if there is no other.

        Raises:
            OSError: If not even that is enough.
        """
        left = memoryview(data)
        count = len(left)
        while left:
            try:
                left = left[os.write(self._fd, left) :]
            except OSError as error:
                if self.full or error.errno not in _FULL:
                    raise
                self.full = True
                self._reserve.unlink(missing_ok=True)
        return count

    def flush(self) -> None:
        """Do nothing: every write has reached the operating system."""

    def close(self) -> None:
        """Close the file and free what is still set aside."""
        try:
            os.close(self._fd)
        finally:
            self._reserve.unlink(missing_ok=True)


def forget_reserve(path: Path) -> None:
    """Free the room that a killed writer of ``path`` had set aside."""
    _beside(path).unlink(missing_ok=True)


def _beside(path: Path) -> Path:
    return path.with_name(f".{path.name}.reserve")
