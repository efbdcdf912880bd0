"""The drones' last minutes, for plots of pages that are opened late."""

import asyncio
from dataclasses import replace
from datetime import UTC, datetime, timedelta

from fake_mission import drone_report
from served_console import Console

from server.api.course import Course

START = datetime(2026, 1, 1, tzinfo=UTC)


def test_reports_are_thinned_and_the_oldest_go() -> None:
    course = Course()
    for tenth in range(10 * 1000):
        at = START + timedelta(seconds=tenth / 10.0)
        for drone_id in ("drone-1", "drone-2"):
            course.record(replace(drone_report(drone_id, tenth % 100), at=at))
    kept = course.reports()
    seconds = sorted({int((report.at - START).total_seconds()) for report in kept})
    assert seconds == list(range(100, 1000, 5))
    assert len(kept) == 2 * len(seconds)
    # Of ten reports a second the last one stands.
    assert all(report.battery_pct % 10 == 9 for report in kept if report.battery_pct is not None)


async def test_a_page_that_is_opened_late_is_told(console: Console) -> None:
    async with console.client() as client:
        assert (await client.get("/api/v1/drones/history")).json() == []
        for second in (0, 1, 5):
            at = START + timedelta(seconds=second)
            console.mission.events.publish(replace(drone_report("drone-1", 80 - second), at=at))
        told: list[dict[str, object]] = []
        while len(told) < 2:
            await asyncio.sleep(0.01)  # The journal follows the events by itself.
            told = (await client.get("/api/v1/drones/history")).json()
    assert [report["battery_pct"] for report in told] == [80, 75]
