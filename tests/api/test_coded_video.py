"""The drones' own video in a real browser: decoded by the page, with what was seen drawn on it."""

from __future__ import annotations

import time
from collections.abc import AsyncIterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from browsers import chromium
from fake_mission import DRONES, frame, jpeg
from playwright.async_api import Page, expect
from served_console import TOKEN, Console, serve

from server.mission.events import FrameAnnotated, PictureMarks
from server.sim.encoder import VideoEncoder
from server.stages import Box
from server.swarm.access_units import AccessUnits
from server.swarm.unit_decoder import UnitDecoder

DIST = Path(__file__).parents[2] / "web/dist"

pytestmark = [
    pytest.mark.browser,
    pytest.mark.loopback,
    pytest.mark.slow,
    pytest.mark.skipif(not (DIST / "index.html").exists(), reason="no dashboard is built"),
]

BLUE_BGR, GREY = (200, 60, 20), 100
BOX = np.array([300.0, 200.0, 600.0, 500.0])
ONE = f"tile-{DRONES[0]}"


@pytest.fixture
async def page() -> AsyncIterator[Page]:
    async with chromium() as browser:
        yield await browser.new_page()


class Drone:
    """Sends one colour, as its camera would; its JPEGs are grey, so that the two are told apart."""

    def __init__(self) -> None:
        self._encoder = VideoEncoder(960, 720, 30.0, 4000)
        self._units, self._decoder = AccessUnits(), UnitDecoder(DRONES[0])
        self._image = np.full((720, 960, 3), BLUE_BGR, np.uint8)
        self._count = 0

    def picture(self, *, key: bool = False) -> FrameAnnotated:
        """Return the next picture."""
        self._count += 1
        datagrams = self._encoder.encode(self._image, self._count / 30.0, key)
        units = [unit for datagram in datagrams for unit in self._units.feed(datagram, 0.0)]
        (decoded,) = [each for unit in units for each in self._decoder.decode(unit)]
        marks = PictureMarks((960, 720), Box(BOX, 0.9, False), (), 0.2)
        event = frame(DRONES[0], decoded.sequence, jpeg(grey=GREY))
        return replace(event, coded=decoded.coded, marks=marks, captured_s=time.monotonic())


async def colour(page: Page, x: int, y: int) -> list[int]:
    """Return red, green and blue of the first tile at a pixel of a picture 960 wide."""
    rgba: list[int] = await page.evaluate(
        """([tile, x, y]) => {
            const canvas = document.querySelector(`[data-testid=${tile}] canvas`);
            const at = canvas.width / 960;
            return [...canvas.getContext("2d").getImageData(x * at, y * at, 1, 1).data];
        }""",
        [ONE, x, y],
    )
    return rgba[:3]


async def opened(console: Console, page: Page, query: str = "video=h264") -> None:
    await page.goto(f"{console.http}/?token={TOKEN}")
    await page.goto(f"{console.http}/?{query}#/fly")
    await page.reload()
    await expect(page.get_by_test_id(ONE)).to_be_visible()


async def shown(console: Console, page: Page, drone: Drone, coding: str, *, key: bool) -> None:
    """Send pictures until the page shows one that came as ``coding``."""
    tile = page.get_by_test_id(ONE)
    for n in range(200):
        console.mission.events.publish(drone.picture(key=key and n % 20 == 0))
        await page.wait_for_timeout(30)
        if await tile.get_attribute("data-coding") == coding:
            return
    pytest.fail(f"the page showed no {coding}")


async def test_the_page_decodes_the_drones_own_video_and_draws_what_was_seen(
    tmp_path: Path, page: Page
) -> None:
    errors: list[str] = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    async with serve(tmp_path, dist=DIST) as console:
        await opened(console, page)
        await shown(console, page, Drone(), "h264", key=True)
        red, green, blue = await colour(page, 700, 600)
        assert abs(red - 20) < 12
        assert abs(green - 60) < 12
        assert abs(blue - 200) < 12
        # The box's left edge is in the drone's colour, #5aa9ff or whatever it reports.
        edge = await colour(page, 300, 350)
        assert sum(abs(a - b) for a, b in zip(edge, (red, green, blue), strict=True)) > 60
    assert errors == []


async def test_until_a_key_picture_comes_and_after_a_gap_pictures_are_shown(
    tmp_path: Path, page: Page
) -> None:
    async with serve(tmp_path, dist=DIST) as console:
        await opened(console, page)
        drone = Drone()
        drone.picture(key=True)  # Nobody was there to see it.
        await shown(console, page, drone, "jpeg", key=False)
        assert await colour(page, 700, 600) == [GREY] * 3
        await shown(console, page, drone, "h264", key=True)
        drone.picture()  # Lost on its way.
        await shown(console, page, drone, "jpeg", key=False)


async def test_pictures_that_nobody_looked_at_are_decoded_all_the_same(
    tmp_path: Path, page: Page
) -> None:
    async with serve(tmp_path, dist=DIST) as console:
        await opened(console, page)
        drone, tile, last = Drone(), page.get_by_test_id(ONE), -1
        await shown(console, page, drone, "h264", key=True)
        for _ in range(10):
            skipped, looked_at = drone.picture(), drone.picture()
            both = (*skipped.coded, *looked_at.coded)
            console.mission.events.publish(replace(looked_at, coded=both))
            last = looked_at.sequence
            await page.wait_for_timeout(30)
        await expect(tile).to_have_attribute("data-sequence", str(last))
        await expect(tile).to_have_attribute("data-coding", "h264")


async def test_who_asks_for_pictures_gets_pictures(tmp_path: Path, page: Page) -> None:
    async with serve(tmp_path, dist=DIST) as console:
        await opened(console, page, "video=jpeg")
        await shown(console, page, Drone(), "jpeg", key=True)
        for n in range(30):
            console.mission.events.publish(Drone().picture(key=n == 0))
            await page.wait_for_timeout(10)
        await expect(page.get_by_test_id(ONE)).to_have_attribute("data-coding", "jpeg")


async def test_a_page_that_no_graphics_card_draws_asks_for_pictures(
    tmp_path: Path, page: Page
) -> None:
    async with serve(tmp_path, dist=DIST) as console:
        await opened(console, page, "")
        await shown(console, page, Drone(), "jpeg", key=True)
        await expect(page.get_by_text("could not decode the drones' video")).to_have_count(0)


async def test_what_no_decoder_takes_ends_in_pictures_and_is_said(
    tmp_path: Path, page: Page
) -> None:
    async with serve(tmp_path, dist=DIST) as console:
        await opened(console, page)
        drone = Drone()
        tile = page.get_by_test_id(ONE)
        notice = page.get_by_text("could not decode the drones' video")
        for _ in range(200):
            event = drone.picture(key=True)
            (picture,) = event.coded
            # Parameter sets of a kind that does not exist.
            spoilt = picture.data.replace(b"\0\0\1\x67\x4d", b"\0\0\1\x67\xee")
            assert spoilt != picture.data
            console.mission.events.publish(replace(event, coded=(replace(picture, data=spoilt),)))
            await page.wait_for_timeout(50)
            if await notice.is_visible():
                break
        await expect(notice).to_have_count(1)
        await shown(console, page, drone, "jpeg", key=True)
        # Good pictures come too late: this page gets no more of them.
        for _ in range(20):
            console.mission.events.publish(drone.picture(key=True))
            await page.wait_for_timeout(30)
        await expect(tile).to_have_attribute("data-coding", "jpeg")
