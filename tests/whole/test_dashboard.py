"""The dashboard in a real browser, on a real console, with simulated drones."""

from pathlib import Path

import pytest
from playwright.sync_api import Page, expect
from programs import TOKEN, console, operator

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


def _sequence(page: Page, drone_id: str) -> int:
    return int(page.get_by_test_id(f"tile-{drone_id}").get_attribute("data-sequence") or -1)


def test_four_live_tiles_the_scene_and_a_hold_that_latches(tmp_path):
    with console(tmp_path, "--sim", "recycle_bin") as address, operator(address) as page:
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

        page.get_by_test_id("screen-plan").click()
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


def test_the_object_is_picked_by_a_drag_by_keys_and_taken_back(tmp_path):
    with console(tmp_path, "--sim", "recycle_bin") as address, operator(address, 390, 844) as page:
        pick, search = page.get_by_test_id("pick-drone-2"), page.get_by_test_id("search-drone-2")
        surface = page.get_by_test_id("pick-surface")
        answers = []
        page.on(
            "response",
            lambda answer: (
                answers.append(answer) if answer.url.endswith("/drone-2/object") else None
            ),
        )

        pick.click()
        page.keyboard.press("Escape")
        expect(surface).to_have_count(0)

        pick.click()
        area = surface.bounding_box()
        assert area is not None
        # Hovering scrolls there and waits until nothing moves: a notice may push the tile aside.
        surface.hover(position={"x": area["width"] / 4, "y": area["height"] / 4})
        page.mouse.down()
        surface.hover(position={"x": area["width"] / 2, "y": area["height"] * 3 / 4})
        expect(page.locator(".pick-drawn")).to_be_visible()
        page.mouse.up()
        expect(search).to_be_visible()
        picked = answers[-1].json()["box"]
        assert picked == pytest.approx([0.25, 0.25, 0.5, 0.75], abs=0.02)

        search.click()
        expect(search).to_have_count(0)

        # The same by keys alone: a box in the middle, a step to the right, confirmed.
        pick.focus()
        page.keyboard.press("Enter")
        expect(surface).to_be_focused()
        page.keyboard.press("ArrowRight")
        page.keyboard.press("ArrowRight")
        page.keyboard.press("Enter")
        expect(search).to_be_visible()
        assert answers[-1].json()["box"] == pytest.approx([0.37, 0.3, 0.67, 0.7], abs=0.01)
        # Nothing of all this was a HOLD, which the space bar still is.
        expect(page.get_by_test_id("held-banner")).to_have_count(0)
