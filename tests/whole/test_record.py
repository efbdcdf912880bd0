"""``dronerf record`` of simulated drones, ended as an operator ends it: with Ctrl-C."""

from __future__ import annotations

import signal
import subprocess
import time
from collections import Counter
from pathlib import Path

import pytest
from mcap.reader import make_reader
from programs import COMMAND

pytestmark = [pytest.mark.loopback, pytest.mark.slow, pytest.mark.timeout(180)]


def test_a_recording_ended_by_ctrl_c_is_whole(tmp_path: Path) -> None:
    file = tmp_path / "two.mcap"
    command = [*COMMAND, "record", "--sim", "recycle_bin", "--drones", "2", "--out", str(file)]
    # Whatever started the tests may have told them to ignore Ctrl-C; a terminal does not.
    process = subprocess.Popen(
        command, preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL)
    )
    try:
        until = time.monotonic() + 90.0
        # Half a megabyte: video is coming in.
        while not (file.exists() and file.stat().st_size > 500_000):
            assert process.poll() is None, "it ended by itself"
            assert time.monotonic() < until, "nothing is recorded"
            time.sleep(0.2)
        process.send_signal(signal.SIGINT)
        assert process.wait(30.0) == 0
    finally:
        process.kill()
    with file.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    # A file that was not ended has no summary.
    assert summary is not None
    assert summary.statistics is not None
    with file.open("rb") as stream:
        read = Counter(channel.topic for _, channel, _ in make_reader(stream).iter_messages())
    assert read.total() == summary.statistics.message_count
    assert read["/drone-1/video"] > 5
    assert read["/drone-2/telemetry"] > 5
    assert [each.name for each in tmp_path.iterdir()] == ["two.mcap"]
