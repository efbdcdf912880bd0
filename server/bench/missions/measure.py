"""``dronerf bench mission``: flies all cases, keeps what is finished, adds up."""

from __future__ import annotations

import json
import logging
import multiprocessing
import sys
import time
from collections import defaultdict
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from server.bench.missions.cases import Case, cases, real_cases
from server.bench.missions.hold_latency import measure_hold
from server.bench.missions.outcome import Outcome, Reaction
from server.bench.missions.real_flight import fly_over_udp
from server.bench.missions.virtual_flight import fly_in_virtual_time
from server.bench.options import Figures, Options, each_scene

QUICK_SCENES = ("robot_dog", "recycle_bin")
_KEPT = "missions.jsonl"
_PRESSES = 500
_QUICK_REAL = 2


def run(options: Options) -> Figures:
    """Fly the missions in virtual time, then those over UDP, then press HOLD.

    The parts follow one another: those in real time need the machine to themselves.
    """
    log = Log(options.out, resume=options.resume)
    wanted = cases(options.scenes, options.seed, quick=options.quick)
    if options.only:
        return _replay([case for case in wanted if options.only in case.name])
    fly_virtual([c for c in wanted if options.faults or not c.fault], log, options.threads)
    real = real_cases(options.scenes, options.seed)
    if options.quick:
        real = real[:_QUICK_REAL]
    fly_real([c for c in real if options.faults or not c.fault], log)
    hold_ms = each_scene("hold", _hold_only(options), lambda _: measure_hold(_PRESSES))["press"]
    by_scene: dict[str, list[Outcome]] = defaultdict(list)
    for outcome in log.outcomes.values():
        by_scene[outcome.scene].append(outcome)
    pressed = {"hold_ms_p99": hold_ms["p99"], "hold_ms": hold_ms}
    return Figures(
        scenes={scene: summary(flown) | pressed for scene, flown in by_scene.items()},
        overall=summary(log.outcomes.values()) | pressed,
    )


def _replay(wanted: Sequence[Case]) -> Figures:
    """Fly a few cases in this process and tell all of each; what the console logs is seen."""
    flown = [fly_in_virtual_time(case) for case in wanted]
    return Figures({outcome.name: asdict(outcome) for outcome in flown}, summary(flown))


def _hold_only(options: Options) -> Options:
    # Presses know no scene; their figures are kept like those of one.
    return replace(options, scenes=("press",))


class Log:
    """Finished missions, one JSON object a line, so that a bench can be resumed."""

    def __init__(self, folder: Path | None, *, resume: bool) -> None:
        self._file = None if folder is None else folder / _KEPT
        self.outcomes: dict[str, Outcome] = {}
        if self._file is None:
            return
        self._file.parent.mkdir(parents=True, exist_ok=True)
        if not resume:
            self._file.unlink(missing_ok=True)
        elif self._file.exists():
            for line in self._file.read_text().splitlines():
                outcome = _outcome_from(json.loads(line))
                self.outcomes[_key(outcome)] = outcome

    def add(self, outcome: Outcome) -> None:
        """Keep one mission."""
        self.outcomes[_key(outcome)] = outcome
        if self._file is not None:
            with self._file.open("a") as stream:
                stream.write(json.dumps(asdict(outcome)) + "\n")

    def has(self, name: str, *, real_udp: bool = False) -> bool:
        """Return whether a mission of this name has been flown."""
        return f"{name}{'-udp' if real_udp else ''}" in self.outcomes


def fly_virtual(wanted: Sequence[Case], log: Log, processes: int) -> None:
    """Fly cases in virtual time, side by side; finished ones are skipped."""
    left = [case for case in wanted if not log.has(case.name)]
    if not left:
        return
    begun_s = time.monotonic()
    # A fresh interpreter each: what was imported here must not weigh on the flights.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(processes, context, initializer=_quiet) as pool:
        futures = {pool.submit(fly_in_virtual_time, case): case for case in left}
        for number, future in enumerate(as_completed(futures), 1):
            outcome = future.result()
            log.add(outcome)
            per_mission_s = (time.monotonic() - begun_s) / number
            print(
                f"{number}/{len(left)} {outcome.name}: {outcome.state}, {outcome.images} pictures,"
                f" {per_mission_s * (len(left) - number) / 60.0:.0f} min left",
                file=sys.stderr,
                flush=True,
            )


