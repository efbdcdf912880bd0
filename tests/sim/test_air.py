"""A driver's link to a simulated drone on one event loop, in virtual time."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable

import numpy as np
import pytest

from server.sim.air import DRIVER, LATENCY_S, AirLink
from server.sim.config import SimConfig, fleet_config
from server.sim.faults import parse_fault
from server.sim.tello import Outgoing, Tello
from server.sim.virtual_time import in_virtual_time
from server.swarm.fleet import Fleet
from server.swarm.link import DroneLink


class Ears:
    """What a driver hears, with times."""

    def __init__(self) -> None:
        self.replies: list[tuple[float, bytes]] = []
        self.states: list[tuple[float, bytes]] = []
        self.videos: list[tuple[float, bytes]] = []

    async def listen(self, link: AirLink) -> None:
        await link.open(
            lambda data, at_s: self.replies.append((at_s, data)),
            lambda data, at_s: self.states.append((at_s, data)),
            lambda data, at_s: self.videos.append((at_s, data)),
        )


def now_s() -> float:
    return asyncio.get_running_loop().time()


def drone(*faults: str, seed: int = 0) -> Tello:
    config = SimConfig(drones=1, seed=seed, faults=tuple(map(parse_fault, faults)))
    return Tello(config, 0)


def test_replies_states_and_pictures_arrive_in_their_ears() -> None:
    async def fly() -> None:
        taken_s: list[float] = []

        def camera(at_s: float) -> list[bytes]:
            taken_s.append(at_s)
            return [f"picture {len(taken_s)} piece {piece}".encode() for piece in range(3)]

        ears, link = Ears(), AirLink(drone(), camera=camera, fps=5.0)
        await ears.listen(link)
        begun_s = now_s()
        link.send(b"command")
        await asyncio.sleep(2.0)
        assert ears.replies == [(pytest.approx(begun_s + 2 * LATENCY_S), b"ok")]
        assert len(ears.states) == pytest.approx(20, abs=1)
        assert not taken_s, "the camera is dark until it is switched on"
        link.send(b"streamon")
        await asyncio.sleep(2.0)
        assert len(taken_s) == pytest.approx(10, abs=1)
        pieces = [data.split()[1:] for _, data in ears.videos]
        order = [(int(words[0]), int(words[2])) for words in pieces]
        whole = [(n + 1, piece) for n in range(len(taken_s)) for piece in range(3)]
        assert order == whole[: len(order)]
        assert len(order) >= len(whole) - 3, "the last picture may be in the air"

    in_virtual_time(fly())


def test_it_lives_on_when_the_driver_has_gone_and_lands_by_itself() -> None:
    async def fly() -> None:
        ears, link = Ears(), AirLink(drone())
        await ears.listen(link)
        link.send(b"command")
        link.send(b"takeoff")
        await asyncio.sleep(8.0)
        link.close()
        heard = len(ears.states)
        link.send(b"land")
        await asyncio.sleep(5.0)
        assert len(ears.states) == heard
        assert link.tello.airframe.phase == "flying", "nothing reaches it any more"
        await asyncio.sleep(15.0)
        assert link.tello.airframe.phase == "standing"
        link.end()
        ended_s = now_s()
        before = link.tello.airframe.battery_pct
        await asyncio.sleep(60.0)
        assert now_s() > ended_s
        assert link.tello.airframe.battery_pct == before

    in_virtual_time(fly())


def test_loss_on_the_way_up_and_down_are_two_things() -> None:
    async def fly() -> None:
        ears, link = Ears(), AirLink(drone("loss_down=1@1"))
        await ears.listen(link)
        link.send(b"command")
        await asyncio.sleep(1.5)
        link.send(b"takeoff")
        await asyncio.sleep(6.0)
        assert [data for _, data in ears.replies] == [b"ok"]
        assert link.tello.airframe.phase == "flying"

        deaf_ears, deaf = Ears(), AirLink(drone("loss_up=1@1"))
        await deaf_ears.listen(deaf)
        deaf.send(b"command")
        await asyncio.sleep(1.5)
        deaf.send(b"takeoff")
        heard = len(deaf_ears.states)
        await asyncio.sleep(6.0)
        assert deaf.tello.airframe.phase == "standing"
        assert len(deaf_ears.states) - heard == pytest.approx(60, abs=1)

    in_virtual_time(fly())


def test_delay_on_the_way_up_and_down_are_two_things() -> None:
    async def fly() -> None:
        ears, link = Ears(), AirLink(drone("delay_down=1@1"))
        await ears.listen(link)
        link.send(b"command")
        await asyncio.sleep(1.5)
        link.send(b"takeoff")
        heard = len(ears.states)
        await asyncio.sleep(0.45)
        assert link.tello.airframe.phase == "taking_off", "the order is there at once"
        assert len(ears.states) == heard, "what it reports is still under way"
        await asyncio.sleep(1.0)
        assert len(ears.states) > heard

        slow_ears, slow = Ears(), AirLink(drone("delay_up=1@1"))
        await slow_ears.listen(slow)
        slow.send(b"command")
        await asyncio.sleep(1.5)
        slow.send(b"takeoff")
        heard = len(slow_ears.states)
        await asyncio.sleep(0.95)
        assert slow.tello.airframe.phase == "standing", "the order is still under way"
        assert len(slow_ears.states) - heard == pytest.approx(9, abs=1)
        await asyncio.sleep(0.4)
        assert slow.tello.airframe.phase == "taking_off"

    in_virtual_time(fly())


def test_copies_on_the_way_up_and_down_are_two_things() -> None:
    async def fly() -> None:
        for fault, copies in (("duplicate_up=1@1", 1), ("duplicate_down=1@1", 2)):
            ears, link = Ears(), AirLink(drone(fault))
            await ears.listen(link)
            link.send(b"command")
            await asyncio.sleep(1.5)
            ears.replies.clear()
            ears.states.clear()
            link.send(b"battery?")
            await asyncio.sleep(2.0)
            answers = [data for _, data in ears.replies]
            assert answers == [b"100\r\n"] * 2, "a copy heard is answered as well"
            assert len(ears.states) == pytest.approx(20 * copies, abs=copies)

    in_virtual_time(fly())


@pytest.mark.parametrize(
    ("fault", "swapped"), [("reorder_up=0.3", True), ("reorder_down=0.3", False)]
)
def test_reordering_on_one_way_leaves_the_other_in_order(
    fault: str, swapped: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def fly() -> None:
        ears, link = Ears(), AirLink(drone(fault))
        await ears.listen(link)
        link.send(b"command")
        await asyncio.sleep(1.0)
        ears.replies.clear()
        heard: list[bytes] = []

        def listen(datagram: bytes, *_: object) -> list[Outgoing]:
            heard.append(datagram)
            return [Outgoing(datagram, DRIVER, "reply")]

        monkeypatch.setattr(link.tello, "receive", listen)
        said = [b"%03d" % number for number in range(100)]
        for datagram in said:
            link.send(datagram)
            await asyncio.sleep(0.01)
        await asyncio.sleep(1.0)
        echoed = [data for _, data in ears.replies]
        assert sorted(heard) == sorted(echoed) == said
        assert (heard != said, echoed != heard) == (swapped, not swapped)

    in_virtual_time(fly())


def test_reordered_replies_are_all_there() -> None:
    async def fly() -> None:
        ears, link = Ears(), AirLink(drone("reorder=0.3", "duplicate=0.3", seed=3))
        await ears.listen(link)
        link.send(b"command")
        await asyncio.sleep(1.0)
        ears.replies.clear()
        for _ in range(200):
            link.send(b"battery?")
            link.send(b"sdk?")
            await asyncio.sleep(0.01)
        await asyncio.sleep(1.0)
        answers = [data for _, data in ears.replies]
        assert answers.count(b"30\r\n") > 230, "copies are answered, too"
        assert answers.count(b"100\r\n") > 230
        arrivals = [at_s for at_s, _ in ears.replies]
        assert arrivals == sorted(arrivals)

    in_virtual_time(fly())


FAULTS = ("loss=0.1", "gust=0.4@air+8", "reorder=0.05", "reboot@20:drone-2", "garbage")


def flown(seed: int) -> list[list[float]]:
    """Fly a small fleet by the real driver through some trouble; return where all ended."""

    async def fly() -> list[list[float]]:
        config = SimConfig(drones=3, seed=seed, faults=tuple(map(parse_fault, FAULTS)))
        tellos = [Tello(config, index) for index in range(config.drones)]
        fleet = fleet_config(config)
        links: dict[str, DroneLink] = {
            drone.id: AirLink(tello) for drone, tello in zip(fleet.drones, tellos, strict=True)
        }
        async with Fleet(fleet, links=links, clock=now_s) as flying:
            await flying.connect()
            await _quietly([drone.take_off for drone in flying.drones.values()])
            await asyncio.sleep(20.0)
            flying.land()
            await asyncio.sleep(10.0)
        await asyncio.sleep(20.0)
        assert [tello.airframe.phase for tello in tellos] == ["standing"] * 3
        return [tello.airframe.position.tolist() for tello in tellos]

    return in_virtual_time(fly())


async def _quietly(orders: list[Callable[[], Awaitable[object]]]) -> None:
    await asyncio.gather(*(order() for order in orders), return_exceptions=True)


def test_one_seed_gives_one_flight_through_driver_and_all() -> None:
    first, again, other = flown(5), flown(5), flown(6)
    assert first == again
    assert not np.allclose(first, other)
