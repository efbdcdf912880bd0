"""Signed-in browsers: they run out, are forgotten, and survive the console that knew them."""

from __future__ import annotations

from pathlib import Path

import pytest

from server.api.access import KeyRing
from server.api.sessions import Sessions

RING = KeyRing("a-token-for-tests")


class Clock:
    now_s = 1e9

    def __call__(self) -> float:
        return self.now_s


def test_a_session_runs_out() -> None:
    clock = Clock()
    sessions = Sessions(10, 10.0, clock=clock)
    session_id = sessions.open(RING.own)
    assert sessions.key(session_id, RING) == RING.own
    clock.now_s += 9.9
    assert sessions.key(session_id, RING) == RING.own
    clock.now_s += 0.1
    assert sessions.key(session_id, RING) is None
    clock.now_s -= 5.0
    assert sessions.key(session_id, RING) is None


def test_the_oldest_session_is_forgotten_first() -> None:
    sessions = Sessions(2, 10.0)
    opened = [sessions.open(RING.own) for _ in range(3)]
    assert [sessions.key(s, RING) is not None for s in opened] == [False, True, True]


def test_the_next_console_knows_the_browsers_of_the_last(tmp_path: Path) -> None:
    file = tmp_path / "runs" / ".sessions.json"
    before = Sessions(10, 100.0, file)
    kept, ended = before.open(RING.own), before.open(RING.own)
    before.end(ended)
    before.save()
    assert kept not in file.read_text()
    assert file.stat().st_mode & 0o777 == 0o600
    after = Sessions(10, 100.0, file)
    assert after.key(kept, RING) == RING.own
    assert after.key(ended, RING) is None


def test_a_session_does_not_outlive_the_token_it_was_opened_by(tmp_path: Path) -> None:
    file = tmp_path / "sessions.json"
    before = Sessions(10, 100.0, file)
    session_id = before.open(RING.own)
    before.save()
    assert Sessions(10, 100.0, file).key(session_id, KeyRing("another-token")) is None


@pytest.mark.parametrize("content", ["", "[]", "{", '{"a": 1}', '{"a": {"key_id": "x"}}'])
def test_a_damaged_file_costs_a_sign_in_and_no_more(tmp_path: Path, content: str) -> None:
    file = tmp_path / "sessions.json"
    file.write_text(content)
    sessions = Sessions(10, 100.0, file)
    session_id = sessions.open(RING.own)
    sessions.save()
    assert Sessions(10, 100.0, file).key(session_id, RING) == RING.own


def test_a_file_that_cannot_be_written_keeps_nobody_out(tmp_path: Path) -> None:
    (tmp_path / "runs").write_text("not a folder")
    sessions = Sessions(10, 100.0, tmp_path / "runs" / "sessions.json")
    session_id = sessions.open(RING.own)
    sessions.save()
    assert sessions.key(session_id, RING) == RING.own
