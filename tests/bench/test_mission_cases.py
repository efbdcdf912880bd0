"""The bench's missions: each fault, in each of its phases, under each loss, on every scene."""

from __future__ import annotations

from collections import Counter

from server.bench.missions.cases import CONSOLE_FAULTS, DRONE_FAULTS, LOSSES, cases

SCENES = ("a", "b", "c", "d")


def test_every_fault_strikes_in_each_of_its_phases_under_each_loss() -> None:
    faulted = [case for case in cases(SCENES, 0) if case.fault]
    assert len(faulted) >= 500
    flown = {(case.fault, case.phase, case.loss) for case in faulted}
    for fault, phases in (DRONE_FAULTS | CONSOLE_FAULTS).items():
        assert {(fault, phase, loss) for phase in phases for loss in LOSSES} <= flown


def test_no_scene_is_bound_to_one_loss() -> None:
    pairs = Counter((case.scene, case.loss) for case in cases(SCENES, 0) if case.fault)
    assert len(pairs) == len(SCENES) * len(LOSSES)
    assert max(pairs.values()) - min(pairs.values()) <= 1


def test_each_mission_has_a_name_and_a_seed_of_its_own() -> None:
    made = cases(SCENES, 7)
    assert len({case.name for case in made}) == len(made)
    assert len({case.seed for case in made}) == len(made)
