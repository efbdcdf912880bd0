"""The seed geometry of one mission: fitted from the first look around, refined while flying on.

Carving takes a second of work, on a busy machine ten, so it runs in a thread: it never delays a
stop, and nobody hovers for it but at the beginning, when there is no geometry to fly by yet.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

from server.geometry.cameras import Intrinsics
from server.mission.config import MissionConfig
from server.mission.events import EventStream, SeedFitted
from server.mission.eyes import Eye, Sight
from server.mission.pilot import Pilot
from server.mission.state import MissionState
from server.stages import CameraPose, SeedGeometry, View
from server.swarm.fleet import Fleet
from server.vision.config import SeedConfig
from server.vision.seed import kept_within, refine_seed, seed_from_views

_LOG = logging.getLogger(__name__)

_POLL_S = 0.1


class Seeding:
    """Collects views and makes the seed geometry of them."""

    def __init__(
        self,
        state: MissionState,
        fleet: Fleet,
        eyes: Mapping[str, Eye],
        pilot: Pilot,
        events: EventStream,
        config: SeedConfig,
        waits: MissionConfig,
    ) -> None:
        self._state = state
        self._fleet = fleet
        self._eyes = eyes
        self._pilot = pilot
        self._events = events
        self._config = config
        self._waits = waits
        self._refining: asyncio.Task[None] | None = None

    async def add_views(self) -> None:
        """Keep the next view of every drone of the crew."""
        await asyncio.gather(*(self._add_view(drone_id) for drone_id in self._state.crew))

    async def fit(self) -> None:
        """Fit the geometry from the views so far.

        Raises:
            SeedError: If they make none.
        """
        self._state.seed = await asyncio.to_thread(
            seed_from_views, tuple(self._state.views), self._config
        )
        self._publish()

    def refine(self, taken: Collection[str]) -> None:
        """Let what these drones see now vote along; returns at once.

        While an earlier refinement is at work the views wait for it and are then taken together.
        """
        seen = [view for drone_id in sorted(taken) if (view := self._view_now(drone_id))]
        self._state.views.extend(seen)
        if self._state.seed is not None and seen and self._refining is None:
            self._refining = asyncio.create_task(self._refine(), name="refine seed")
            self._refining.add_done_callback(self._refined)

    async def settle(self) -> None:
        """Wait for the refinement at work, if any."""
        if self._refining is not None:
            await asyncio.wait([self._refining])

    def stop(self) -> None:
        """End the refinement at work: its mission is over."""
        if self._refining is not None:
            self._refining.cancel()

    async def _refine(self) -> None:
        state = self._state
        assert state.seed is not None
        while state.seed.views < len(state.views):
            views = tuple(state.views)
            refined = await asyncio.to_thread(refined_seed, state.seed, views, self._config)
            if refined is None:
                return
            # The operator may have set priorities meanwhile.
            state.seed = replace(refined, priorities=state.seed.priorities)
            self._publish()

    def _refined(self, task: asyncio.Task[None]) -> None:
        self._refining = None
        if not task.cancelled() and (error := task.exception()) is not None:
            _LOG.error("the seed geometry was not refined", exc_info=error)

    def _publish(self) -> None:
        assert self._state.seed is not None
        self._pilot.seed = self._state.seed
        self._events.publish(SeedFitted(self._state.seed))

    async def _add_view(self, drone_id: str) -> None:
        """Wait for a picture that shows the object; longer while data is missing in pictures."""
        loop = asyncio.get_running_loop()
        begun_s = loop.time()
        patience_s = self._waits.picture_timeout_s
        while loop.time() - begun_s < patience_s:
            sight = self._eyes[drone_id].sight
            if sight is not None and is_new(sight, begun_s):
                if sight.frame.damaged:
                    patience_s = self._waits.whole_picture_timeout_s
                elif (view := self._view(drone_id, sight)) is not None:
                    self._state.views.append(view)
                    return
            await asyncio.sleep(_POLL_S)

    def _view_now(self, drone_id: str) -> View | None:
        sight = self._eyes[drone_id].sight
        return None if sight is None else self._view(drone_id, sight)

    def _view(self, drone_id: str, sight: Sight) -> View | None:
        pose = self._pilot.pose(drone_id, sight.frame.captured_s)
        return seen_view(sight, pose, self._fleet.drones[drone_id].config.intrinsics)


def is_new(sight: Sight, asked_s: float) -> bool:
    """Return whether a sight may be the view that was asked for at ``asked_s``."""
    return sight.frame.captured_s >= asked_s - _POLL_S


def seen_view(sight: Sight, pose: CameraPose, intrinsics: Intrinsics) -> View | None:
    """Return a sight as the geometry needs it, None when it is damaged or shows no object.

    Args:
        sight: What was seen.
        pose: The camera's pose when it was.
        intrinsics: The camera.
    """
    if sight.frame.damaged or sight.region is None or sight.box is None:
        return None
    return View(pose, intrinsics, sight.box, sight.region)


def refined_seed(
    seed: SeedGeometry, views: Sequence[View], config: SeedConfig
) -> SeedGeometry | None:
    """Return the geometry that all ``views`` so far make of ``seed``, None when they make none.

    The outer box stays: the planned viewpoints keep clear of that one, and a wall that moves must
    not come upon a drone that hovers beside it.
    """
    refined = refine_seed(seed, views, config)
    return None if refined.views <= seed.views else kept_within(refined, seed.outer)
