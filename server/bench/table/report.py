"""``results.md``: the table with its plots and pictures, as it stands in ``docs/``.

Everything it links to lies in the folder ``results`` beside it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from server.bench.options import Figures, Options
from server.bench.table.modes import EVERY_MODE
from server.bench.table.parts import Wanted, strip_file
from server.bench.table.plots import bars, lines

# The paper's table I: PSNR and SSIM, standard and optimised.
PAPER = {
    "human": {"standard": (11.30, 0.43), "optimized": (18.93, 0.66)},
    "guitar": {"standard": (8.89, 0.29), "optimized": (17.67, 0.56)},
    "robot_dog": {"standard": (10.18, 0.40), "optimized": (22.72, 0.70)},
    "recycle_bin": {"standard": (9.26, 0.34), "optimized": (20.13, 0.67)},
}
LEAST_GAIN_DB, AIMED_GAIN_DB = 1.0, 3.0
_ROWS = ("standard_paper", "standard_refined", "optimized", "truth")
_MEASURES = (
    "PSNR",
    "SSIM",
    "FLIP",
    "PSNR object",
    "pictures",
    "surface seen",
    "flight s",
    "wall s",
)


class Report:
    """Writes the results of one bench."""

    def __init__(
        self,
        figures: Figures,
        found: Mapping[str, Any],
        options: Options,
        flights: Sequence[Wanted],
    ) -> None:
        """Build it.

        Args:
            figures: What was measured.
            found: The conditions it was measured under.
            options: What was asked.
            flights: The flights whose pictures are shown, two of every scene.
        """
        assert options.out is not None
        self._figures = figures
        self._found = found
        self._options = options
        self._flights = flights
        self._out = options.out
        self._folder = options.out / "results"

    def write(self) -> None:
        """Write ``results.md`` and what it links to."""
        self._folder.mkdir(parents=True, exist_ok=True)
        sections = [
            self._head(),
            self._table(),
            self._differences(),
            self._reach(),
            self._curves(),
            self._ablations(),
            self._pictures(),
        ]
        text = "\n\n".join(section for section in sections if section)
        (self._out / "results.md").write_text(text + "\n")

    def _head(self) -> str:
        found, first = self._found, self._flights[0]
        scenes = "" if self._options.scenes == tuple(PAPER) else self._scene_options()
        command = f"dronerf bench table1 --json --out DIR --seed {self._options.seed}" + scenes
        command += " --quick" if self._options.quick else ""
        command += "".join(f" --pictures {n}" for n in self._options.pictures)
        command += "".join(f" --drones {n}" for n in self._options.drones)
        command += " --ablations" if self._options.ablations else ""
        gpu = found["gpu"] or "none"
        measured = ", ".join(f"`{at}` ({count})" for at, count in found["measured_at"].items())
        return "\n".join(
            [
                "# Results",
                "",
                f"Written by `{command}` at commit `{found['commit']}` on {found['cpu']},"
                f" {found['cores']} cores, GPU {gpu}, Python {found['python']}."
                f" Flights were measured at {measured}.",
                "",
                f"Every flight: {first.drones} simulated drones, {first.pictures} pictures; every"
                f" field: {first.steps} training steps; judged on the same {first.views} test views"
                " that no mode has seen. PSNR in dB, means over seeds ± standard deviation;"
                " FLIP: smaller is better; *object*: inside the true silhouette.",
            ]
        )

    def _scene_options(self) -> str:
        return "".join(f" --scene {scene}" for scene in self._options.scenes)

    def _table(self) -> str:
        rows: list[tuple[str, ...]] = []
        for scene, part in [*self._figures.scenes.items(), ("all", self._figures.overall)]:
            modes = [mode for mode in EVERY_MODE if mode in part]
            rows += [(_name(scene), mode, *_cells(part[mode])) for mode in modes]
            rows += [
                (_name(scene), f"*paper's {kind}*", f"{psnr:.2f}", f"{ssim:.2f}")
                for kind, (psnr, ssim) in PAPER.get(scene, {}).items()
            ]
        (self._folder / "psnr_object.svg").write_text(self._bars("psnr_db_object", {}))
        paper = {scene: told["optimized"][0] for scene, told in PAPER.items()}
        (self._folder / "psnr.svg").write_text(self._bars("psnr_db", paper))
        return "\n".join(
            [
                "## The table",
                "",
                _markdown(("scene", "mode", *_MEASURES), rows),
                "",
                "![PSNR on the object](results/psnr_object.svg)",
                "",
                "![PSNR of whole pictures; dashed: the paper's optimized](results/psnr.svg)",
            ]
        )

    def _bars(self, figure: str, references: Mapping[str, float]) -> str:
        groups = {
            _name(scene): {
                mode: (part[mode][figure], part[mode][f"{figure}_sd"])
                for mode in EVERY_MODE
                if mode in part
            }
            for scene, part in self._figures.scenes.items()
        }
        where = "object" if figure.endswith("object") else "whole picture"
        drawn = {scene: value for scene, value in references.items() if scene in groups}
        return bars(f"PSNR in dB, {where}", groups, drawn)

    def _differences(self) -> str:
        rows = []
        for scene, part in [*self._figures.scenes.items(), ("all", self._figures.overall)]:
            for standard, by_figure in part["paired"].items():
                cells = [_difference(by_figure[name]) for name in by_figure]
                about = next(iter(by_figure.values()))
                rows.append((_name(scene), standard, *cells, f"{about['pairs']} ({about['over']})"))
        head = ("scene", "against", "PSNR", "SSIM", "FLIP", "PSNR object", "pairs")
        return "\n".join(
            [
                "## Optimized minus standard, paired",
                "",
                "Mean and 95 % interval over pairs of flights (Student's t); of a single pair, over"
                " its test views, which says nothing about other flights.",
                "",
                _markdown(head, rows),
            ]
        )

    def _reach(self) -> str:
        rows = []
        for scene, part in self._figures.scenes.items():
            gain = part["paired"].get("standard_refined", {}).get("psnr_db_object", {}).get("diff")
            mine, paper = part.get("optimized"), PAPER.get(scene)
            beats = "-"
            if mine is not None and paper is not None:
                psnr, ssim = paper["optimized"]
                beats = _yes(mine["psnr_db"] > psnr and mine["ssim"] > ssim)
            told = "-" if gain is None else f"{gain:+.2f} dB"
            reached = [
                "-" if gain is None else _yes(gain >= wanted)
                for wanted in (LEAST_GAIN_DB, AIMED_GAIN_DB)
            ]
            rows.append((_name(scene), beats, told, *reached))
        head = (
            "scene",
            "beats the paper's optimized (PSNR and SSIM)",
            "on the object, over standard_refined",
            f"at least {LEAST_GAIN_DB:g} dB",
            f"aim {AIMED_GAIN_DB:g} dB",
        )
        failed = self._figures.overall.get("failed_flights", {})
        lost = [f"* Flight {name} failed and counts nowhere: {why}" for name, why in failed.items()]
        return "\n".join(
            ["## What was to be reached", "", _markdown(head, rows), "", *lost]
        ).rstrip()

    def _curves(self) -> str:
        told = self._figures.overall.get("curves")
        if told is None:
            return ""
        lines_ = [f"## Curves\n\nOne seed, {_names(told['scenes'])}."]
        for what in ("pictures", "drones"):
            if not told[what]:
                continue
            rows = [
                (count, mode, *_cells(figures))
                for count, by_mode in told[what].items()
                for mode, figures in by_mode.items()
            ]
            series: dict[str, list[tuple[float, float]]] = {}
            for count, by_mode in told[what].items():
                for mode, figures in by_mode.items():
                    series.setdefault(mode, []).append((int(count), figures["psnr_db_object"]))
            plot = lines(f"PSNR in dB on the object, by {what}", series)
            (self._folder / f"{what}.svg").write_text(plot)
            lines_ += [
                _markdown((what, "mode", *_MEASURES), rows),
                f"![By {what}](results/{what}.svg)",
            ]
        return "\n\n".join(lines_)

    def _ablations(self) -> str:
        told = self._figures.overall.get("ablations")
        if told is None:
            return ""
        rows = [(without, *_cells(figures)) for without, figures in told["without"].items()]
        about = f"## Without each part\n\nOptimized, one seed, {_names(told['scenes'])}."
        return "\n\n".join([about, _markdown(("without", *_MEASURES), rows)])

    def _pictures(self) -> str:
        sheets: list[str] = []
        for scene in dict.fromkeys(wanted.scene for wanted in self._flights):
            strips = self._strips([one for one in self._flights if one.scene == scene])
            if strips:
                sheets.append(_markdown((_name(scene), "test views"), strips))
        if not sheets:
            return ""
        head = "## Pictures\n\nFour of the test views of the first seed, from low to high."
        return "\n\n".join([head, *sheets])

    def _strips(self, flights: Sequence[Wanted]) -> list[tuple[str, str]]:
        """Return the kept renderings of a scene's modes, and their truth, by name."""
        found: list[tuple[str, str]] = []
        for what in _ROWS:
            flight = next((one for one in flights if what in one.modes), flights[0])
            file = strip_file(self._out, flight, what)
            if file.is_file():
                link = file.relative_to(self._out).as_posix()
                found.append((what, f"![{_name(flight.scene)}, {what}]({link})"))
        return found


