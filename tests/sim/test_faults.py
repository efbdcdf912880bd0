"""Faults: how they are asked for, and the air they spoil."""

from __future__ import annotations

import itertools
import math
import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from server.sim.config import SimConfig
from server.sim.fault_plan import FaultPlan
from server.sim.faults import KINDS, Fault, faults_help, parse_fault
from server.sim.radio import Radio


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("loss=0.1", Fault("loss", 0.1)),
        ("loss", Fault("loss", 0.1)),
        ("loss_down=0.2@30+10:drone-2", Fault("loss_down", 0.2, 30.0, 10.0, "drone-2")),
        ("delay_up@air+3", Fault("delay_up", 0.2, 3.0, since="air")),
        ("reorder_down=0.3@5+1", Fault("reorder_down", 0.3, 5.0, 1.0)),
        ("duplicate_up:drone-2", Fault("duplicate_up", 0.1, drone="drone-2")),
        ("reboot@40:drone-1", Fault("reboot", 0.0, 40.0, math.inf, "drone-1")),
        ("power_cut@air+20", Fault("power_cut", at_s=20.0, since="air")),
        ("power_cut@air+20+5", Fault("power_cut", at_s=20.0, for_s=5.0, since="air")),
        ("power_cut@air", Fault("power_cut", since="air")),
        ("stays_down@air:drone-3", Fault("stays_down", drone="drone-3", since="air")),
        ("gust=0.8@air+12+3:drone-1", Fault("gust", 0.8, 12.0, 3.0, "drone-1", "air")),
        ("gust", Fault("gust", 0.5, for_s=2.0)),
        (" no_video@1.5+0.5 ", Fault("no_video", 0.0, 1.5, 0.5)),
        ("loss=0", Fault("loss", 0.0)),
    ],
)
def test_faults_in_one_word(text: str, fault: Fault) -> None:
    assert parse_fault(text) == fault


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("", "known|kinds"),
        ("lose=0.1", "no_valid_imu"),
        ("loss=1.1", "loss.*0 to 1"),
        ("loss=x", "no fault"),
        ("delay_down=11", "delay_down.*0 to 10"),
        ("duplicate_up=1.1", "duplicate_up.*0 to 1"),
        ("delay_sideways=1", "no fault"),
        ("loss=-1", "no fault"),
        ("loss=0.1@30+0", "for_s"),
        ("reboot=3", "reboot takes no amount"),
        ("reboot@3+4", "reboot has no duration"),
        ("loss @30", "no fault"),
        ("loss@ground+3", "no fault"),
        ("loss@air20", "no fault"),
        ("loss:drone 1", "no fault"),
        ("loss=0.1\nreboot", "no fault"),
    ],
)
def test_bad_words_are_refused_in_one_line(text: str, names: str) -> None:
    with pytest.raises(ValueError, match=names) as caught:
        parse_fault(text)
    assert "\n" not in str(caught.value)


@given(st.text(max_size=40))
def test_any_text_is_a_fault_or_a_value_error(text: str) -> None:
    try:
        fault = parse_fault(text)
    except ValueError:
        return
    assert fault.kind in KINDS


def test_a_simulation_refuses_faults_of_drones_it_has_not() -> None:
    with pytest.raises(ValueError, match=r"drone-9.*drone-1"):
        SimConfig(faults=(parse_fault("reboot:drone-9"),))


def test_help_names_every_kind() -> None:
    assert [line.split("=")[0].split()[0] for line in faults_help().splitlines()] == list(KINDS)


# The plan ----------------------------------------------------------------------------------------


