"""Who is in command: one browser at a time, as long as it shows signs of life."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from server.api.lease import Lease, Standing

LAPSE_S = 10.0


def test_whoever_flies_first_is_in_command_and_others_are_not() -> None:
    lease = Lease(LAPSE_S)
    assert lease.admits("a", 0.0)
    assert lease.renew("a", 0.0)
    assert not lease.renew("b", 1.0)
    assert not lease.admits("b", 1.0)
    assert lease.admits("a", 1.0)


def test_the_command_lapses_with_its_holders_silence_alone() -> None:
    lease = Lease(LAPSE_S)
    lease.renew("a", 0.0)
    lease.renew("b", 9.0)  # Another browser's sign of life is none of the holder's.
    assert not lease.admits("b", 10.0)
    assert lease.admits("b", 10.1)
    assert lease.standing == Standing()


def test_it_is_asked_for_and_handed_over_or_kept() -> None:
    lease = Lease(LAPSE_S)
    lease.ask("b")
    assert lease.standing == Standing()  # Nobody has it: there is nobody to ask.
    lease.take("a", 0.0)
    lease.ask("a")
    assert lease.standing == Standing("a")
    lease.ask("b")
    lease.answer("c", True, 1.0)
    lease.answer("b", True, 1.0)
    assert lease.standing == Standing("a", "b")
    lease.answer("a", False, 1.0)
    assert lease.standing == Standing("a")
    lease.ask("b")
    lease.answer("a", True, 2.0)
    assert lease.standing == Standing("b")
    assert not lease.admits("a", 2.0)


def test_only_the_holder_takes_leave() -> None:
    lease = Lease(LAPSE_S)
    lease.take("a", 0.0)
    assert not lease.release("b")
    assert lease.release("a")
    assert not lease.release("a")


_acts = st.tuples(
    st.sampled_from(["renew", "take", "ask", "grant", "keep", "release", "lapse"]),
    st.sampled_from("abc"),
    st.floats(0.0, 12.0),
)


@given(st.lists(_acts, max_size=40))
def test_at_most_one_may_fly_while_anybody_is_in_command(
    acts: list[tuple[str, str, float]],
) -> None:
    lease, now_s = Lease(LAPSE_S), 0.0
    for act, client, pause_s in acts:
        now_s += pause_s
        match act:
            case "renew":
                assert lease.renew(client, now_s) == (lease.standing.holder == client)
            case "take":
                lease.take(client, now_s)
            case "ask":
                lease.ask(client)
            case "grant" | "keep":
                lease.answer(client, act == "grant", now_s)
            case "release":
                lease.release(client)
            case _:
                lease.lapse(now_s)
        allowed = [each for each in "abc" if lease.admits(each, now_s)]
        holder = lease.standing.holder
        assert allowed == (list("abc") if holder is None else [holder])
        assert lease.standing.asking is None or lease.standing.asking != holder
