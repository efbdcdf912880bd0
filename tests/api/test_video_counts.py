"""How the video fares, as ``/metrics`` tells it."""

from __future__ import annotations

import asyncio
from dataclasses import replace

import pytest
from fake_mission import frame
from served_console import Console

from server.api.video_counts import DroneVideo, VideoCounts


def test_counts_come_with_the_events_so_that_lost_events_do_not_matter() -> None:
    counts = VideoCounts()
    counts.record(replace(frame("drone-1", 9), skipped=0))
    counts.record(replace(frame("drone-1", 99), skipped=15))
    counts.record(replace(frame("drone-2", 4), skipped=1))
    assert counts.drones == {"drone-1": DroneVideo(100, 85), "drone-2": DroneVideo(5, 4)}
    assert counts.latencies == 3


def test_quantiles_are_of_the_newest_pictures() -> None:
    counts = VideoCounts()
    assert counts.latency_quantiles((0.5,)) == []
    for number in range(7200):
        counts.record(replace(frame("d", number), latency_s=9.0))
    for number in range(7200):
        counts.record(replace(frame("d", number), latency_s=number / 7199))
    quantiles = dict(counts.latency_quantiles((0.0, 0.5, 0.95, 1.0)))
    assert quantiles == pytest.approx({0.0: 0.0, 0.5: 0.5, 0.95: 0.95, 1.0: 1.0})
    assert counts.latencies == 14400
    assert counts.latency_sum_s == pytest.approx(7200 * 9.5)


@pytest.mark.loopback
async def test_metrics_tell_pictures_latency_and_processor_time(console: Console) -> None:
    async with console.client() as client:
        before = (await client.get("/metrics")).text
        assert "dronerf_video_latency_seconds_count 0" in before
        assert "quantile=" not in before
        for number in range(1234567, 1234570):
            picture = replace(frame("drone-1", number), skipped=7, latency_s=0.025)
            console.mission.events.publish(picture)
        await asyncio.sleep(0)
        lines = (await client.get("/metrics")).text.splitlines()
    assert 'dronerf_video_pictures_decoded_total{drone="drone-1"} 1234570' in lines
    assert 'dronerf_video_pictures_annotated_total{drone="drone-1"} 1234563' in lines
    assert 'dronerf_video_latency_seconds{quantile="0.95"} 0.025' in lines
    assert "dronerf_video_latency_seconds_sum 0.075" in lines
    assert "dronerf_video_latency_seconds_count 3" in lines
    (spent,) = (line for line in lines if line.startswith("process_cpu_seconds_total "))
    assert float(spent.split()[1]) > 0.0
