"""The video bench: its streams, its reading of the console, and once the whole of it."""

from __future__ import annotations

import asyncio
from collections import Counter
from pathlib import Path

import cv2
import numpy as np
import pytest

from server.bench import video
from server.bench.video import readings_from_metrics
from server.bench.video_streams import Stream, hovering_stream, next_key
from server.sim.encoder import VideoEncoder
from server.swarm.access_units import AccessUnits

_SETS_KIND = 7


def short_stream(seed: int) -> Stream:
    """Two seconds of a blob that moves over a texture."""
    noise = np.random.default_rng(seed).integers(0, 255, (720, 960, 3), np.uint8)
    floor = cv2.GaussianBlur(noise, (0, 0), 5.0)
    encoder = VideoEncoder(960, 720, 30.0, 2500)
    stream: Stream = []
    for number in range(60):
        picture = floor.copy()
        cv2.circle(picture, (400 + 3 * number, 380), 130, (40, 40, 220), -1)
        stream.append(encoder.encode(np.asarray(picture, np.uint8), number / 30.0))
    return stream


def test_the_next_key_picture_is_looked_for_around_the_loop() -> None:
    key, other = [b"\0\0\0\1\x67", b"\0\0\0\1\x65"], [b"\0\0\0\1\x41"]
    stream = [key, other, other, key, other]
    assert [next_key(stream, at) for at in range(5)] == [0, 3, 3, 3, 0]


@pytest.mark.slow
def test_a_stream_is_that_of_a_real_drone_and_its_loop_has_no_seam() -> None:
    stream = hovering_stream("recycle_bin", 1, 30.0, 0)
    keys = [n for n, picture in enumerate(stream) if picture[0][4] & 0x1F == _SETS_KIND]
    assert keys[0] == 0
    assert len(keys) % 2 == 0, "two key pictures in a row differ in their number"
    kbit_s = 8e-3 * sum(len(d) for picture in stream for d in picture) * 30.0 / len(stream)
    assert 2000 < kbit_s < 3000
    units = AccessUnits()
    twice = [d for _ in range(2) for picture in stream for d in picture]
    pictures = [unit for datagram in twice for unit in units.feed(datagram, 0.0)]
    assert len(pictures) == 2 * len(stream)
    assert not any(picture.damaged for picture in pictures)
    assert Counter(picture.key for picture in pictures)[True] == 2 * len(keys)


def test_metrics_are_read_by_name_and_summed_over_drones() -> None:
    readings = readings_from_metrics(
        "# HELP process_cpu_seconds_total Processor time.\n"
        "process_cpu_seconds_total 12.5\n"
        'dronerf_video_pictures_decoded_total{drone="a"} 100\n'
        'dronerf_video_pictures_decoded_total{drone="b"} 23\n'
        'dronerf_video_pictures_annotated_total{drone="a"} 99\n'
        'dronerf_video_latency_seconds{quantile="0.5"} 0.01\n'
        'dronerf_video_latency_seconds{quantile="0.95"} 0.05\n'
        "dronerf_video_latency_seconds_sum 3.5\n"
    )
    assert readings.cpu_s == 12.5
    assert (readings.decoded, readings.annotated) == (123, 99)
    assert readings.latency_s == {"0.5": 0.01, "0.95": 0.05}


@pytest.mark.slow
@pytest.mark.loopback
def test_video_goes_through_a_whole_console(tmp_path: Path) -> None:
    streams = [short_stream(seed) for seed in range(4)]
    figures, tiles = asyncio.run(video._measure(streams, 2.0, 0, tmp_path))
    assert len(tiles) == 4
    assert all(jpeg.startswith(b"\xff\xd8") for jpeg in tiles.values())
    assert figures["streams"] == 4
    assert figures["frames_sent"] == 240
    # How much of it a busy machine skips is its own affair; more than was sent cannot come out.
    assert 0 < figures["frames_annotated"] <= figures["frames_decoded"] <= 240
    assert 0 < figures["frames_shown"] <= figures["frames_annotated"]
    assert figures["cpu_cores"] > 0.0
    assert 0.0 < figures["latency_ms_p50"] <= figures["latency_ms_p95"]