def fly_real(wanted: Sequence[Case], log: Log) -> None:
    """Fly cases over UDP in real time, one after the other; finished ones are skipped."""
    for case in wanted:
        if log.has(case.name, real_udp=True):
            continue
        outcome = fly_over_udp(case)
        log.add(outcome)
        text = f"{outcome.name} over UDP: {outcome.state}, {outcome.images} pictures"
        print(text, file=sys.stderr, flush=True)


def _quiet() -> None:
    # Drones that fall out of the air are the point of it, not news.
    logging.disable(logging.ERROR)


def summary(outcomes: Iterable[Outcome]) -> dict[str, Any]:
    """Return the bench's figures over ``outcomes``, see DESIGN's section on measurements."""
    flown = list(outcomes)
    seconds: dict[str, list[float]] = defaultdict(list)
    for outcome in flown:
        for phase, value in outcome.seconds.items():
            seconds[phase].append(value)
    plain = [o for o in flown if not o.fault and o.loss <= 0.1]
    return {
        "missions": len(flown),
        "real_udp_missions": sum(o.real_udp for o in flown),
        "faults_that_happened": sum(bool(o.fault) and o.happened for o in flown),
        "completed": sum(o.state == "succeeded" for o in flown),
        "completed_plain_up_to_10_pct_loss": f"{sum(o.state == 'succeeded' for o in plain)} of"
        f" {len(plain)}",
        "seconds": {phase: round(float(np.mean(all_s)), 1) for phase, all_s in seconds.items()},
        "wall_s": round(sum(o.wall_s for o in flown), 1),
        "images": sum(o.images for o in flown),
        "collisions": sum(o.collisions for o in flown),
        "min_separation_m": _least(o.min_separation_m for o in flown),
        "min_standoff_m": _least(o.min_standoff_m for o in flown),
        "fence_violations": sum(o.fence_violations for o in flown),
        "worst_excess_m": max((o.worst_excess_m for o in flown), default=None),
        "unsafe_ends": sum(o.unsafe_end for o in flown),
        "reaction_ms": _reactions(flown),
        "by_fault": _by_fault(flown),
    }


def _least(distances: Iterable[float | None]) -> float | None:
    return min((d for d in distances if d is not None), default=None)


def _reactions(flown: Sequence[Outcome]) -> dict[str, dict[str, float]]:
    """Return, per fault and action, how long the first reaction of the drone concerned took."""
    first: dict[str, list[float]] = defaultdict(list)
    for outcome in flown:
        seen: set[str] = set()
        for reaction in outcome.reactions:
            concerned = not outcome.onset or reaction.drone_id == outcome.onset
            if concerned and reaction.action not in seen:
                seen.add(reaction.action)
                first[f"{outcome.fault}: {reaction.event} {reaction.action}"].append(
                    reaction.after_ms
                )
    return {
        what: {
            "p50": round(float(np.percentile(all_ms, 50)), 1),
            "p95": round(float(np.percentile(all_ms, 95)), 1),
            "times": len(all_ms),
        }
        for what, all_ms in sorted(first.items())
    }


def _by_fault(flown: Sequence[Outcome]) -> dict[str, dict[str, Any]]:
    groups: dict[str, list[Outcome]] = defaultdict(list)
    for outcome in flown:
        groups[outcome.fault or f"loss {outcome.loss:g}"].append(outcome)
    return {
        fault: {
            "missions": len(group),
            "happened": sum(o.happened for o in group),
            "completed": sum(o.state == "succeeded" for o in group),
            "collisions": sum(o.collisions for o in group),
            "fence_violations": sum(o.fence_violations for o in group),
            "unsafe_ends": sum(o.unsafe_end for o in group),
            "min_separation_m": _least(o.min_separation_m for o in group),
        }
        for fault, group in groups.items()
    }


def _key(outcome: Outcome) -> str:
    return f"{outcome.name}{'-udp' if outcome.real_udp else ''}"


def _outcome_from(kept: dict[str, Any]) -> Outcome:
    reactions: Any = [Reaction(**one) for one in kept["reactions"]]
    return Outcome(**(kept | {"reactions": reactions}))
