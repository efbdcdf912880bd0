"""Whole missions in virtual time: they repeat exactly, and what goes wrong ends well."""

from __future__ import annotations

from dataclasses import asdict

import pytest

from server.bench.missions.cases import CONSOLE_FAULTS, DRONE_FAULTS, LOSSES, Case, cases
from server.bench.missions.measure import summary
from server.bench.missions.outcome import Outcome
from server.bench.missions.virtual_flight import fly_in_virtual_time
from server.sim.faults import parse_fault

pytestmark = pytest.mark.slow


def fly(fault: str = "", phase: str = "", *, loss: float = 0.0, seed: int = 5) -> Outcome:
    return fly_in_virtual_time(Case("robot_dog", seed, loss, fault, phase, pictures=8))


def assert_nobody_was_hurt(outcome: Outcome) -> None:
    assert outcome.collisions == 0
    assert outcome.fence_violations == 0
    assert not outcome.unsafe_end


def test_a_case_repeats_exactly() -> None:
    first, again = asdict(fly(loss=0.1)), asdict(fly(loss=0.1))
    first.pop("wall_s")
    again.pop("wall_s")
    assert first == again


def test_a_mission_with_a_tenth_of_all_datagrams_lost_is_completed() -> None:
    outcome = fly(loss=0.1, seed=9)
    assert outcome.state == "succeeded"
    assert outcome.images == 8
    assert_nobody_was_hurt(outcome)


def test_the_others_take_over_from_a_drone_that_falls_out_of_the_air() -> None:
    outcome = fly("power_cut", "fly")
    assert outcome.state == "succeeded"
    assert outcome.images == 8
    assert list(outcome.dropped) == [outcome.onset]
    assert_nobody_was_hurt(outcome)


def test_after_hold_rearm_and_resume_the_capture_is_completed() -> None:
    outcome = fly("hold_all", "fly")
    assert outcome.state == "succeeded"
    assert outcome.images == 8
    assert_nobody_was_hurt(outcome)


def test_a_capture_that_was_landed_waits_and_is_resumed() -> None:
    outcome = fly("land_all", "fly")
    assert outcome.state == "succeeded"
    assert outcome.images == 8
    assert outcome.seconds["grounded"] > 5.0
    assert_nobody_was_hurt(outcome)


def test_a_link_that_dies_in_flight_makes_the_failsafe_land() -> None:
    outcome = fly("loss=1.0", "fly")
    assert outcome.state == "succeeded"
    actions = [r.action for r in outcome.reactions if r.event == "state_age_s"]
    assert actions == ["hold", "land"]
    assert_nobody_was_hurt(outcome)


@pytest.mark.parametrize("phase", ["take_off", "fly"])
@pytest.mark.parametrize("fault", ["abort", "abort_twice"])
def test_an_abort_lands_everybody_whenever_it_comes(fault: str, phase: str) -> None:
    outcome = fly(fault, phase)
    assert outcome.happened
    assert outcome.state == "aborted"
    assert_nobody_was_hurt(outcome)


def test_hold_during_the_take_off_waits_for_the_operator() -> None:
    outcome = fly("hold_all", "take_off")
    assert outcome.state == "succeeded"
    assert outcome.images == 8
    assert_nobody_was_hurt(outcome)


def test_a_planner_that_hangs_is_not_waited_for() -> None:
    outcome = fly("planner_hangs", "plan")
    assert outcome.state == "succeeded"
    assert outcome.images == 8


def test_there_are_enough_cases_and_the_simulator_knows_every_fault() -> None:
    wanted = cases(["human", "guitar"], 0)
    assert len(wanted) >= 500
    assert len({case.name for case in wanted}) == len(wanted)
    for fault in DRONE_FAULTS:
        parse_fault(fault)
    tried = {(case.fault, case.phase, case.loss) for case in wanted}
    for fault, phases in (DRONE_FAULTS | CONSOLE_FAULTS).items():
        assert all((fault, phase, loss) in tried for phase in phases for loss in LOSSES)


def test_the_summary_counts_what_happened() -> None:
    outcome = fly()
    figures = summary([outcome, outcome])
    assert figures["missions"] == 2
    assert figures["completed"] == 2
    assert figures["images"] == 16
    assert figures["collisions"] == 0
    assert figures["real_udp_missions"] == 0


@pytest.mark.parametrize(
    "case",
    [
        # One lands where nobody believed it, and another on top of it.
        Case("guitar", 234, 0.05, "no_valid_imu", "fly"),
        # One flies on with its last sticks, along an arc that leads to another.
        Case("guitar", 94, 0.05, "loss=1.0", "capture"),
        # One falls where it loses its power, and is believed to have flown on.
        Case("robot_dog", 175, 0.1, "reboot", "fly"),
        # One that the wind drives out of the fence while it lands, which nobody can steer.
        Case("human", 337, 0.0, "drift_away=0.4", "tune"),
        # One that has lost its hold is told to go so slowly that it might really stand.
        Case("human", 221, 0.0, "no_valid_imu", "centre"),
        # What is always cut by the pictures' edges says too little of how far away it is.
        Case("human", 73, 0.0, "loss=1.0", "centre"),
    ],
    ids=lambda case: case.name,
)
def test_what_once_ended_badly_ends_well(case: Case) -> None:
    outcome = fly_in_virtual_time(case)
    assert outcome.happened
    assert outcome.state == "succeeded"
    assert_nobody_was_hurt(outcome)
