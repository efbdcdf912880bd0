"""The record of a run is written beside the event loop, newest state last, every line once."""

from __future__ import annotations

import asyncio
import json
import threading
from pathlib import Path

from server.store.run_writer import RunWriter
from server.store.runs import RunFolder


def test_a_disk_that_hangs_holds_nobody_up_and_loses_nothing(tmp_path, monkeypatch):
    run = RunFolder.create(tmp_path, "slow")
    answers, write = threading.Event(), RunFolder.write_state
    written = []

    def slowly(self, state):
        answers.wait(30.0)
        written.append(state["n"])
        write(self, state)

    monkeypatch.setattr(RunFolder, "write_state", slowly)

    async def story():
        writer = RunWriter(run)
        for n in range(100):
            writer.write_state({"n": n})
            writer.log({"line": n})
            await asyncio.sleep(0)
        assert written == []
        await writer.settled(0.05)  # Patience has an end.
        answers.set()
        await writer.settled(30.0)

    asyncio.run(story())
    assert written[-1] == 99
    assert len(written) < 5, "only the newest of those that waited"
    assert run.state() == {"n": 99}
    lines = (run.path / "log.jsonl").read_text().splitlines()
    assert [json.loads(line)["line"] for line in lines] == list(range(100))


def test_a_full_disk_does_not_keep_later_records_away(tmp_path, monkeypatch, caplog):
    run = RunFolder.create(tmp_path, "full")

    def full(self, lines):
        raise OSError(28, "No space left on device")

    async def story():
        writer = RunWriter(run)
        with monkeypatch.context() as patched:
            patched.setattr(RunFolder, "log", full)
            writer.log({"line": 0})
            writer.write_state({"n": 0})
            await writer.settled(30.0)
        assert run.state() == {"n": 0}, "the record does not suffer for the log"
        writer.log({"line": 1})
        writer.write_state({"n": 1})
        await writer.settled(30.0)

    asyncio.run(story())
    assert run.state() == {"n": 1}
    assert "could not be written" in caplog.text
    assert Path(run.path / "log.jsonl").read_text().count("\n") == 1
