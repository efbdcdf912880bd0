"""All drones together, and the three stops for one or all of them."""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Callable
from contextlib import AsyncExitStack

from server.swarm.config import FleetConfig, SafetyConfig, TimingConfig
from server.swarm.drone import Drone
from server.swarm.link import DroneLink, PortBoard, UdpDroneLink

_LOG = logging.getLogger(__name__)


class Fleet:
    """The drones of a fleet file; an async context manager and the ``StopControl``.

    Leaving it lands every drone that is in the air.

    Attributes:
        config: Who they are and where they start.
        drones: By id, in fleet order.
    """

    def __init__(
        self,
        config: FleetConfig,
        safety: SafetyConfig | None = None,
        timing: TimingConfig | None = None,
        links: dict[str, DroneLink] | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Build the fleet; ``links`` by drone id replace the usual UDP links."""
        self.config = config
        board = PortBoard(clock)
        links = links if links is not None else {}
        self.drones = {
            drone.id: Drone(
                drone, links.get(drone.id, UdpDroneLink(drone, board)), safety, timing, clock
            )
            for drone in config.drones
        }

    async def __aenter__(self) -> Fleet:
        async with AsyncExitStack() as stack:
            for drone in self.drones.values():
                await stack.enter_async_context(drone)
            stack.pop_all()  # All are open; from here on ``__aexit__`` closes them, side by side.
        return self

    async def __aexit__(self, *_: object) -> None:
        # All go down at the same time, not one after the other.
        for drone in self.drones.values():
            if drone.airborne:
                self._try("land", drone.land_now, drone.config.id)
        closings = (drone.close() for drone in self.drones.values())
        results = await asyncio.gather(*closings, return_exceptions=True)
        for drone_id, result in zip(self.drones, results, strict=True):
            if isinstance(result, BaseException):
                _LOG.error("%s: closing failed", drone_id, exc_info=result)

    async def connect(self, timeout_s: float = 10.0) -> dict[str, str]:
        """Connect to all drones side by side.

        Returns:
            The reason by id for each drone that did not answer in time; empty when all did.
        """
        failures: dict[str, str] = {}

        async def connect_one(drone: Drone) -> None:
            try:
                async with asyncio.timeout(timeout_s):
                    await drone.connect()
            except TimeoutError:
                failures[drone.config.id] = (
                    f"{drone.config.label} at {drone.config.address} did not answer"
                    f" within {timeout_s:.0f} s"
                )

        async with asyncio.TaskGroup() as group:
            for drone in self.drones.values():
                group.create_task(connect_one(drone), name=f"connect {drone.config.id}")
        return failures

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