def test_a_plan_begins_and_ends_its_faults_in_time() -> None:
    plan = FaultPlan([Fault("loss", 0.5, 10.0, 5.0), Fault("gust", 1.0, 2.0, 3.0, since="air")])
    plan.start(100.0)
    assert plan.due_s == 110.0
    assert plan.turn(109.9) == ([], [])
    begun, _ = plan.turn(110.0)
    assert [fault.kind for fault in begun] == ["loss"]
    assert plan.active("loss")
    plan.leave_ground(111.0)
    assert plan.due_s == 113.0
    plan.turn(113.0)
    headings = iter([math.pi / 2])
    x, y, z = plan.wind(lambda: next(headings))
    assert (x, y, z) == pytest.approx((0.0, 1.0, 0.0))
    assert plan.wind(lambda: next(headings)) == (x, y, z), "a wind keeps its direction"
    begun, ended = plan.turn(116.0)
    assert not begun
    assert {fault.kind for fault in ended} == {"loss", "gust"}
    assert plan.due_s == math.inf


def test_shares_add_up_as_independent_chances() -> None:
    plan = FaultPlan([Fault("loss", 0.5), Fault("loss", 0.2), Fault("loss_up", 0.25)])
    plan.start(0.0)
    plan.turn(0.0)
    assert plan.share("loss") == pytest.approx(0.6)
    assert plan.share("loss", "loss_up") == pytest.approx(0.7)
    assert plan.share("loss_down") == 0.0


def test_totals_are_sums() -> None:
    plan = FaultPlan([Fault("delay", 0.5), Fault("delay", 0.2), Fault("delay_down", 0.1)])
    plan.start(0.0)
    plan.turn(0.0)
    assert plan.total("delay") == pytest.approx(0.7)
    assert plan.total("delay", "delay_down") == pytest.approx(0.8)
    assert plan.total("delay_up") == 0.0


# The air -----------------------------------------------------------------------------------------


def through(radio: Radio[int], count: int, gap_s: float = 0.01) -> list[int]:
    """Send numbers; return them in order of arrival."""
    arrivals = [pair for n in range(count) for pair in radio.send(n, n * gap_s)]
    return [n for _, n in sorted(arrivals, key=lambda pair: pair[0])]


def test_clear_air_changes_nothing() -> None:
    radio: Radio[int] = Radio(random.Random(1), latency_s=0.02, jitter_s=0.03)
    assert through(radio, 500) == list(range(500)), "jitter alone never swaps datagrams"
    assert radio.lost == 0


@pytest.mark.parametrize("loss", [0.05, 0.2, 0.5])
def test_the_share_lost_is_the_share_asked_for(loss: float) -> None:
    radio: Radio[int] = Radio(random.Random(2))
    radio.loss = loss
    arrived = through(radio, 5000)
    # Five standard deviations of a binomial share.
    assert abs(1 - len(arrived) / 5000 - loss) < 5 * math.sqrt(loss * (1 - loss) / 5000)
    assert arrived == sorted(arrived)
    assert radio.lost == 5000 - len(arrived)


def test_duplicates_come_twice_and_none_is_lost() -> None:
    radio: Radio[int] = Radio(random.Random(3))
    radio.duplicate = 0.25
    arrived = through(radio, 4000)
    assert set(arrived) == set(range(4000))
    assert 0.21 < len(arrived) / 4000 - 1 < 0.29


def test_reordering_lets_later_ones_overtake() -> None:
    radio: Radio[int] = Radio(random.Random(4))
    radio.reorder = 0.1
    arrived = through(radio, 2000)
    assert sorted(arrived) == list(range(2000))
    overtaken = sum(a > b for a, b in itertools.pairwise(arrived))
    assert 100 < overtaken < 300


def test_a_delay_is_at_least_what_was_asked_for() -> None:
    radio: Radio[int] = Radio(random.Random(5))
    radio.delay_s = 0.4
    for n in range(200):
        ((arrive_s, _),) = radio.send(n, float(n))
        assert 0.4 <= arrive_s - n <= 0.51


def test_one_seed_gives_one_fate() -> None:
    fates = []
    for _ in range(2):
        radio: Radio[int] = Radio(random.Random(6))
        radio.loss, radio.duplicate, radio.reorder = 0.2, 0.2, 0.2
        fates.append(through(radio, 500))
    assert fates[0] == fates[1]
