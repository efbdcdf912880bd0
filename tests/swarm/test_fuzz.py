"""Rubbish on every input of the driver: nothing escapes, nothing grows.

Random, truncated and mutated datagrams, all from one seed. The long run:
``DRONERF_FUZZ=1000000 pytest tests/swarm/test_fuzz.py``.
"""

from __future__ import annotations

import asyncio
import logging
import os
import random
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from test_video import datagrams

from server.stages import Frame
from server.swarm.config import DroneConfig, TimingConfig
from server.swarm.drone import Drone
from server.swarm.pictures import FrameDecoder
from server.swarm.ports import Receiver
from server.swarm.video import VideoDecoder

COUNT = int(os.environ.get("DRONERF_FUZZ", "20000"))
SEED = int(os.environ.get("DRONERF_FUZZ_SEED", "1"))
# What a process may gain over the last nine tenths of the datagrams.
GROWTH_BYTES = 24 << 20

REPLIES = (
    b"ok",
    b"OK",
    b"error",
    b"error Not joystick",
    b"forced stop",
    b"out of range",
    b"unknown command: Re0701",
    b"Re0701 ok",
    b"Re9905 error Motor stop",
    b"87\r\n",
    b"24s\r\n",
    b"0TQDG3UEDBSP12\r\n",
    b"85~88C\r\n",
    b"pitch:0;roll:-1;yaw:0;\r\n",
    b"OK,drone will reboot in 3s\0",
    b"\xcc\x58\x00\x7c\x60",
    b"",
)
STATES = (
    b"mid:-1;x:-100;y:-100;z:-100;mpry:-1,-1,-1;pitch:3;roll:-1;yaw:21;vgx:2;vgy:-3;vgz:-4;"
    b"templ:84;temph:87;tof:62;h:80;bat:83;baro:94.48;time:50;agx:-10.00;agy:16.00;agz:-999.00;\r\n",
    b"pitch:0;roll:0;yaw:0;vgx:0;vgy:0;vgz:0;templ:60;temph:62;tof:6553;h:0;bat:12;baro:1.00;"
    b"time:7;agx:0.00;agy:0.00;agz:-999.00;\r\n",
)
NUMBERS = (b"nan", b"inf", b"-1e308", b"9" * 400, b"-0", b"", b"1_000", "\u0663".encode())


def mistreated(rng: random.Random, originals: tuple[bytes, ...]) -> bytes:
    """Return something that is or once was one of the originals."""
    datagram = bytearray(rng.choice(originals))
    for _ in range(rng.choice((0, 1, 1, 2, 5))):
        at = rng.randrange(len(datagram) + 1)
        match rng.randrange(7):
            case 0:
                del datagram[at:]
            case 1:
                del datagram[:at]
            case 2 if at < len(datagram):
                datagram[at] = rng.randrange(256)
            case 3:
                datagram[at:at] = rng.randbytes(rng.randrange(1, 40))
            case 4:
                datagram[at:at] = rng.choice(NUMBERS)
            case 5:
                datagram += rng.choice(originals)
            case _:
                datagram = bytearray(rng.randbytes(rng.choice((0, 1, 7, 60, 1460, 1461))))
    return bytes(datagram[:65000])


def resident_bytes() -> int:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE")


def open_files() -> int:
    return len(list(Path("/proc/self/fd").iterdir()))


