"""Sockets' room for datagrams that wait to be read, on machines that grant less than is asked."""

from __future__ import annotations

import errno
import logging
import socket

import pytest

from server.swarm import ports
from server.swarm.config import DroneConfig
from server.swarm.ports import VIDEO_BUFFER_BYTES, bound_socket, widen_buffer

# Below what any Linux grants, so that the kernel adds no limit of its own.
LIMIT_BYTES = 1 << 16
SO_RCVBUFFORCE = 33


class Narrow(socket.socket):
    """A socket of a machine with a small ``net.core.rmem_max``, for somebody without rights."""

    refuses_force: OSError | None = PermissionError(errno.EPERM, "Operation not permitted")

    def setsockopt(self, *arguments: object) -> None:
        _, option, value, *_ = arguments
        assert isinstance(value, int)
        if option == SO_RCVBUFFORCE:
            if self.refuses_force is not None:
                raise self.refuses_force
            super().setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, value)
        elif option == socket.SO_RCVBUF:
            super().setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, min(value, LIMIT_BYTES))


class NarrowForRoot(Narrow):
    """The same for a process with the capability CAP_NET_ADMIN."""

    refuses_force = None


class NarrowElsewhere(Narrow):
    """The same on a system that does not know how to force it."""

    refuses_force = OSError(errno.ENOPROTOOPT, "Protocol not available")


@pytest.mark.parametrize(
    ("kind", "wanted_bytes", "room_bytes"),
    [
        (Narrow, LIMIT_BYTES, LIMIT_BYTES),
        (Narrow, 2 * LIMIT_BYTES, LIMIT_BYTES),
        (NarrowElsewhere, 2 * LIMIT_BYTES, LIMIT_BYTES),
        (NarrowForRoot, 2 * LIMIT_BYTES, 2 * LIMIT_BYTES),
    ],
)
def test_the_room_is_what_the_kernel_grants(
    kind: type[Narrow], wanted_bytes: int, room_bytes: int
) -> None:
    with kind(socket.AF_INET, socket.SOCK_DGRAM) as opened:
        assert widen_buffer(opened, wanted_bytes) == room_bytes


@pytest.mark.loopback
def test_too_little_room_is_told_once_with_what_to_do(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr("server.swarm.ports.socket.socket", Narrow)
    ports._tell_of_small_buffer.cache_clear()
    with caplog.at_level(logging.WARNING, "server.swarm.ports"):
        for _ in range(3):
            bound_socket(DroneConfig(local_address="127.0.0.9"), 0, VIDEO_BUFFER_BYTES).close()
    ports._tell_of_small_buffer.cache_clear()
    assert [record.levelname for record in caplog.records] == ["WARNING"]
    assert "net.core.rmem_max=4194304" in caplog.messages[0]
    assert "\n" not in caplog.messages[0]


@pytest.mark.loopback
def test_enough_room_is_nothing_to_tell(caplog: pytest.LogCaptureFixture) -> None:
    ports._tell_of_small_buffer.cache_clear()
    with caplog.at_level(logging.WARNING, "server.swarm.ports"):
        bound_socket(DroneConfig(local_address="127.0.0.9"), 0, LIMIT_BYTES).close()
    assert caplog.records == []
