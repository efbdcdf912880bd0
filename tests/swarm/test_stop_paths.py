"""The stops against a link that records and a clock that stands still until it is told to move.

The drone's beat runs on the event loop's own time; what it decides depends on the fake clock and on
the reports fed in, so waits here only give the beat its turn.
"""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator

import numpy as np
import pytest

from server.stages import Setpoint
from server.swarm.config import DroneConfig, TimingConfig
from server.swarm.drone import Drone, DroneError
from server.swarm.ports import Receiver

TURN_S = 0.01


class FakeDroneLink:
    """Records what is sent; the test plays the drone."""

    def __init__(self) -> None:
        self.unsent = 0
        self.sent: list[bytes] = []
        self.reply: Receiver | None = None
        self.state: Receiver | None = None

    async def open(self, on_reply: Receiver, on_state: Receiver, on_video: Receiver) -> None:
        self.reply, self.state = on_reply, on_state

    def send(self, datagram: bytes) -> None:
        self.sent.append(datagram)

    def close(self) -> None:
        pass


class Rig:
    """A drone, its recorded link and its clock."""

    def __init__(self) -> None:
        self.now_s = 100.0
        self._tick_s = 0.0
        self.motor_s = 7.0
        self.link = FakeDroneLink()
        timing = TimingConfig(
            beat_s=TURN_S / 5, land_s=TURN_S, stop_repeats_s=(TURN_S / 5, TURN_S / 2)
        )
        # Without labels: what a consumer drone is told is told an EDU, too, with or without them.
        config = DroneConfig(edu=False)
        self.drone = Drone(config, self.link, timing=timing, clock=self._clock)

    def _clock(self) -> float:
        self.now_s += self._tick_s
        return self.now_s

    def leave(self) -> None:
        """Let the clock run: leaving waits for a landing, but not for ever."""
        self._tick_s = 1.0

    def report(self, height_cm: int = 0, *, motors: bool = False, pass_s: float = 0.1) -> None:
        """Let time pass and a state report come in."""
        self.now_s += pass_s
        self.motor_s += pass_s if motors else 0.0
        assert self.link.state is not None
        seconds = int(self.motor_s)
        self.link.state(
            b"pitch:0;roll:0;yaw:0;vgx:0;vgy:0;vgz:0;templ:60;temph:62;tof:80;h:%d;bat:90;"
            b"baro:1.00;time:%d;agx:0.00;agy:0.00;agz:-999.00;\r\n" % (height_cm, seconds),
            self.now_s,
        )

    def answer(self, text: bytes) -> None:
        assert self.link.reply is not None
        self.link.reply(text, self.now_s)

    async def turn(self) -> list[bytes]:
        """Give the beat its turn; return what was sent meanwhile."""
        before = len(self.link.sent)
        await asyncio.sleep(TURN_S)
        return self.link.sent[before:]

    async def fly(self) -> None:
        """Take off properly."""
        self.report()
        ordered = asyncio.create_task(self.drone.take_off())
        await self.turn()
        assert self.link.sent[-2:] == [b"rc 0 0 0 0", b"takeoff"]
        for height_cm in (0, 30, 60, 80):
            self.report(height_cm, motors=True, pass_s=0.9)
        self.answer(b"ok")
        await ordered
        assert self.drone.activity == "flying"
        self.link.sent.clear()


@pytest.fixture
async def rig() -> AsyncIterator[Rig]:
    rig = Rig()
    async with rig.drone:
        yield rig
        rig.leave()


async def test_hold_is_written_before_the_call_returns_and_latches(rig: Rig) -> None:
    await rig.fly()
    forward = Setpoint(np.array([0.3, 0.0, 0.0]), 0.0)
    assert rig.drone.set_setpoint(forward, rig.now_s)
    assert any(d.startswith(b"rc 0 5") for d in await rig.turn())
    rig.link.sent.clear()
    rig.drone.hold()
    assert rig.link.sent == [b"rc 0 0 0 0", b"stop"]
    assert not rig.drone.set_setpoint(forward, rig.now_s)
    sent = await rig.turn()
    assert sent.count(b"stop") == 2
    assert set(sent) == {b"rc 0 0 0 0", b"stop"}
    assert rig.drone.activity == "holding"


async def test_setpoint_that_is_not_renewed_becomes_hover(rig: Rig) -> None:
    await rig.fly()
    assert rig.drone.set_setpoint(Setpoint(np.array([0.0, 0.3, 0.0]), 0.0), rig.now_s)
    rig.report(80, motors=True, pass_s=0.41)
    await rig.turn()
    assert (await rig.turn())[-1] == b"rc 0 0 0 0"


async def test_hold_ends_a_take_off_that_waits_for_its_reply(rig: Rig) -> None:
    rig.report()
    ordered = asyncio.create_task(rig.drone.take_off())
    await rig.turn()
    rig.link.sent.clear()
    rig.drone.hold()
    assert rig.link.sent == [b"rc 0 0 0 0", b"stop"]
    with pytest.raises(DroneError, match="stopped"):
        await ordered


async def test_drone_stopped_close_above_the_ground_is_not_forgotten(rig: Rig) -> None:
    rig.report()
    ordered = asyncio.create_task(rig.drone.take_off())
    await rig.turn()
    rig.drone.hold()
    with pytest.raises(DroneError):
        await ordered
    for _ in range(60):
        rig.report(10, motors=True)
    await rig.turn()
    assert rig.drone.activity == "holding"
    assert b"rc 0 0 0 0" in await rig.turn()


