"""All drones together, and the three stops for one or all of them."""

from __future__ import annotations

import asyncio
import logging
import time
from collections import deque
from collections.abc import Callable
from contextlib import AsyncExitStack
from dataclasses import dataclass

from server.swarm.config import FleetConfig, SafetyConfig, TimingConfig
from server.swarm.drone import Drone
from server.swarm.errors import DroneError
from server.swarm.failsafes import Fired
from server.swarm.link import DroneLink, UdpDroneLink
from server.swarm.pictures import DecoderMaker
from server.swarm.ports import PortBoard
from server.swarm.search import StationSearch
from server.swarm.station import Progress
from server.swarm.tap import Tap
from server.swarm.video import VideoDecoder

_LOG = logging.getLogger(__name__)


# More failsafes than this in one session, and only the newest are of interest.
_NOTES_KEPT = 256


@dataclass(frozen=True, slots=True)
class FiredNote:
    """A row of the failsafe table began to fire.

    Attributes:
        drone_id: For which drone.
        fired: Which row, and what was measured.
        at_s: When, on the fleet's clock.
        number: Counts the notes of this fleet from 1, so that a reader knows what is new.
    """

    drone_id: str
    fired: Fired
    at_s: float
    number: int


class Fleet:
    """The drones of a fleet file; an async context manager and the ``StopControl``.

    Leaving it lands every drone that is in the air.

    Attributes:
        config: Who they are and where they start.
        drones: By id, in fleet order.
        fired: The newest notes of failsafes that began to fire, oldest first.
        tap: Where everything that passes between us and the drones can be heard.
    """

    def __init__(
        self,
        config: FleetConfig,
        safety: SafetyConfig | None = None,
        timing: TimingConfig | None = None,
        links: dict[str, DroneLink] | None = None,
        clock: Callable[[], float] = time.monotonic,
        decoder: DecoderMaker = VideoDecoder,
    ) -> None:
        """Build the fleet; ``links`` by drone id replace the usual UDP links."""
        self.config = config
        self.tap = Tap()
        self.fired: deque[FiredNote] = deque(maxlen=_NOTES_KEPT)
        self._clock = clock
        self._operator_s: float | None = None
        self._board = board = PortBoard(clock)
        self._keeping: asyncio.Task[None] | None = None
        links = links if links is not None else {}
        self._udp = {
            drone.id: UdpDroneLink(drone, board) for drone in config.drones if drone.id not in links
        }
        self.drones = {
            drone.id: Drone(
                drone,
                links[drone.id] if drone.id in links else self._udp[drone.id],
                safety,
                timing,
                clock,
                decoder=decoder,
                operator_silence_s=self._operator_silence_s,
                on_fired=self._note_fired,
                on_land_all=self.land,
                tap=self.tap,
            )
            for drone in config.drones
        }

        self._search = StationSearch(config.station, self.drones, self._udp)

    async def __aenter__(self) -> Fleet:
        async with AsyncExitStack() as stack:
            for drone in self.drones.values():
                await stack.enter_async_context(drone)
            stack.pop_all()  # All are open; from here on ``__aexit__`` closes them, side by side.
        self._search.start()
        if any(drone.interface for drone in self.config.drones):
            self._keeping = asyncio.create_task(self._board.keep_bound(), name="keep ports bound")
        return self

    async def __aexit__(self, *_: object) -> None:
        await self._search.close()
        # All go down at the same time, not one after the other.
        for drone in self.drones.values():
            if drone.airborne:
                self._try("land", drone.land_now, drone.config.id)
        closings = (drone.close() for drone in self.drones.values())
        results = await asyncio.gather(*closings, return_exceptions=True)
        for drone_id, result in zip(self.drones, results, strict=True):
            if isinstance(result, BaseException):
                _LOG.error("%s: closing failed", drone_id, exc_info=result)
        if self._keeping is not None:
            self._keeping.cancel()
            await asyncio.gather(self._keeping, return_exceptions=True)

    async def connect(
        self, timeout_s: float = 10.0, progress: Progress | None = None
    ) -> dict[str, str]:
        """Connect to all drones side by side; those without an address are searched first.

        Args:
            timeout_s: Longest wait for the answers, the search not counted.
            progress: Told how far a search is, see ``find_stations``.

        Returns:
            The reason by id for each drone that did not answer in time; empty when all did.
        """
        failures = await self.find_stations(progress)

        async def connect_one(drone: Drone) -> None:
            try:
                async with asyncio.timeout(timeout_s):
                    await drone.connect()
            except TimeoutError:
                failures[drone.config.id] = self._silence(drone, timeout_s)
            except DroneError as error:
                failures[drone.config.id] = str(error)

        async with asyncio.TaskGroup() as group:
            for drone_id, drone in self.drones.items():
                if drone_id in failures:
                    continue
                group.create_task(connect_one(drone), name=f"connect {drone.config.id}")
        return failures

    async def find_stations(self, progress: Progress | None = None) -> dict[str, str]:
        """Find the drones that are known by their serial number alone, and from now on again.

        Args:
            progress: Told how far a search is, see ``station.find_stations``.

        Returns:
            The reason by id for each that was not found.
        """
        return await self._search.find_all(progress)

    def _silence(self, drone: Drone, waited_s: float) -> str:
        config = drone.config
        who = f"{config.label} at {self.address(config.id)}"
        if drone.answers and drone.telemetry is None:
            return (
                f"{who} answers, but no state report arrives at UDP port {config.state_port};"
                " does a firewall keep it out?"
            )
        return f"{who} did not answer within {waited_s:.0f} s"

    def address(self, drone_id: str) -> str:
        """Return where a drone is spoken to; empty while that is not known."""
        link = self._udp.get(drone_id)
        return self.drones[drone_id].config.address if link is None else link.address

    # The operator ------------------------------------------------------------------------------

    def note_operator(self) -> None:
        """Note a sign of life of the operator; from the first one on their absence counts."""
        self._operator_s = self._clock()

    def forget_operator(self) -> None:
        """Note that the operator took leave: their absence counts no longer."""
        self._operator_s = None

    def _operator_silence_s(self) -> float | None:
        return None if self._operator_s is None else self._clock() - self._operator_s

    def _note_fired(self, drone_id: str, fired: Fired) -> None:
        number = self.fired[-1].number + 1 if self.fired else 1
        self.fired.append(FiredNote(drone_id, fired, self._clock(), number))

    # Stops -----------------------------------------------------------------------------------

    def hold(self, drone_id: str | None = None) -> None:
        """See ``StopControl.hold``; raises KeyError for an unknown drone."""
        self._each("hold", drone_id, Drone.hold)

    def land(self, drone_id: str | None = None) -> None:
        """See ``StopControl.land``; raises KeyError for an unknown drone."""
        self._each("land", drone_id, Drone.land_now)

    def cut_motors(self, drone_id: str | None = None) -> None:
        """See ``StopControl.cut_motors``; raises KeyError for an unknown drone."""
        self._each("cut motors", drone_id, Drone.cut_motors)

    def _each(self, what: str, drone_id: str | None, stop: Callable[[Drone], None]) -> None:
        drones = list(self.drones.values()) if drone_id is None else [self.drones[drone_id]]
        for drone in drones:
            self._try(what, lambda drone=drone: stop(drone), drone.config.id)

    @staticmethod
    def _try(what: str, stop: Callable[[], None], drone_id: str) -> None:
        try:
            stop()
        except Exception:  # noqa: BLE001  # A stop of one must never be lost through another.
            _LOG.exception("%s: %s failed", drone_id, what)
