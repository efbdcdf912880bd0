"""What an operator does in an hour, in a real browser on a real console with simulated drones."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect
from programs import console, free_port, operator

pytestmark = [
    pytest.mark.browser,
    pytest.mark.loopback,
    pytest.mark.slow,
    pytest.mark.timeout(1200),
    pytest.mark.skipif(
        not Path("web/dist/index.html").exists(), reason="the dashboard is not built"
    ),
]

WHOLE_CAPTURE_MS = 600_000


def start(page: Page, pictures: int, train_seconds: int, name: str) -> None:
    """Ask for a capture by the form, and start it by the checklist."""
    page.get_by_test_id("screen-fly").click()
    page.get_by_label("Pictures", exact=True).fill(str(pictures))
    page.get_by_label("Training, s").fill(str(train_seconds))
    page.get_by_label("Name").fill(name)
    page.get_by_test_id("capture-start").click()
    page.get_by_test_id("preflight-start").click()


def test_a_capture_is_held_goes_on_and_ends_another_is_aborted_and_both_are_compared(
    tmp_path: Path,
) -> None:
    with console(tmp_path, "--sim", "recycle_bin") as address, operator(address) as page:
        phase = page.get_by_test_id("phase").first
        start(page, 8, 15, "first")
        expect(phase).to_have_attribute("data-phase", "fly", timeout=WHOLE_CAPTURE_MS)
        page.get_by_test_id("screen-plan").click()
        expect(page.get_by_text("Will show")).to_be_visible()
        page.get_by_test_id("screen-fly").click()

        page.keyboard.press("Space")
        held = page.get_by_test_id("held-banner")
        expect(held).to_be_visible()
        expect(phase).to_have_attribute("data-state", "paused")
        page.get_by_test_id("rearm-all").click()
        expect(held).to_have_count(0)
        page.get_by_test_id("capture-resume").click()
        expect(phase).to_have_attribute("data-state", "running")

        expect(phase).to_have_attribute("data-state", "succeeded", timeout=WHOLE_CAPTURE_MS)
        expect(page.get_by_test_id("counter-captured")).to_contain_text("8")
        page.get_by_test_id("screen-reconstruct").click()
        expect(page.get_by_test_id("metrics")).to_be_visible()

        start(page, 4, 0, "second")
        expect(phase).to_have_attribute("data-phase", "centre", timeout=WHOLE_CAPTURE_MS)
        abort = page.get_by_role("button", name="Abort")
        abort.click()
        abort.click()
        expect(phase).to_have_attribute("data-state", "aborted", timeout=WHOLE_CAPTURE_MS)
        drones = page.request.get(f"{address}/api/v1/drones").json()
        assert {drone["activity"] for drone in drones} == {"ground"}

        page.get_by_test_id("screen-library").click()
        marks = page.locator("[data-testid^=mark-2]")
        expect(marks).to_have_count(2)
        for mark in marks.all():
            mark.check()
        page.get_by_test_id("compare").click()
        expect(page.get_by_test_id("comparison")).to_be_visible()

        # The first flight again, with the videos that were recorded.
        page.get_by_test_id("screen-library").click()
        first = page.locator("[data-testid^=capture-2]", has_text="first")
        first.get_by_role("link").first.click()
        page.get_by_test_id("open-replay").click()
        expect(page.get_by_test_id("replay")).to_be_visible(timeout=WHOLE_CAPTURE_MS)
        expect(page.locator("[data-testid^=replay-drone]")).to_have_count(4)


def test_a_console_that_comes_back_is_found_again(tmp_path: Path) -> None:
    port = free_port()
    with ExitStack() as browser:
        with console(tmp_path, "--sim", "recycle_bin", port=port) as address:
            page = browser.enter_context(operator(address))
            connection = page.get_by_test_id("connection")
            expect(connection).to_have_attribute("data-state", "open")
            expect(page.get_by_test_id("tile-drone-1")).to_be_visible()
        expect(connection).to_have_attribute("data-state", "lost")
        with console(tmp_path, "--sim", "recycle_bin", port=port):
            expect(connection).to_have_attribute("data-state", "open")
            expect(page.get_by_text("Back after").first).to_be_visible()
            page.get_by_test_id("hold").click()
            expect(page.get_by_test_id("held-banner")).to_be_visible()
