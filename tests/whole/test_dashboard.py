"""The dashboard in a real browser, on a real console, with simulated drones."""

import shutil
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect, sync_playwright
from programs import TOKEN, console

pytestmark = [
    pytest.mark.browser,
    pytest.mark.loopback,
    pytest.mark.slow,
    pytest.mark.timeout(400),
    pytest.mark.skipif(
        not Path("web/dist/index.html").exists(), reason="the dashboard is not built"
    ),
]

DRONES = [f"drone-{number}" for number in range(1, 5)]
_ARGUMENTS = [
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]


def _sequence(page: Page, drone_id: str) -> int:
    return int(page.get_by_test_id(f"tile-{drone_id}").get_attribute("data-sequence") or -1)


def test_four_live_tiles_the_scene_and_a_hold_that_latches(tmp_path):
    with console(tmp_path, "--sim", "recycle_bin") as address, sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=shutil.which("chromium"), args=_ARGUMENTS
        )
        page = browser.new_page(viewport={"width": 1440, "height": 900})
        page.set_default_timeout(60_000)
        expect.set_options(timeout=60_000)
        page.goto(f"{address}/?token={TOKEN}")
        assert TOKEN not in page.url

        for drone_id in DRONES:
            expect(page.get_by_test_id(f"tile-{drone_id}")).to_be_visible()
        page.wait_for_function(
            "ids => ids.every(id => Number(document.querySelector(`[data-testid=tile-${id}]`)"
            "?.dataset.sequence) >= 0)",
            arg=DRONES,
        )
        before = {drone_id: _sequence(page, drone_id) for drone_id in DRONES}
        page.wait_for_function(
            "before => Object.entries(before).every(([id, sequence]) => Number("
            "document.querySelector(`[data-testid=tile-${id}]`).dataset.sequence) > sequence)",
            arg=before,
        )

        # The scene's own viewer lists the nodes it was sent once its socket is connected.
        scene = page.frame_locator("[data-testid=scene-frame]")
        expect(scene.locator("canvas").first).to_be_attached()
        held = page.get_by_test_id("held-banner")
        expect(held).to_have_count(0)
        page.keyboard.press("Space")
        expect(held).to_be_visible()
        answer = page.request.get(f"{address}/api/v1/drones")
        assert all(drone["held"] for drone in answer.json())
        refused = page.request.post(
            f"{address}/api/v1/captures", data={}, headers={"Origin": address}
        )
        assert refused.status == 409
        browser.close()
