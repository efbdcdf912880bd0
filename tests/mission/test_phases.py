import pytest
from hypothesis import given
from hypothesis import strategies as st

from server.mission.phases import AIRBORNE, Phase, Progress


def test_course_of_a_two_round_mission():
    place, course = Progress.start(2), []
    while not place.over:
        course.append(place.phase)
        place = place.advance()
    assert course == [
        Phase.PREFLIGHT,
        Phase.TAKE_OFF,
        Phase.CENTRE,
        Phase.SEED,
        Phase.PLAN,
        *[Phase.FLY, Phase.TUNE, Phase.CAPTURE] * 2,
        Phase.LAND,
        Phase.TRAIN,
    ]
    assert place.phase is Phase.DONE


@given(rounds=st.integers(1, 6), steps=st.integers(0, 40))
def test_an_abort_lands_whatever_is_in_the_air_and_then_ends(rounds, steps):
    place = Progress.start(rounds)
    for _ in range(steps):
        if place.over:
            return
        place = place.advance()
    if place.over:
        return
    ended = place.end("operator")
    if place.phase in AIRBORNE:
        assert ended.phase is Phase.LAND
        ended = ended.advance()
    assert ended.phase is Phase.ENDED
    assert ended.ending == "operator"


@given(rounds=st.integers(1, 6))
def test_progress_grows_to_one(rounds):
    place, last = Progress.start(rounds), -1.0
    while not place.over:
        assert last < place.fraction() <= 1.0
        last = place.fraction()
        place = place.advance()
    assert place.fraction() == 1.0


def test_pause_keeps_the_place_and_refuses_to_advance():
    flying = Progress.start(1)
    for _ in range(5):
        flying = flying.advance()
    paused = flying.pause()
    assert paused.phase is flying.phase
    with pytest.raises(ValueError, match="paused"):
        paused.advance()
    assert paused.resume() == flying


@pytest.mark.parametrize("phase", [Phase.PREFLIGHT, Phase.TAKE_OFF, Phase.LAND, Phase.TRAIN])
def test_phases_that_cannot_wait(phase):
    with pytest.raises(ValueError, match="cannot pause"):
        Progress(phase, 0, 1).pause()


def test_first_reason_of_ending_stays():
    place = Progress(Phase.FLY, 0, 1).end("battery").end("operator")
    assert place.ending == "battery"
