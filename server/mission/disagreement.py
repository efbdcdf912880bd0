"""Tells the operator when the drones do not look at one and the same thing.

Once a second the newest sights are compared (``server.vision.agreement``). A disagreement is told
when it was found twice in a row and its end when it was missing twice in a row, so that a single
bad picture is no news. Once in a capture the outlines are asked whether the drones stand in the
order that was assumed (``server.vision.arrangement``).
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Mapping

from server.mission.events import Event, EventStream, Noted, ViewsDisagree
from server.mission.eyes import Eye
from server.mission.pilot import Pilot
from server.stages import View
from server.swarm.drone import Drone
from server.vision.agreement import disagreements
from server.vision.arrangement import Arrangement, arrangements, better_arrangements
from server.vision.config import AgreementConfig

logger = logging.getLogger(__name__)

_LOOK_S = 1.0
# An older sight is compared with nothing: the drones have moved on.
_FRESH_S = 0.6
_TIMES = 2


class DisagreementWatch:
    """Watches whether the drones' regions are of one object."""

    def __init__(
        self,
        drones: Mapping[str, Drone],
        eyes: Mapping[str, Eye],
        pilot: Pilot,
        config: AgreementConfig,
        events: EventStream,
        clock: Callable[[], float],
    ) -> None:
        """Build it; ``clock`` is that of the frames' times."""
        self._drones = drones
        self._eyes = eyes
        self._pilot = pilot
        self._config = config
        self._events = events
        self._clock = clock
        self._told = ViewsDisagree((), "")
        self._found: tuple[str, ...] = ()
        self._times = 0
        self._order_asked = False

    def standing(self) -> list[Event]:
        """Return the disagreement that goes on, if any."""
        return [self._told] if self._told.drone_ids else []

    async def run(self, observers: Callable[[], tuple[str, ...]]) -> None:
        """Look once a second for ever; ``observers`` are the drones that look at the object."""
        while True:
            try:
                crew = observers()
                views = self._views(crew)
                self.look(views, watching=bool(crew))
                await self._ask_order(views, watching=bool(crew))
            except Exception:
                # Advice for the operator: its failure must not bring anybody down.
                logger.exception("the drones' views could not be compared")
            await asyncio.sleep(_LOOK_S)

    def look(self, views: list[View], *, watching: bool = True) -> None:
        """Compare ``views``, one per drone; without ``watching`` a disagreement ends at once."""
        if not watching:
            self._found, self._times = (), 0
            self._tell((), "")
            return
        found = {each.drone_id: each.text for each in disagreements(views, self._config)}
        drone_ids = tuple(found)
        if drone_ids != self._found:
            self._found, self._times = drone_ids, 0
        self._times += 1
        if self._times >= _TIMES:
            self._tell(drone_ids, " ".join(dict.fromkeys(found.values())))

    async def _ask_order(self, views: list[View], *, watching: bool) -> None:
        """Tell the operator, once in a capture, when the drones seem to stand in another order."""
        if not watching:
            self._order_asked = False
        if self._order_asked or self._told.drone_ids or not watching:
            return
        centre, config = self._pilot.target().centre, self._config.arrangement
        # Tens of milliseconds: too long for the loop that flies the drones.
        tried = await asyncio.to_thread(arrangements, views, centre, config)
        self._order_asked = bool(tried)
        better = better_arrangements(tried, config)
        if better:
            ids = [view.pose.drone_id for view in views]
            self._events.publish(Noted("warning", _order_text(ids, better, self._label)))

    def _label(self, drone_id: str) -> str:
        return self._drones[drone_id].config.label

    def _views(self, crew: tuple[str, ...]) -> list[View]:
        views: list[View] = []
        for drone_id in crew:
            sight = self._eyes[drone_id].sight
            if sight is None or sight.region is None or sight.box is None:
                continue
            if self._clock() - sight.frame.captured_s > _FRESH_S:
                continue
            pose = self._pilot.pose(drone_id, sight.frame.captured_s)
            camera = self._drones[drone_id].config.intrinsics
            views.append(View(pose, camera, sight.box, sight.region))
        return views

    def _tell(self, drone_ids: tuple[str, ...], reason: str) -> None:
        if drone_ids == self._told.drone_ids:
            return
        self._told = ViewsDisagree(drone_ids, reason)
        self._events.publish(self._told)
        if not drone_ids:
            self._events.publish(Noted("info", "The drones' views agree on one object again."))
            return
        names = ", ".join(map(self._label, drone_ids))
        text = (
            f"The views disagree ({names}). {reason} Look at the outlines; where one is wrong, pick"
            " the object on that tile."
        )
        drone_id = drone_ids[0] if len(drone_ids) == 1 else None
        self._events.publish(Noted("warning", text, drone_id))


def _order_text(ids: list[str], better: list[Arrangement], label: Callable[[str], str]) -> str:
    """Return what the operator reads when the outlines speak for other orders."""
    orders = []
    for arrangement in better:
        moved = [
            f"{label(drone_id)} at the place of {label(ids[place])}"
            for drone_id, place in zip(ids, arrangement.places, strict=True)
            if ids[place] != drone_id
        ]
        orders.append(", ".join(moved))
    return (
        "The drones seem to stand in another order than assumed, by the outlines of the object: "
        + "; or ".join(orders)
        + ". Land, put them at their places and start again, or the model will be wrong."
    )
