"""Random, truncated and mutated datagrams on the simulated drone's command input.

20 000 by default; ``DRONERF_FUZZ`` sets another number.
"""

from __future__ import annotations

import gc
import os
import random
import tracemalloc

import numpy as np
import pytest

from server.sim.config import SimConfig
from server.sim.faults import parse_fault
from server.sim.tello import Tello
from server.sim.words import LEVELS, SdkLevel

_COUNT = int(os.environ.get("DRONERF_FUZZ", "20000"))
_GROWTH_BYTES = 300_000

_SEEDS = [
    *(b"command", b"takeoff", b"land", b"stop", b"emergency", b"rc 10 -20 30 -40", b"up 50"),
    *(b"cw 90", b"go 100 -50 30 60", b"go 100 0 50 60 m-1", b"curve 100 100 0 200 0 0 50"),
    *(b"flip l", b"jump 50 0 50 60 90 m1 m2", b"mon", b"mdirection 2", b"speed 55", b"battery?"),
    *(b"attitude?", b"tof?", b"sn?", b"streamon", b"port 8890 11111", b"setfps low", b"throwfly"),
    *(b"setbitrate 3", b"motoron", b"wifi some secret", b"reboot", b"EXT led 1 2 3", b"keepalive"),
    *(b"Re0101 takeoff", b"Re0102 land", b"Re\x07\x01\x01\x02 up 20", b"\xcc\x58\x00\x7c", b"Re"),
]


def _datagram(rng: random.Random) -> bytes:
    kind = rng.random()
    if kind < 0.15:
        return rng.randbytes(rng.randrange(0, 64))
    data = bytearray(rng.choice(_SEEDS))
    if kind < 0.35:
        return bytes(data)
    if kind < 0.5:
        return bytes(data[: rng.randrange(len(data) + 1)])
    if kind < 0.55:
        return bytes(data) * rng.randrange(2, 100)
    for _ in range(rng.randrange(1, 4)):
        at = rng.randrange(len(data) + 1)
        match rng.randrange(3):
            case 0:
                data[at:at] = rng.randbytes(rng.randrange(1, 4))
            case 1:
                del data[at : at + rng.randrange(1, 4)]
            case _:
                data[at : at + 1] = rng.choice([b" ", b"9", b"-", b".", b"\0", b"\xff", b"e9"])
    return bytes(data)


@pytest.mark.slow
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("level", LEVELS)
def test_no_datagram_upsets_a_drone_or_fills_its_memory(level: SdkLevel) -> None:
    rng = random.Random(f"fuzz {level}")
    faults = ("garbage=2", "late_replies=0.1", "gust=0.5@10+5")
    config = SimConfig(drones=1, sdk=level, faults=tuple(map(parse_fault, faults)))
    tello = Tello(config, 0)
    now_s, sent = 0.0, 0
    hosts = [(f"10.0.{n // 250}.{n % 250}", 1024 + n) for n in range(1000)]
    replies = 0
    early_bytes = 0
    count = _COUNT // len(LEVELS)
    tracemalloc.start()
    try:
        for sent in range(count):
            now_s += rng.choice((0.0, 0.001, 0.01, 0.05))
            for outgoing in tello.receive(_datagram(rng), rng.choice(hosts), now_s):
                assert outgoing.datagram
                assert len(outgoing.datagram) < 300
                replies += outgoing.kind == "reply"
            if not tello.powered:
                now_s += 8.1  # It hears nothing until it has restarted.
            if tello.airframe.battery_pct < 20.0:
                tello.airframe.battery_pct = 100.0
            if sent == count // 4:
                gc.collect()
                early_bytes, _ = tracemalloc.get_traced_memory()
        gc.collect()
        late_bytes, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert sent == count - 1
    assert replies > count // 3, "most of it was heard"
    assert late_bytes - early_bytes < _GROWTH_BYTES
    assert np.isfinite(tello.airframe.position).all()
    assert np.isfinite(tello.airframe.T_world_cam()).all()
