"""Records pictures and notes until it is killed; run as a child process by the tests.

Prints the number of the newest note that must have reached the disk: one that is older than two
flush periods.
"""

from __future__ import annotations

import sys
import time
from collections import deque
from dataclasses import replace
from pathlib import Path

from flights import SMALL, pictures

from server.recording.json_messages import JsonMessage
from server.recording.recorder import FlightRecorder

recorder = FlightRecorder(Path(sys.argv[1]), replace(SMALL, max_bytes=1 << 30))
recorder.open({"dronerf": {"version": "test"}})
shot = pictures(10)
noted: deque[tuple[float, int]] = deque()
number = 0
while True:
    now_s = time.monotonic()
    recorder.note(
        "/events", lambda n=number: JsonMessage("dronerf.Event", {"event": str(n)}), now_s
    )
    for datagram in shot[number % len(shot)][1]:
        recorder.film("drone-1", datagram, now_s)
    noted.append((now_s, number))
    number += 1
    time.sleep(0.002)
    surely = -1
    while noted and now_s - noted[0][0] > 1.0:
        surely = noted.popleft()[1]
    if surely >= 0:
        print(surely, flush=True)  # noqa: T201