async def test_low_hover_believed_to_be_the_ground_is_noticed(rig: Rig) -> None:
    rig.report()
    await rig.turn()
    for _ in range(60):
        rig.report(10, motors=True)
    assert rig.drone.activity == "flying"
    assert b"rc 0 0 0 0" in await rig.turn()


async def test_land_during_take_off_stops_the_climb_first(rig: Rig) -> None:
    rig.report()
    ordered = asyncio.create_task(rig.drone.take_off())
    await rig.turn()
    rig.link.sent.clear()
    rig.drone.land_now()
    # A drone refuses "land" while "takeoff" is still running.
    assert rig.link.sent == [b"rc 0 0 0 0", b"stop", b"land"]
    with pytest.raises(DroneError, match="stopped"):
        await ordered


async def test_land_is_repeated_even_to_a_drone_believed_down(rig: Rig) -> None:
    rig.report()
    rig.drone.land_now()
    assert b"land" in rig.link.sent
    assert (await rig.turn()).count(b"land") == 2


async def test_land_goes_on_until_the_drone_is_seen_to_be_down(rig: Rig) -> None:
    await rig.fly()
    rig.drone.land_now()
    await rig.turn()
    for _ in range(3):
        rig.report(80, motors=True, pass_s=1.1)
        assert b"land" in await rig.turn()
    assert rig.drone.activity == "landing"
    rig.report(0, motors=True)
    rig.answer(b"ok")
    await rig.turn()
    assert rig.drone.activity == "ground"


async def test_an_ok_in_the_air_is_not_taken_for_a_landing(rig: Rig) -> None:
    await rig.fly()
    rig.drone.land_now()
    rig.report(80, motors=True, pass_s=1.1)
    rig.answer(b"ok")
    await rig.turn()
    assert rig.drone.activity == "landing"


async def test_hold_does_not_disturb_a_landing(rig: Rig) -> None:
    await rig.fly()
    rig.drone.land_now()
    await rig.turn()
    rig.link.sent.clear()
    rig.drone.hold()
    assert b"stop" not in rig.link.sent + await rig.turn()
    assert rig.drone.activity == "landing"
    assert rig.drone.held


async def test_land_ends_the_repeats_of_hold(rig: Rig) -> None:
    await rig.fly()
    rig.drone.hold()
    rig.drone.land_now()
    assert b"stop" not in await rig.turn()


async def test_cut_is_repeated_as_long_as_the_motors_run(rig: Rig) -> None:
    await rig.fly()
    rig.drone.cut_motors()
    assert rig.link.sent[0] == b"emergency"
    await rig.turn()
    for _ in range(4):
        rig.report(80, motors=True, pass_s=1.0)
        assert b"emergency" in await rig.turn()
    for _ in range(4):
        rig.report(0, pass_s=1.0)
        await rig.turn()
    rig.link.sent.clear()
    rig.report(0, pass_s=0.5)
    assert b"emergency" not in await rig.turn()


async def test_nothing_moves_after_cut_until_rearm(rig: Rig) -> None:
    await rig.fly()
    rig.drone.cut_motors()
    await rig.turn()
    rig.link.sent.clear()
    rig.drone.hold()
    rig.drone.land_now()
    assert not rig.drone.set_setpoint(Setpoint(np.array([0.3, 0.0, 0.0]), 0.0), rig.now_s)
    with pytest.raises(DroneError):
        await rig.drone.take_off()
    assert not {d.split()[0] for d in rig.link.sent} & {b"rc", b"takeoff", b"land", b"stop"}
    rig.drone.rearm()
    assert rig.drone.activity == "ground"
    assert not rig.drone.held


async def test_cancelled_take_off_leaves_a_drone_that_hovers(rig: Rig) -> None:
    rig.report()
    ordered = asyncio.create_task(rig.drone.take_off())
    await rig.turn()
    ordered.cancel()
    await asyncio.gather(ordered, return_exceptions=True)
    for height_cm in (0, 30, 80):
        rig.report(height_cm, motors=True, pass_s=0.9)
    assert b"rc 0 0 0 0" in await rig.turn()
    assert rig.drone.activity == "flying"


async def test_silence_hovers_then_lands(rig: Rig) -> None:
    await rig.fly()
    assert rig.drone.set_setpoint(Setpoint(np.array([0.3, 0.0, 0.0]), 0.0), rig.now_s + 60.0)
    rig.now_s += 1.2
    await rig.turn()
    assert (await rig.turn())[-1] == b"rc 0 0 0 0"
    assert rig.drone.activity == "holding"
    rig.now_s += 2.0
    assert b"land" in await rig.turn()
    assert rig.drone.activity == "landing"


async def test_leaving_lands_what_is_in_the_air() -> None:
    rig = Rig()
    async with rig.drone:
        await rig.fly()
        leave_at = len(rig.link.sent)

        async def land() -> None:
            while b"land" not in rig.link.sent[leave_at:]:  # noqa: ASYNC110  # A plain list.
                await asyncio.sleep(TURN_S / 5)
            rig.report(0, motors=True, pass_s=1.1)
            rig.answer(b"ok")
            rig.report(0, pass_s=1.1)

        landing = asyncio.create_task(land())
    await landing
    assert b"land" in rig.link.sent[leave_at:]