def _cells(figures: Mapping[str, Any]) -> tuple[str, ...]:
    return (
        _with_sd(figures, "psnr_db", 2),
        _with_sd(figures, "ssim", 3),
        _with_sd(figures, "flip", 3),
        _with_sd(figures, "psnr_db_object", 2),
        f"{figures['images']:g}",
        f"{100.0 * figures['surface_seen']:.1f} %",
        f"{figures['flight_s']:.0f}",
        f"{figures['wall_s']:.0f}",
    )


def _with_sd(figures: Mapping[str, Any], name: str, digits: int) -> str:
    value, sd = figures[name], figures[f"{name}_sd"]
    return f"{value:.{digits}f}" + ("" if sd is None else f" ± {sd:.{digits}f}")


def _difference(about: Mapping[str, Any]) -> str:
    if about["ci"] is None:
        return f"{about['diff']:+.3f}"
    low, high = about["ci"]
    return f"{about['diff']:+.3f} [{low:+.3f}, {high:+.3f}]"


def _name(scene: str) -> str:
    return Path(scene).stem


def _names(scenes: Sequence[str]) -> str:
    return "scenes " + ", ".join(map(_name, scenes))


def _yes(met: bool) -> str:
    return "yes" if met else "**no**"


def _markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    filled = [[*row, *[""] * (len(head) - len(row))] for row in rows]
    return "\n".join(f"| {' | '.join(row)} |" for row in [head, ["---"] * len(head), *filled])
