"""A camera is calibrated in the browser, from the board to the fleet file."""

from __future__ import annotations

import asyncio
import re
from collections.abc import AsyncIterator
from pathlib import Path

import cv2
import pytest
from browsers import chromium
from fake_camera import board_shown
from fake_mission import DRONES, drone_report, frame
from playwright.async_api import Browser, Page, expect
from served_console import TOKEN, Console, serve
from test_screens import AXE, WEB, faults

from server.swarm.fleet_file import load_fleet

pytestmark = [
    pytest.mark.browser,
    pytest.mark.loopback,
    pytest.mark.slow,
    pytest.mark.skipif(not (WEB / "dist/index.html").exists(), reason="no dashboard is built"),
]


@pytest.fixture
async def browser() -> AsyncIterator[Browser]:
    async with chromium() as browser:
        yield browser


async def open_panel(console: Console, page: Page) -> None:
    for drone_id in DRONES:
        console.mission.reports[drone_id] = drone_report(drone_id, activity="ground")
    await page.goto(f"{console.http}/?token={TOKEN}#/setup")
    await page.get_by_test_id("calibrate-drone-1").click()
    await expect(page.get_by_test_id("calibrating")).to_be_focused()
    await expect(page.get_by_test_id("calibrating")).to_have_attribute("data-state", "idle")


async def film(console: Console) -> None:
    """Show the camera's pictures in the tile, as an eye would."""
    camera = console.mission.cameras["drone-1"]
    for number in range(10_000):
        picture = camera.pictures[camera.sequence // camera.each % len(camera.pictures)]
        data = cv2.imencode(".jpg", picture)[1].tobytes()
        console.mission.events.publish(frame("drone-1", number, data))
        await asyncio.sleep(0.1)


@pytest.mark.parametrize("size", [(1440, 900), (360, 780)])
async def test_from_the_board_into_the_fleet_file(
    tmp_path: Path, browser: Browser, size: tuple[int, int]
) -> None:
    file = tmp_path / "fleet.toml"
    file.write_text("".join(f'[[drones]]\naddress = "10.0.0.{n}"\n' for n in range(1, 5)))
    async with serve(tmp_path, dist=WEB / "dist") as console:
        console.mission.fleet_file = file
        camera = console.mission.cameras["drone-1"]
        shown = board_shown()
        camera.pictures, camera.frame_s = shown[:3], 0.02
        page = await browser.new_page(viewport={"width": size[0], "height": size[1]})
        errors: list[str] = []
        page.on("pageerror", lambda error: errors.append(str(error)))
        await open_panel(console, page)
        filming = asyncio.create_task(film(console))
        # Its live picture alone is sent to this screen.
        picture = page.get_by_test_id("calibration-picture")
        await expect(picture).to_have_attribute("data-coding", "jpeg")
        await expect(page.locator(".tile")).to_have_count(1)
        board = page.get_by_role("img", name="The board")
        assert await board.evaluate("image => image.decode().then(() => image.naturalWidth)") > 1000

        await page.get_by_test_id("calibration-start").press("Enter")
        hint = page.get_by_test_id("calibration-hint")
        await expect(hint).not_to_be_empty()
        views = page.get_by_test_id("calibration-views")
        await expect(views).to_have_text("3 of 12")
        await page.get_by_test_id("calibration-finish").click()
        await expect(hint).to_contain_text("Too few views")
        await expect(page.get_by_test_id("coverage-grid")).not_to_have_attribute(
            "data-percent", "0"
        )
        camera.pictures = shown
        await page.get_by_test_id("calibration-go-on").click()
        result = page.get_by_test_id("calibration-result")
        await expect(result).to_contain_text("Focal length", timeout=30_000)
        # Twelve views are enough to be used, and too few to be called good.
        await expect(result).to_contain_text("Usable")
        await expect(page.get_by_test_id("calibration-wants")).to_contain_text("20 views used")
        beyond = "document.documentElement.scrollWidth - innerWidth"
        assert await page.evaluate(beyond) <= 0
        if AXE.exists():
            assert await faults(page) == []

        row = page.get_by_test_id("calibration").locator("tbody tr").first
        await expect(row).to_contain_text("Usual Tello")
        await page.get_by_test_id("calibration-use").click()
        used = page.get_by_test_id("calibration-used")
        await expect(used).to_contain_text("nothing needs to be restarted")
        await expect(used).to_contain_text("Written into fleet.toml; as it was: fleet.toml.bak")
        await expect(page.get_by_test_id("snippet")).to_have_count(0)
        await expect(row).to_contain_text("Calibrated")
        written = load_fleet(file).drones[0].intrinsics
        assert written.fx == pytest.approx(camera.config.intrinsics.fx, abs=1e-3)
        await page.get_by_role("button", name="Close").click()
        await expect(page.get_by_test_id("calibrate-drone-1")).to_be_focused()
        await expect(page.get_by_test_id("settings-search")).to_be_visible()
        filming.cancel()
        await page.close()
    assert errors == []


async def test_without_a_fleet_file_its_lines_are_offered(tmp_path: Path, browser: Browser) -> None:
    async with serve(tmp_path, dist=WEB / "dist") as console:
        console.mission.cameras["drone-1"].pictures = board_shown()
        page = await browser.new_page()
        await open_panel(console, page)
        console.mission.cameras["drone-2"].airborne = True
        await page.get_by_test_id("calibration-start").click()
        await expect(page.get_by_role("alert")).to_contain_text("drone-2 in the air")
        console.mission.cameras["drone-2"].airborne = False
        await page.get_by_test_id("calibration-start").click()
        await expect(page.get_by_test_id("calibration-result")).to_be_visible(timeout=30_000)
        lines = page.get_by_test_id("snippet")
        await expect(lines).to_have_value(re.compile(r"\[drones\.intrinsics\]"))
        async with page.expect_download() as waiting:
            await page.get_by_role("link", name="Download").click()
        kept = await waiting.value
        assert kept.suggested_filename == "drone-1-intrinsics.toml"
        text = await asyncio.to_thread(Path(await kept.path()).read_text)
        assert "[drones.intrinsics]" in text
        await page.get_by_test_id("calibration-use").click()
        await expect(page.get_by_test_id("calibration-used")).to_contain_text(
            "until the console ends"
        )
        await expect(lines).to_be_visible()
        await page.close()
