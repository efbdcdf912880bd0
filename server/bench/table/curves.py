"""How many pictures, and how many drones, are worth it: the table's flights with other counts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from server.bench.table.figures import mode_figures
from server.bench.table.parts import Parts, Wanted

# The two that know their poses alike: one per flight.
_COMPARED = ("standard_refined", "optimized")


def curves(
    parts: Parts,
    flights: Sequence[Sequence[Wanted]],
    pictures: Sequence[int],
    drones: Sequence[int],
) -> dict[str, Any]:
    """Return ``{pictures: {count: {mode: figures}}, drones: ...}``, means over scenes.

    Args:
        parts: Where flights are measured.
        flights: The table's own flights of each scene; those with the usual counts are not flown
            again.
        pictures: Counts of pictures with the usual drones.
        drones: Counts of drones with the usual pictures.
    """
    return {
        "scenes": [of_scene[0].scene for of_scene in flights],
        "pictures": _curve(parts, flights, "pictures", pictures),
        "drones": _curve(parts, flights, "drones", drones),
    }


def _curve(
    parts: Parts, flights: Sequence[Sequence[Wanted]], what: str, counts: Sequence[int]
) -> dict[str, Any]:
    curve: dict[str, Any] = {}
    for count in sorted(set(counts)):
        samples: dict[str, list[Any]] = {mode: [] for mode in _COMPARED}
        for wanted in (one for of_scene in flights for one in of_scene):
            same = getattr(wanted, what) == count
            modes = wanted.modes if same else tuple(m for m in wanted.modes if m in _COMPARED)
            part = parts.measured(replace(wanted, modes=modes, **{what: count}))
            for mode in _COMPARED:
                if mode in part["samples"]:
                    samples[mode].append(part["samples"][mode])
        curve[str(count)] = {mode: mode_figures(some) for mode, some in samples.items() if some}
    return curve
