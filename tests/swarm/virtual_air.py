"""A driver and a simulated Tello joined without sockets, in virtual time.

The loop's clock jumps to the next timer whenever nothing is ready, so a minute of flight takes a
moment, nothing depends on how busy the machine is, and each run is the same as the last.
"""

from __future__ import annotations

import asyncio
import selectors
from collections import deque
from collections.abc import AsyncIterator, Callable, Coroutine, Mapping
from contextlib import asynccontextmanager
from typing import Any, TypeVar

import numpy as np

from server.sim.config import DynamicsConfig
from server.sim.dynamics import Airframe
from server.sim.sdk import TextSdk, state_line
from server.stages import Setpoint
from server.swarm.config import DroneConfig, FleetConfig, SafetyConfig, TimingConfig
from server.swarm.drone import Drone
from server.swarm.fleet import Fleet
from server.swarm.link import Receiver

T = TypeVar("T")

STEP_S = 0.02
LATENCY_S = 0.004
# A drone without whims: what a test sees is what it ordered.
CALM = DynamicsConfig(
    gain_sigma=0.0,
    drift_sigma_m_s=0.0,
    yaw_walk_deg=0.0,
    gyro_bias_deg_s=0.0,
    shake_deg=0.0,
    tilt_sigma_deg=0.0,
)


class _JumpingSelector(selectors.DefaultSelector):
    """Instead of waiting for a timer it moves the clock to it."""

    def __init__(self) -> None:
        super().__init__()
        self.now_s = 1000.0
        self.threads_at_work = 0

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        if timeout is None:
            return super().select(None)  # Only another thread can go on from here.
        if self.threads_at_work:
            return super().select(0.01)  # Their time is real, so ours stands still meanwhile.
        ready = super().select(0)
        if not ready:
            self.now_s += max(0.0, timeout)
        return ready


class VirtualTimeLoop(asyncio.SelectorEventLoop):
    """An event loop that never sleeps."""

    def __init__(self) -> None:
        self._jumping = _JumpingSelector()
        super().__init__(self._jumping)

    def time(self) -> float:
        return self._jumping.now_s

    def run_in_executor(self, executor: Any, func: Any, *args: Any) -> asyncio.Future[Any]:
        self._jumping.threads_at_work += 1
        future = super().run_in_executor(executor, func, *args)
        future.add_done_callback(self._thread_done)
        return future

    def _thread_done(self, _: object) -> None:
        self._jumping.threads_at_work -= 1


def in_virtual_time(coroutine: Coroutine[Any, Any, T]) -> T:
    """Run a coroutine to its end in virtual time."""
    with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
        return runner.run(coroutine)


def now_s() -> float:
    return asyncio.get_running_loop().time()


class AirLink:
    """A ``DroneLink`` to a simulated drone in the same process.

    Attributes:
        airframe: The drone's body: the truth.
        sdk: The drone's side of the protocol.
        sent: What the driver sent, with its time.
        loses: Says which datagrams to the drone are lost; may be replaced at any time.
        deaf: Says which datagrams from the drone are lost.
        broken: When True, sending raises, as no link should.
    """

    def __init__(self, dynamics: DynamicsConfig = CALM, seed: int = 0) -> None:
        self.airframe = Airframe(np.zeros(3), 0.0, dynamics, np.random.default_rng(seed))
        self.sdk = TextSdk(self.airframe, "0TQTEST0000001")
        self.sent: list[tuple[float, bytes]] = []
        self.loses: Callable[[bytes], bool] = lambda datagram: False
        self.deaf: Callable[[bytes], bool] = lambda datagram: False
        self.broken = False
        self._under_way: deque[bytes] = deque()
        self._receivers: tuple[Receiver, Receiver, Receiver] | None = None
        self._task: asyncio.Task[None] | None = None

    async def open(self, on_reply: Receiver, on_state: Receiver, on_video: Receiver) -> None:
        self._receivers = on_reply, on_state, on_video
        self._task = asyncio.create_task(self._live())

    def send(self, datagram: bytes) -> None:
        if self.broken:
            raise RuntimeError("this link is broken")
        self.sent.append((now_s(), datagram))
        if not self.loses(datagram):
            self._under_way.append(datagram)
            asyncio.get_running_loop().call_later(LATENCY_S, self._arrive_next)

    def close(self) -> None:
        if self._task is not None:
            self._task.cancel()

    def since(self, begun_s: float) -> list[bytes]:
        """Return what the driver sent from ``begun_s`` on."""
        return [datagram for at_s, datagram in self.sent if at_s >= begun_s]

    def _arrive_next(self) -> None:
        # Timers for one instant come in any order; one radio hop keeps the order of datagrams.
        self._arrive(self._under_way.popleft())

    def _arrive(self, datagram: bytes) -> None:
        self._reply(self.sdk.receive(datagram, ("127.0.0.1", 1), now_s()))

    def _reply(self, outgoing: list[tuple[bytes, tuple[str, int]]]) -> None:
        for datagram, _ in outgoing:
            self._hand_over(0, datagram)

    def _hand_over(self, receiver: int, datagram: bytes) -> None:
        if self._receivers is not None and not self.deaf(datagram):
            take = self._receivers[receiver]
            loop = asyncio.get_running_loop()
            loop.call_later(LATENCY_S, lambda: take(datagram, loop.time()))

    async def _live(self) -> None:
        step = 0
        while True:
            await asyncio.sleep(STEP_S)
            step += 1
            self.airframe.step(STEP_S)
            self._reply(self.sdk.tick(now_s()))
            if step % 5 == 0 and self.sdk.client is not None:
                self._hand_over(1, state_line(self.airframe))


@asynccontextmanager
async def flying_drone(
    link: AirLink, *, up: bool = True, safety: SafetyConfig | None = None
) -> AsyncIterator[Drone]:
    """A connected drone, in the air unless ``up`` is False."""
    drone = Drone(DroneConfig(), link, safety, TimingConfig(), clock=now_s)
    async with drone:
        await drone.connect()
        if up:
            await drone.take_off()
        yield drone


def fleet_on(links: Mapping[str, AirLink]) -> Fleet:
    """A fleet on these links, by drone id."""
    drones = tuple(
        DroneConfig(id=drone_id, address=f"127.9.9.{number + 1}")
        for number, drone_id in enumerate(links)
    )
    return Fleet(FleetConfig(drones), links=dict(links), clock=now_s)


@asynccontextmanager
async def flying_fleet(links: Mapping[str, AirLink]) -> AsyncIterator[Fleet]:
    """A connected fleet in the air."""
    async with fleet_on(links) as fleet:
        assert await fleet.connect() == {}
        await asyncio.gather(*(drone.take_off() for drone in fleet.drones.values()))
        yield fleet


def setpoint(
    forward: float = 0.0, left: float = 0.0, up: float = 0.0, turn: float = 0.0
) -> Setpoint:
    """A setpoint in body axes, m/s and rad/s."""
    return Setpoint(np.array([forward, left, up]), turn)


async def steer(drone: Drone, wanted: Setpoint, seconds: float) -> None:
    """Renew a setpoint ten times a second, as the pilot does."""
    until_s = now_s() + seconds
    while now_s() < until_s:
        drone.set_setpoint(wanted, now_s())
        await asyncio.sleep(0.1)


async def sunk_to(link: AirLink, height_m: float) -> None:
    """Wait until the drone is truly this low."""
    while link.airframe.position[2] > height_m:  # noqa: ASYNC110 - The truth raises no events.
        await asyncio.sleep(STEP_S)
