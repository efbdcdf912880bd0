"""What each part of the method is worth: the mission as it is, with one part left out in turn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from server.bench.table.figures import mode_figures
from server.bench.table.parts import Parts, Wanted

# What is left out, in the order of the table: nothing first. How, says ``table.modes`` for what
# follows a flight and ``table.leave_out`` for the flight itself.
ABLATIONS = ("", "annealing", "trim", "uncertainty", "refinement", "masks")
_MODE = "optimized"


def ablations(parts: Parts, flights: Sequence[Sequence[Wanted]]) -> dict[str, Any]:
    """Return ``{scenes, without: {part: figures}}`` of the mode ``optimized``, means over scenes.

    Args:
        parts: Where flights are measured.
        flights: The table's own flights of each scene; what leaves out nothing is theirs.
    """
    flown = [one for of_scene in flights for one in of_scene if _MODE in one.modes]
    told: dict[str, Any] = {}
    for without in ABLATIONS:
        wanted = [
            replace(one, without=without, modes=(_MODE,)) if without else one for one in flown
        ]
        samples = [parts.measured(one)["samples"] for one in wanted]
        known = [by_mode[_MODE] for by_mode in samples if _MODE in by_mode]
        if known:
            told[without or "nothing"] = mode_figures(known)
    return {"scenes": [one.scene for one in flown], "without": told}
