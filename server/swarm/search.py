"""Keeps a fleet's stations found: those without an address, and those whose address has moved."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Mapping

from server.swarm.config import StationConfig
from server.swarm.drone import Drone
from server.swarm.link import UdpDroneLink
from server.swarm.ports import LinkError
from server.swarm.station import Progress, find_stations

_LOG = logging.getLogger(__name__)


class StationSearch:
    """Searches the network for the drones of a fleet that are known by their serial number.

    Nothing is searched before somebody asked for a connection, nor while a drone is in the air.
    """

    def __init__(
        self, config: StationConfig, drones: Mapping[str, Drone], links: Mapping[str, UdpDroneLink]
    ) -> None:
        self._config = config
        self._drones = drones
        self._links = {
            drone_id: link
            for drone_id, link in links.items()
            if drones[drone_id].config.link == "station" and drones[drone_id].config.serial
        }
        self._asked = False
        self._searching: asyncio.Task[None] | None = None

    def start(self) -> None:
        """Begin to watch for stations that have fallen silent."""
        if self._config.subnet and self._links:
            self._searching = asyncio.create_task(self._keep_found(), name="station search")

    async def close(self) -> None:
        """Search no more."""
        if self._searching is not None:
            self._searching.cancel()
            await asyncio.gather(self._searching, return_exceptions=True)

    async def find_all(self, progress: Progress | None = None) -> dict[str, str]:
        """Find every station without an address.

        Returns:
            The reason by id for each that was not found.
        """
        self._asked = True
        unknown = [drone_id for drone_id, link in self._links.items() if not link.address]
        if not unknown:
            return {}
        try:
            await self._find(unknown, progress)
        except LinkError as error:
            return dict.fromkeys(unknown, str(error))
        return {
            drone_id: f"{self._drones[drone_id].config.label}: no drone with the serial number"
            f" {self._drones[drone_id].config.serial} in {self._config.subnet}"
            for drone_id in unknown
            if not self._links[drone_id].address
        }

    async def _find(self, lost: list[str], progress: Progress | None = None) -> None:
        serials = {self._drones[drone_id].config.serial: drone_id for drone_id in lost}
        others = {self._links[i].address for i in self._links if i not in lost}
        through = self._drones[lost[0]].config
        found = await find_stations(
            self._config, serials, through=through, skip=others, progress=progress
        )
        for serial, address in found.items():
            drone_id = serials.get(serial)
            if drone_id is not None and self._links[drone_id].address != address:
                _LOG.info("%s: found at %s", drone_id, address)
                await self._links[drone_id].move_to(address)
        taken = {address: serials[serial] for serial, address in found.items() if serial in serials}
        for drone_id, link in self._links.items():
            if taken.get(link.address, drone_id) != drone_id:
                # Its orders, LAND and CUT among them, would reach the drone that is there now.
                _LOG.warning("%s: another drone is at %s now", drone_id, link.address)
                await link.move_to("")

    async def _keep_found(self) -> None:
        while True:
            await asyncio.sleep(self._config.search_again_s)
            lost = [i for i in self._links if self._drones[i].activity == "offline"]
            flying = any(drone.airborne for drone in self._drones.values())
            if not self._asked or not lost or flying:
                continue
            try:
                await self._find(lost)
            except (LinkError, ValueError) as error:
                _LOG.warning("station search: %s", error)
