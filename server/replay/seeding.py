"""The seed geometry of a recorded flight, as ``server.mission.seeding`` makes it in flight.

Views are taken when the flight asked for them, and the pilot gets a geometry when it had one: how
long carving took then is part of the flight.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from server.geometry.axes import wrap_angle
from server.mission.eyes import Sight
from server.mission.pilot import SEED_AZIMUTH_RAD, Pilot
from server.mission.seeding import is_new, refined_seed, seen_view
from server.replay.recorded_fleet import RecordedEye, RecordedFleet
from server.stages import SeedGeometry, View
from server.vision.config import SeedConfig
from server.vision.seed import SeedError, seed_from_views

_QUARTER_TURN = np.pi / 2.0


@dataclass(slots=True)
class _Looking:
    """How far one drone has looked around.

    Attributes:
        given: Views it has given.
        sequence: Number of the picture of the newest of them.
    """

    given: int = 0
    sequence: int = -1


class RecordedSeeding:
    """Collects views and makes the seed geometry of them.

    Attributes:
        seeds: Every geometry that the pilot got, in order.
    """

    def __init__(
        self,
        fleet: RecordedFleet,
        eyes: Mapping[str, RecordedEye],
        pilot: Pilot,
        config: SeedConfig,
    ) -> None:
        self.seeds: list[SeedGeometry] = []
        self._fleet = fleet
        self._eyes = eyes
        self._pilot = pilot
        self._config = config
        self._views: list[View] = []
        # Views of the round being photographed, which count once it is over.
        self._of_round: list[View] = []
        self._photographed: set[str] = set()
        # Looking around for the first geometry.
        self._asked_s = 0.0
        self._looking: dict[str, _Looking] = {}
        self._wanted = 0
        self._first: SeedGeometry | None = None
        self._beyond = 0  # So many more views than in flight the first geometry took.

    # The first geometry ----------------------------------------------------------------------

    def begin(self, at_s: float) -> None:
        """Let the crew look around from four sides, in turn with fewer than four drones."""
        crew = self._fleet.crew
        self._asked_s = at_s
        self._looking = {drone_id: _Looking() for drone_id in crew}
        self._wanted = -(-4 // len(crew)) if crew else 0
        self.look()

    def look(self) -> None:
        """Keep what those who look around see now, where it is their turn to give a view."""
        for drone_id, looking in self._looking.items():
            self._take_view(drone_id, looking)
        if self._first is None and self._looking:
            if any(looking.given < self._wanted for looking in self._looking.values()):
                return
            try:
                self._first = seed_from_views(tuple(self._views), self._config)
            except SeedError:
                # A picture more of each may show what these did not.
                self._wanted += 1

    def conclude(self) -> str | None:
        """End the looking around; returns why it has given no geometry, or None."""
        if not self._looking:
            return None
        try:
            self._fit()
        except SeedError as error:
            return str(error)
        finally:
            self._looking = {}
        return None

    def _fit(self) -> None:
        """Give the pilot the first geometry; raises SeedError when the views make none."""
        self.look()
        seed = self._first
        self._adopt(seed_from_views(tuple(self._views), self._config) if seed is None else seed)
        self._looking = {}

    def _take_view(self, drone_id: str, looking: _Looking) -> None:
        sight = self._eyes[drone_id].sight
        if looking.given >= self._wanted or sight is None or not is_new(sight, self._asked_s):
            return
        view = self._view(drone_id, sight)
        if view is None or sight.frame.sequence <= looking.sequence:
            return
        turn = min(looking.given, -(-4 // len(self._looking)) - 1)
        if turn > 0 and not self._stands_at(drone_id, view, turn):
            return
        looking.given, looking.sequence = looking.given + 1, sight.frame.sequence
        self._views.append(view)

    def _stands_at(self, drone_id: str, view: View, turn: int) -> bool:
        """Return whether a view was taken as many quarter turns on as ``turn`` says."""
        wanted_rad = self._pilot.start_azimuth_rad(drone_id) + turn * _QUARTER_TURN
        offset = view.pose.position_world - self._pilot.target().centre
        azimuth_rad = float(np.arctan2(offset[1], offset[0]))
        return abs(wrap_angle(azimuth_rad - wanted_rad)) < SEED_AZIMUTH_RAD

    # Rounds ----------------------------------------------------------------------------------

    def photographed(self, drone_id: str) -> None:
        """Note that a picture was taken: what the drone sees by then votes along."""
        self._photographed.add(drone_id)
        # Once the last picture of a round is there, the flight asks all who took one.
        sights = {d: self._eyes[d].sight for d in sorted(self._photographed)}
        seen = (self._view(d, sight) for d, sight in sights.items() if sight is not None)
        self._of_round = [view for view in seen if view is not None]

    def end_round(self) -> None:
        """Note that nobody takes a picture in this round any more."""
        self._views += self._of_round
        self._of_round = []
        self._photographed.clear()

    # What the flight made of it --------------------------------------------------------------

    def fitted(self, views: int) -> None:
        """Give the pilot a geometry, as in flight now, from the first ``views`` of all views."""
        if self._pilot.seed is None:
            try:
                self._fit()
            except SeedError:
                return  # There will be more views.
            self._beyond = self.seeds[-1].views - views
            return
        known = (*self._views, *self._of_round)[: views + self._beyond]
        refined = refined_seed(self._pilot.seed, known, self._config)
        if refined is not None:
            self._adopt(refined)

    def _adopt(self, seed: SeedGeometry) -> None:
        self._pilot.seed = seed
        self.seeds.append(seed)

    def _view(self, drone_id: str, sight: Sight) -> View | None:
        pose = self._pilot.pose(drone_id, sight.frame.captured_s)
        return seen_view(sight, pose, self._fleet.drones[drone_id].config.intrinsics)