@contextmanager
def nothing_fails() -> Iterator[None]:
    """The driver swallows exceptions of a beat and of a picture with a traceback in its log."""
    failures: list[logging.LogRecord] = []

    class Collecting(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            if record.exc_info:
                failures.append(record)

    handler = Collecting(logging.ERROR)
    logger = logging.getLogger("server.swarm")
    loop_logger = logging.getLogger("asyncio")  # Where a callback's own failure goes.
    logger.addHandler(handler)
    loop_logger.addHandler(handler)
    # Warnings about every second datagram would fill the memory of whoever collects them.
    before, logger.propagate = logger.propagate, False
    try:
        yield
    finally:
        logger.removeHandler(handler)
        loop_logger.removeHandler(handler)
        logger.propagate = before
    assert not failures, failures[0].getMessage()


class DeafLink:
    """Counts what is sent and forgets it."""

    def __init__(self) -> None:
        self.sent = self.unsent = 0
        self.receivers: tuple[Receiver, Receiver, Receiver] | None = None

    async def open(self, on_reply: Receiver, on_state: Receiver, on_video: Receiver) -> None:
        self.receivers = on_reply, on_state, on_video

    def send(self, datagram: bytes) -> None:
        self.sent += 1

    def close(self) -> None:
        pass


class NoPictures:
    """A decoder that drops everything."""

    overflows = 0

    async def __aenter__(self) -> NoPictures:
        return self

    async def __aexit__(self, *exc: object) -> None:
        pass

    def feed(self, datagram: bytes, arrived_s: float) -> None:
        pass


def no_pictures(drone_id: str, on_frame: Callable[[Frame], None]) -> FrameDecoder:
    return NoPictures()


def bounded(before: int) -> None:
    grown = resident_bytes() - before
    logging.getLogger(__name__).info("grew by %d KiB", grown >> 10)
    assert grown < GROWTH_BYTES, f"grew by {grown >> 20} MiB"


# About 7000 datagrams a second on an idle core.
patient = pytest.mark.timeout(120 + COUNT // 100)

needs_proc = pytest.mark.skipif(
    not Path("/proc/self/statm").exists(), reason="memory is measured by /proc"
)


@needs_proc
@patient
@pytest.mark.slow
def test_commands_and_states_survive_rubbish() -> None:
    """In the air, landing, cut and on the ground, with commands under way and orders given."""
    rng = random.Random(SEED)
    now_s = 100.0

    async def run() -> None:
        nonlocal now_s
        link = DeafLink()
        timing = TimingConfig(beat_s=1e-4, land_s=1e-3, retry_s=0.05)
        drone = Drone(DroneConfig(), link, timing=timing, clock=lambda: now_s, decoder=no_pictures)
        orders = (drone.hold, drone.land_now, drone.cut_motors, drone.rearm, drone.rearm)
        under_way: set[asyncio.Task[None]] = set()
        before = 0
        async with drone:
            assert link.receivers is not None
            for number in range(COUNT):
                which, originals = (0, REPLIES) if rng.random() < 0.5 else (1, STATES)
                link.receivers[which](mistreated(rng, originals), now_s)
                now_s += rng.choice((0.0, 0.001, 0.01, 0.1))
                if number % 50 == 0:
                    rng.choice(orders)()
                    await asyncio.sleep(0)
                if number % 200 == 0:
                    for task in under_way:
                        task.cancel()
                    await asyncio.gather(*under_way, return_exceptions=True)
                    drone.rearm()
                    under_way = {
                        asyncio.create_task(drone.connect()),
                        asyncio.create_task(drone.take_off()),
                    }
                    await asyncio.sleep(2e-4)
                if number == COUNT // 10:
                    before = resident_bytes()
            for task in under_way:
                task.cancel()
            await asyncio.gather(*under_way, return_exceptions=True)
            drone.cut_motors()
            # Leaving waits for reports; they come by a clock that runs now.
            now_s += 100.0
            link.receivers[1](STATES[1], now_s)
            now_s += 10.0
            link.receivers[1](STATES[1], now_s)
        assert link.sent > 0
        assert drone.bad_states > COUNT / 20
        assert drone._asking.channel.garbage > COUNT / 20
        bounded(before)

    with nothing_fails():
        asyncio.run(run())


@needs_proc
@patient
@pytest.mark.slow
def test_video_survives_rubbish() -> None:
    """Whole streams, torn and bent, through the decoder itself."""
    rng = random.Random(SEED)
    stream = tuple(datagram for datagram, _ in datagrams())
    frames = damaged = 0

    def take(frame: Frame) -> None:
        nonlocal frames, damaged
        frames += 1
        damaged += frame.damaged
        # Pictures are converted when they are needed, far from where errors of rubbish are caught.
        assert frame.reduced_bgr(80, 60).shape == (60, 80, 3)
        width, height = frame.size_px
        if frames % 50 == 0:
            assert frame.image_bgr.shape == (height, width, 3)

    async def run() -> None:
        before, files = 0, open_files()
        async with VideoDecoder("d", take) as decoder:
            for number in range(COUNT):
                datagram = stream[number % len(stream)]
                if rng.random() < 0.15:
                    datagram = mistreated(rng, (datagram, rng.choice(stream)))
                decoder.feed(datagram, float(number))
                while len(decoder._waiting) > 8:  # noqa: ASYNC110 - The decoder is a thread.
                    await asyncio.sleep(1e-4)
                if number == COUNT // 10:
                    before = resident_bytes()
            assert len(decoder._units._buffer) <= 2 << 20
        await asyncio.sleep(0)
        bounded(before)
        assert not any(thread.name == "video d" for thread in threading.enumerate())
        assert open_files() == files

    with nothing_fails():
        asyncio.run(run())
    assert 0 < damaged < frames, "both kinds came out"
