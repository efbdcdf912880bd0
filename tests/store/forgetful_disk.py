"""A disk that loses, when the power goes, what nobody asked it to keep.

It stands in for the module ``os`` below ``server.store.atomic``. Data and names become lasting only
by ``fsync`` of the file and of the folder. What was not synced may be there after the power cut, in
part or not at all: ``after_power_cut`` yields every such outcome.
"""

import os
from collections.abc import Callable, Iterator


class PowerCutError(BaseException):
    """The power went; nothing that runs can catch this and go on."""


class ForgetfulDisk:
    """One folder on a disk.

    Args:
        cut_after: Operations that still work; the next one never happens.
        most_bytes: The most that one write takes.
        capacity: Bytes that fit on the disk, None for any number.
    """

    O_WRONLY, O_CREAT, O_TRUNC = os.O_WRONLY, os.O_CREAT, os.O_TRUNC
    O_RDONLY, O_CLOEXEC = os.O_RDONLY, os.O_CLOEXEC
    getpid = staticmethod(os.getpid)

    def __init__(
        self, cut_after: int | None = None, most_bytes: int = 4, capacity: int | None = None
    ) -> None:
        self.operations = 0
        self._cut_after = cut_after
        self._most_bytes = most_bytes
        self._capacity = capacity
        self._data: list[bytes] = []  # By inode, as programs see it.
        self._synced: list[bytes] = []  # By inode, as it surely lasts.
        self._names: dict[str, int] = {}
        self._synced_names: dict[str, int] = {}
        self._pending: list[Callable[[dict[str, int]], object]] = []  # Changes of names, in order.
        self._open: dict[int, int | None] = {}  # Inode by descriptor, None for the folder.

    def open(self, path: str, flags: int, mode: int = 0o777) -> int:
        self._operate()
        descriptor = self.operations
        if not flags & self.O_CREAT:
            self._open[descriptor] = None
            return descriptor
        if path not in self._names:
            inode = len(self._data)
            self._data.append(b"")
            self._synced.append(b"")
            self._rename(lambda names: names.__setitem__(path, inode))
        if flags & self.O_TRUNC:
            self._data[self._names[path]] = b""
        self._open[descriptor] = self._names[path]
        return descriptor

    def write(self, descriptor: int, data: memoryview) -> int:
        self._operate()
        inode = self._open[descriptor]
        assert inode is not None
        taken = bytes(data[: self._most_bytes])
        used = sum(len(content) for content in self._data)
        if self._capacity is not None and used + len(taken) > self._capacity:
            raise OSError(28, "No space left on device")
        self._data[inode] += taken
        return len(taken)

    def fsync(self, descriptor: int) -> None:
        self._operate()
        inode = self._open[descriptor]
        if inode is None:
            self._synced_names, self._pending = dict(self._names), []
        else:
            self._synced[inode] = self._data[inode]

    def close(self, descriptor: int) -> None:
        self._operate()
        del self._open[descriptor]

    def replace(self, old: str, new: str) -> None:
        self._operate()
        self._rename(lambda names: names.__setitem__(new, names.pop(old)))

    def unlink(self, path: str) -> None:
        self._operate()
        if path not in self._names:
            raise FileNotFoundError(2, "No such file", path)
        self._rename(lambda names: names.pop(path))

    def read(self, path: str) -> bytes | None:
        """Return what a program reads now."""
        return self._data[self._names[path]] if path in self._names else None

    def leaks(self) -> bool:
        """Return whether a descriptor is still open."""
        return bool(self._open)

    def after_power_cut(self) -> Iterator[dict[str, bytes]]:
        """Yield every state that the disk may be found in, content by path."""
        for share in (0.0, 0.5, 1.0):
            content = [
                lasting if lasting == seen else seen[: int(share * len(seen))]
                for lasting, seen in zip(self._synced, self._data, strict=True)
            ]
            for kept in range(len(self._pending) + 1):
                names = dict(self._synced_names)
                for change in self._pending[:kept]:
                    change(names)
                yield {path: content[inode] for path, inode in names.items()}

    def _rename(self, change: Callable[[dict[str, int]], object]) -> None:
        change(self._names)
        self._pending.append(change)

    def _operate(self) -> None:
        if self._cut_after is not None and self.operations >= self._cut_after:
            raise PowerCutError
        self.operations += 1
