"""The volumes that no drone may enter: kept for the room, bound by plans and by safety.

A volume is a column: a rectangle of the floor plan from the floor to the ceiling. What is under a
shelf or above a table is part of it, because a drone that falls silent comes down. Volumes belong
to the room and not to a capture, so they are kept in a file of the runs folder; those of the
settings stand beside them and are changed there.

From the moment that a volume stands, the pilot's limits keep drones out of it (or drive them out),
nobody lands on it or takes off in it, and viewpoints that are left are planned anew.
"""

from __future__ import annotations

import asyncio
import json
import logging
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from server.geometry.boxes import Box3
from server.mission.checklist import Check
from server.mission.commands import Area, RefusedError, UnknownError
from server.mission.events import Event, EventStream, NoGoChanged, NoGoVolume, Noted
from server.mission.pilot import Pilot
from server.planner.config import PlannerConfig
from server.store.atomic import write_atomic
from server.swarm.config import SafetyConfig

logger = logging.getLogger(__name__)

FILE = "no-go.json"

_MOST = 12
_LEAST_SIDE_M = 0.05
_OWN, _CONFIGURED = "no-go", "settings"


class NoGo:
    """Keeps the volumes and hands them to whoever flies and plans."""

    def __init__(
        self,
        file: Path | None,
        pilot: Pilot,
        planner: PlannerConfig,
        safety: SafetyConfig,
        events: EventStream,
    ) -> None:
        """Read the file, if there is one.

        Args:
            file: Where volumes are kept; None keeps them in memory.
            pilot: Keeps drones out of them.
            planner: Its ``space.no_go`` are the volumes of the settings.
            safety: Fence, ceiling and the distance that is kept.
            events: Where changes are told.
        """
        self._file = file
        self._pilot = pilot
        self._safety = safety
        self._events = events
        self._fault = ""
        self._count = 0  # Names are not given twice, also over restarts.
        self._saving = asyncio.Lock()
        self._volumes = [
            NoGoVolume(f"{_CONFIGURED}-{number}", self._column((x_0, y_0, x_1, y_1)), True)
            for number, (x_0, y_0, _, x_1, y_1, _) in enumerate(planner.space.no_go, start=1)
        ]
        self._volumes += self._kept()
        self._bind()

    @property
    def volumes(self) -> tuple[NoGoVolume, ...]:
        """The volumes as they stand."""
        return tuple(self._volumes)

    def standing(self) -> list[Event]:
        """Return what a newcomer has to know."""
        return [NoGoChanged(self.volumes)] if self._volumes else []

    def within(self, planner: PlannerConfig) -> PlannerConfig:
        """Return ``planner`` with the volumes as they stand now."""
        corners = tuple(
            (*map(float, volume.box.lower), *map(float, volume.box.upper))
            for volume in self._volumes
        )
        return replace(planner, space=replace(planner.space, no_go=corners))

    async def add(self, area: Area) -> NoGoVolume:
        """Let no drone enter what is on and above ``area``; raises RefusedError."""
        self._refuse_if_unread()
        if len(self._volumes) >= _MOST:
            raise RefusedError(f"there are {_MOST} no-go volumes already; drop one first")
        box = self._drawn(area)
        self._count += 1
        volume = NoGoVolume(f"{_OWN}-{self._count}", box)
        self._volumes.append(volume)
        await self._changed(f"{volume.id} stands: no drone may enter it.")
        return volume

    async def change(self, volume_id: str, area: Area) -> NoGoVolume:
        """Give a volume another place; raises UnknownError or RefusedError."""
        self._refuse_if_unread()
        index = self._index(volume_id)
        volume = replace(self._volumes[index], box=self._drawn(area))
        self._volumes[index] = volume
        await self._changed(f"{volume_id} was moved.")
        return volume

    async def drop(self, volume_id: str | None = None) -> None:
        """Forget one volume, or all that are not of the settings when None.

        Raises UnknownError or RefusedError.
        """
        self._refuse_if_unread()
        if volume_id is None:
            self._volumes = [volume for volume in self._volumes if volume.configured]
            await self._changed("The no-go volumes were dropped.")
        else:
            del self._volumes[self._index(volume_id)]
            await self._changed(f"{volume_id} was dropped.")

    def take_over(self, volumes: tuple[NoGoVolume, ...]) -> None:
        """Have these volumes and no others, untold and unkept."""
        self._volumes = list(volumes)
        self._bind()

    def checks(self) -> list[Check]:
        """Return the items of the checklist: the file, and each drone that stands in a volume."""
        checks = []
        if self._fault:
            remedy = "Mend or delete it, start the console again, and look at the floor plan."
            checks.append(Check("no_go", None, False, self._fault, remedy, final=True))
        least_m = self._safety.standoff_m
        remedy = f"Switch it off and set it down {least_m:g} m away, or move the volume (Plan)."
        for drone_id, position in self._pilot.standing_places().items():
            for volume in self._volumes:
                distance_m = volume.box.distance(position)
                if distance_m < least_m:
                    found = f"stands {distance_m:.1f} m from {volume.id}"
                    checks.append(Check("no_go", drone_id, False, found, remedy, final=True))
                    break
        return checks

    def _index(self, volume_id: str) -> int:
        for index, volume in enumerate(self._volumes):
            if volume.id == volume_id:
                if volume.configured:
                    raise RefusedError(f"{volume_id} is of the settings; change it there")
                return index
        raise UnknownError(f"there is no no-go volume {volume_id!r}")

    def _drawn(self, area: Area) -> Box3:
        """Return the column on ``area`` as somebody drew it; raises RefusedError."""
        column = self._column(area)
        if column.size[:2].min() < _LEAST_SIDE_M:
            raise RefusedError(f"a no-go volume needs sides of at least {_LEAST_SIDE_M:g} m")
        farthest_m = 2.0 * self._safety.fence_radius_m
        if np.abs(column.corners[:, :2]).max() > farthest_m:
            raise RefusedError(f"a no-go volume may reach {farthest_m:g} m from the middle")
        return column

    def _column(self, area: Area) -> Box3:
        """Return the column on ``area``, whichever way it was drawn; raises RefusedError."""
        x_0, y_0, x_1, y_1 = area
        if not all(map(math.isfinite, area)):
            raise RefusedError("a no-go volume needs finite numbers")
        lower = np.array([min(x_0, x_1), min(y_0, y_1), 0.0])
        upper = np.array([max(x_0, x_1), max(y_0, y_1), self._safety.ceiling_m])
        return Box3(lower, upper)

    async def _changed(self, text: str) -> None:
        """Bind the volumes, keep and tell them."""
        # Drones first: what is on no disk keeps them out all the same.
        self._bind()
        self._events.publish(NoGoChanged(self.volumes))
        self._events.publish(Noted("info", text))
        if self._file is None:
            return
        async with self._saving:
            own = [volume for volume in self._volumes if not volume.configured]
            kept = [{"id": volume.id, "area": list(volume.area)} for volume in own]
            data = json.dumps({"count": self._count, "volumes": kept}, indent=1).encode()
            try:
                await asyncio.to_thread(_write, self._file, data)
            except OSError as error:
                text = f"The no-go volumes hold until the console ends, they are not kept: {error}."
                self._events.publish(Noted("warning", text))

    def _bind(self) -> None:
        self._pilot.no_go = tuple(volume.box for volume in self._volumes)

    def _refuse_if_unread(self) -> None:
        # Writing would lose what nobody could read.
        if self._fault:
            raise RefusedError(f"{self._fault}; mend or delete it and start the console again")

    def _kept(self) -> list[NoGoVolume]:
        """Return the volumes of the file; a file that cannot be read is a fault."""
        if self._file is None:
            return []
        try:
            kept = json.loads(self._file.read_text())
            volumes = [self._from_json(each) for each in kept["volumes"]]
            self._count = int(kept["count"])
            if len({volume.id for volume in volumes}) < len(volumes):
                raise ValueError("two volumes have one name")
        except FileNotFoundError:
            return []
        except (OSError, ValueError, KeyError, TypeError, OverflowError, RefusedError) as error:
            self._fault = f"{self._file.name} cannot be read ({error})"
            logger.exception("%s", self._fault)
            return []
        return volumes

    def _from_json(self, kept: dict[str, Any]) -> NoGoVolume:
        x_0, y_0, x_1, y_1 = map(float, kept["area"])
        return NoGoVolume(str(kept["id"]), self._column((x_0, y_0, x_1, y_1)))


def _write(file: Path, data: bytes) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    write_atomic(file, data)
