"""Parts of the table: kept, read again, and what their report makes of them."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest

from server.bench import table1
from server.bench.options import Options
from server.bench.poses_flight import usual_config
from server.bench.table.ablations import ABLATIONS, ablations
from server.bench.table.curves import curves
from server.bench.table.fields import FIGURES
from server.bench.table.leave_out import left_out
from server.bench.table.modes import EVERY_MODE
from server.bench.table.parts import Parts, Wanted, strip_file

LEVEL = {
    "standard_paper": 12.0,
    "standard_refined": 20.0,
    "optimized": 23.0,
    "optimized_true_poses": 24.0,
}


def made_up(wanted: Wanted) -> dict[str, Any]:
    rng = np.random.default_rng([wanted.seed, wanted.pictures, wanted.drones])
    flight = rng.normal(0.0, 0.1)
    return {
        "samples": {
            mode: {
                "per_view": {
                    name: (LEVEL[mode] + flight + rng.normal(0.0, 0.1, 10)).tolist()
                    for name in FIGURES
                },
                "images": wanted.pictures,
                "images_used": wanted.pictures,
                "surface_seen": 0.9,
                "flight_s": 120.0,
                "wall_s": 300.0,
                "settled_deg": 0.5,
            }
            for mode in wanted.modes
        }
    }


class MadeUpParts(Parts):
    """Measures nothing, and remembers what it was to measure."""

    asked: list[str]

    def _measure(self, wanted: Wanted, shown: bool) -> dict[str, Any]:
        self.asked = [*getattr(self, "asked", []), wanted.name]
        if shown and self._out is not None:
            for what in (*wanted.modes, "truth"):
                strip = np.full((8, 12, 3), 99, np.uint8)
                cv2.imwrite(str(strip_file(self._out, wanted, what)), strip)
        return made_up(wanted)


def wanted(seed: int = 0, **other: Any) -> Wanted:
    return Wanted(**({
        "scene": "guitar", "seed": seed, "flight": "optimized", "pictures": 24, "drones": 4,
        "steps": 9, "views": 10, "modes": ("optimized", "optimized_true_poses"),
    } | other))  # fmt: skip


def parts(out: Path, *, resume: bool) -> MadeUpParts:
    return MadeUpParts(out, resume=resume, threads=1, commit="abc")


def test_a_finished_part_is_read_again_and_one_of_something_else_is_not(tmp_path: Path) -> None:
    first = parts(tmp_path, resume=True)
    told = first.measured(wanted())
    first.measured(wanted())
    assert first.asked == ["guitar-0-optimized-24x4-9"]
    again = parts(tmp_path, resume=True)
    assert again.measured(wanted())["samples"] == told["samples"]
    assert not hasattr(again, "asked")
    again.measured(wanted(views=12))
    again.measured(wanted(seed=1))
    assert len(again.asked) == 2
    anew = parts(tmp_path, resume=False)
    anew.measured(wanted())
    assert len(anew.asked) == 1


def test_curves_fly_only_what_the_table_has_not(tmp_path: Path) -> None:
    some = parts(tmp_path, resume=False)
    flights = [[wanted(), wanted(flight="standard", modes=("standard_paper", "standard_refined"))]]
    for one in flights[0]:
        some.measured(one)
    told = curves(some, flights, pictures=(12, 24), drones=(4,))
    assert [name.split("-")[3] for name in some.asked] == ["24x4", "24x4", "12x4", "12x4"]
    assert list(told["pictures"]) == ["12", "24"]
    assert set(told["pictures"]["12"]) == {"standard_refined", "optimized"}
    assert told["pictures"]["12"]["optimized"]["images"] == 12


def test_ablations_leave_out_one_part_each_and_fly_nothing_twice(tmp_path: Path) -> None:
    some = parts(tmp_path, resume=False)
    flights = [[wanted(), wanted(flight="standard", modes=("standard_paper", "standard_refined"))]]
    some.measured(flights[0][0])
    told = ablations(some, flights)
    assert list(told["without"]) == ["nothing", *ABLATIONS[1:]]
    assert len(some.asked) == len(ABLATIONS)
    assert {name.split("-without-")[1] for name in some.asked[1:]} == set(ABLATIONS[1:])


@pytest.mark.parametrize("part", ABLATIONS)
def test_what_is_left_out_of_a_flight_is_that_part_alone(part: str) -> None:
    usual = usual_config()
    config = left_out(usual, part)
    changed = {
        "annealing": config.planner.annealing != usual.planner.annealing,
        "trim": config.mission != usual.mission,
        "uncertainty": config.planner.fitness != usual.planner.fitness,
    }
    assert {name for name, differs in changed.items() if differs} == {part} & set(changed)
    assert (config.vision, config.safety) == (usual.vision, usual.safety)


def test_the_whole_bench_adds_up_and_writes_its_report(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(table1, "Parts", MadeUpParts)
    scenes = ("human", "guitar")
    options = Options(
        scenes, 5, False, False, "", tmp_path, False, pictures=(12, 24), ablations=True
    )
    figures = table1.run(options)
    assert list(figures.scenes) == list(scenes)
    for part in (*figures.scenes.values(), figures.overall):
        assert [mode for mode in part if mode in EVERY_MODE] == list(EVERY_MODE)
        gain = part["paired"]["standard_refined"]["psnr_db_object"]
        assert gain["diff"] == pytest.approx(3.0, abs=0.4)
        assert gain["ci"][0] < gain["diff"] < gain["ci"][1]
    assert figures.scenes["human"]["paired"]["standard_paper"]["psnr_db"]["pairs"] == 3
    assert figures.overall["paired"]["standard_paper"]["psnr_db"]["pairs"] == 6
    text = (tmp_path / "results.md").read_text()
    mine = figures.scenes["guitar"]["optimized"]
    assert f"{mine['psnr_db']:.2f} ± {mine['psnr_db_sd']:.2f}" in text
    assert "17.67" in text  # The paper's own, beside it.
    assert "| annealing |" in text
    # Three seeds, a curve, and a mission without each part: flights of two scenes.
    assert re.search(r"measured at `[^`]+` \(26\)", text)
    linked = re.findall(r"\]\((results/[^)]+)\)", text)
    assert {Path(link).suffix for link in linked} == {".svg", ".jpg"}
    for link in linked:
        assert (tmp_path / link).is_file()
        if link.endswith(".svg"):
            ElementTree.parse(tmp_path / link)


def test_a_flight_that_failed_is_told_and_counts_nowhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Failing(MadeUpParts):
        def _measure(self, wanted: Wanted, shown: bool) -> dict[str, Any]:
            if (wanted.flight, wanted.seed) == ("standard", 1):
                return {"failed": "fell down", "samples": {}}
            return super()._measure(wanted, shown)

    monkeypatch.setattr(table1, "Parts", Failing)
    figures = table1.run(Options(("guitar",), 0, False, False, "", tmp_path, False))
    assert list(figures.overall["failed_flights"].values()) == ["fell down"]
    assert figures.scenes["guitar"]["paired"]["standard_paper"]["psnr_db"]["pairs"] == 2
    assert "fell down" in (tmp_path / "results.md").read_text()
