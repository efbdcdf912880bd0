"""What only a browser can tell: origins of forms and fetches, cookies, content policies."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from pathlib import Path

import numpy as np
import pytest
from browsers import chromium
from fake_mission import (
    DRONES,
    capture_changed,
    checklist,
    drone_report,
    failsafe_fired,
    jpeg,
    level_failed,
    link_failed,
)
from playwright.async_api import Dialog, Page, expect
from served_console import TOKEN, Console, serve, until

from server.geometry.cameras import TELLO_INTRINSICS, TELLO_TILT_RAD
from server.geometry.poses import camera_pose
from server.mission.commands import AT_REST, Sticks
from server.mission.events import (
    EventStream,
    FieldView,
    PoseEstimated,
    PreviewRendered,
    TrainingProgressed,
)
from server.scene.scene import SceneView
from server.stages import CameraPose

pytestmark = [pytest.mark.browser, pytest.mark.loopback, pytest.mark.slow]

# A drawing context without a graphics card.
_ARGUMENTS = ["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]


DIST = Path(__file__).parents[2] / "web/dist"
built = pytest.mark.skipif(not (DIST / "index.html").exists(), reason="the dashboard is not built")


@pytest.fixture
async def page() -> AsyncIterator[Page]:
    async with chromium(*_ARGUMENTS) as browser:
        yield await browser.new_page()


def publish_drone(events: EventStream) -> None:
    T_world_cam = camera_pose(np.array([0.5, 0.0, 1.0]), np.pi, TELLO_TILT_RAD)
    pose = CameraPose("drone-1", 0.0, T_world_cam, np.eye(4) * 1e-3)
    events.publish(PoseEstimated(pose, TELLO_INTRINSICS, "#1f77b4"))


async def test_sign_in_stop_and_watch(tmp_path: Path, page: Page) -> None:
    errors: list[str] = []
    page.on("pageerror", lambda error: errors.append(str(error)))
    async with SceneView() as scene, serve(tmp_path, scene.port) as console:
        (console.dist).mkdir()
        (console.dist / "index.html").write_text("<h1>The dashboard</h1>")
        following = asyncio.create_task(scene.follow(console.mission.events))
        await asyncio.sleep(0)
        publish_drone(console.mission.events)

        await page.goto(console.http)
        await page.fill("#token", TOKEN)
        await page.click("button")
        await page.wait_for_selector("text=The dashboard")

        hold = "fetch('/api/v1/fleet/hold', {method: 'POST'}).then(r => r.status)"
        assert await page.evaluate(hold) == 202
        assert console.stops.calls == [("hold", None)]
        first = """new Promise((resolve, reject) => {
            const socket = new WebSocket(`ws://${location.host}/api/v1/stream`);
            socket.onmessage = (event) => resolve(JSON.parse(event.data).type);
            socket.onclose = reject;
        })"""
        assert await page.evaluate(first) == "drone_reported"

        # The viewer reports its own connection, through the bridge and with the right subprotocol.
        async with page.expect_console_message(
            lambda message: message.text.startswith("Connected!"), timeout=30_000
        ):
            await page.goto(console.http + "/scene/")
        await page.wait_for_selector("canvas")
        following.cancel()
        await asyncio.gather(following, return_exceptions=True)
    assert errors == []


async def dashboard(console: Console, page: Page) -> None:
    """Open the real dashboard and wait for its drones."""
    await page.goto(f"{console.http}/?token={TOKEN}")
    for drone_id in DRONES:
        await expect(page.get_by_test_id(f"tile-{drone_id}")).to_be_visible()


@built
async def test_a_capture_starts_through_the_checklist(tmp_path: Path, page: Page) -> None:
    async with serve(tmp_path, dist=DIST) as console:
        console.mission.checks = checklist(level_failed("drone-2"), link_failed("drone-3"))
        await dashboard(console, page)
        await page.get_by_test_id("capture-start").click()
        start = page.get_by_test_id("preflight-start")
        level = page.get_by_test_id("check-drone-2.level")
        await expect(level).to_contain_text("Not OK")
        await expect(level).to_contain_text("leans 14 degrees")
        await expect(level).to_contain_text("Set it down on a level place.")
        await expect(page.get_by_test_id("check-drone-1.level")).to_contain_text("OK")
        await expect(page.get_by_test_id("override-drone-3.link")).to_have_count(0)
        await expect(start).to_be_disabled()

        # A reason is needed; its spaces are spaces, and none of them is a HOLD.
        await page.get_by_test_id("override-drone-2.level").click()
        await page.keyboard.type("a ")
        await expect(level).to_have_attribute("data-state", "failed")
        await page.keyboard.type("ramp")
        await expect(level).to_have_attribute("data-state", "overridden")
        assert console.stops.calls == []

        # The drone that does not answer stays, the other three fly.
        await expect(start).to_be_disabled()
        await page.get_by_test_id("use-others").click()
        await expect(start).to_have_text("Take off with 3 drones")

        # The stops take presses while the checklist is open.
        await page.get_by_test_id("land").click()
        await until(lambda: console.stops.calls == [("land", None)])
        assert console.mission.calls == []

        # Somebody trips over a cable: the checklist is looked at again and again.
        console.mission.checks = checklist(
            level_failed("drone-2"), link_failed("drone-3"), link_failed("drone-4")
        )
        await expect(start).to_be_disabled()
        console.mission.checks = checklist(level_failed("drone-2"), link_failed("drone-3"))
        await expect(start).to_be_enabled()
        await start.click()
        await expect(page.get_by_test_id("preflight")).to_have_count(0)
    ((_, request),) = console.mission.calls
    assert request.drones == 3  # type: ignore[attr-defined]
    assert request.overrides == {"drone-2.level": "a ramp"}  # type: ignore[attr-defined]


@built
async def test_a_failsafe_lights_its_row_and_its_drone(tmp_path: Path, page: Page) -> None:
    async with serve(tmp_path, dist=DIST) as console:
        publish = console.mission.events.publish
        await dashboard(console, page)
        verdict = page.get_by_test_id("failsafe-verdict")
        await expect(verdict).to_have_text("None fires")
        await page.get_by_test_id("failsafe-toggle").click()
        row = page.get_by_test_id("failsafe-video_age_s-hold")
        resting = page.get_by_test_id("failsafe-video_age_s-land")
        await expect(row).to_contain_text("≥ 4 s")
        await expect(row).to_have_attribute("data-lit", "false")

        publish(drone_report("drone-2", activity="holding", video_age_s=4.2))
        publish(failsafe_fired("drone-2"))
        await expect(row).to_have_attribute("data-lit", "true")
        await expect(row).to_contain_text("Drone-2")
        await expect(row).to_contain_text("4.2 s")
        await expect(resting).to_have_attribute("data-lit", "false")
        await expect(verdict).to_have_text("1 fires")
        tile = page.get_by_test_id("fired-drone-2")
        await expect(tile).to_have_text("Holding: no picture for 4.2 s")
        # Closed, the panel still shows what fires.
        await page.get_by_test_id("failsafe-toggle").click()
        await expect(row).to_be_visible()
        await expect(resting).to_have_count(0)

        publish(drone_report("drone-2"))
        await expect(verdict).to_have_text("None fires")
        await expect(tile).to_have_count(0)


@built
async def test_cut_motors_needs_holding(tmp_path: Path, page: Page) -> None:
    async with serve(tmp_path, dist=DIST) as console:
        await dashboard(console, page)
        cut, told = page.get_by_test_id("cut"), page.get_by_test_id("cut-announcement")
        await cut.click()
        await expect(told).to_contain_text("Released too early")
        await cut.press("Enter")
        await cut.dblclick()
        assert console.stops.calls == []

        await cut.hover()
        await page.mouse.down()
        await expect(told).to_contain_text("Keep holding")
        await until(lambda: console.stops.calls == [("cut_motors", None)])
        await page.mouse.up()
        await expect(told).to_contain_text("was sent")

        await cut.focus()
        await page.keyboard.down("Enter")
        await until(lambda: console.stops.calls == 2 * [("cut_motors", None)])
        await page.keyboard.up("Enter")

        # HOLD and LAND are one press; space is HOLD wherever no text is typed, here on CUT itself.
        await page.keyboard.press("Space")
        await until(lambda: console.stops.calls[2:] == [("hold", None)])
        await page.get_by_test_id("land").click()
        await until(lambda: console.stops.calls[2:] == [("hold", None), ("land", None)])


@built
async def test_who_flies_is_in_command_until_they_take_leave(tmp_path: Path, page: Page) -> None:
    async with serve(tmp_path, dist=DIST) as console:
        signs = console.mission.operator
        await dashboard(console, page)
        command = page.get_by_test_id("in-command")
        # A stop is no flying: whoever only watches and stops is not missed when they go.
        await page.get_by_test_id("land").click()
        await until(lambda: len(console.stops.calls) == 1)
        await expect(command).to_have_count(0)
        assert signs == []

        await page.get_by_test_id("capture-start").click()
        await page.get_by_test_id("preflight-start").click()
        await expect(command).to_contain_text("This tab is in command")
        await until(lambda: len(signs) >= 3)  # The first at once, then from the worker's timer.

        # Closing or reloading asks first, as drones fly; the tab that was reloaded goes on.
        asked: list[str] = []

        async def accept(dialog: Dialog) -> None:
            asked.append(dialog.type)
            await dialog.accept()

        page.on("dialog", accept)
        await page.reload()
        await expect(command).to_be_visible()
        assert asked == ["beforeunload"]
        before = len(signs)
        await until(lambda: len(signs) > before + 1)
        assert "left" not in signs

        leave = page.get_by_test_id("leave-unattended")
        await leave.click()
        await expect(leave).to_have_text("Leave? Nobody watches")
        assert "left" not in signs
        await leave.click()
        await expect(command).to_have_count(0)
        await until(lambda: signs[-1] == "left")


@built
async def test_a_grounded_capture_says_what_to_do(tmp_path: Path, page: Page) -> None:
    async with serve(tmp_path, dist=DIST) as console:
        console.mission.checks = checklist(link_failed("drone-3"))
        console.mission.keep(capture_changed("run-1", "paused", "grounded"))
        await dashboard(console, page)
        card = page.get_by_test_id("grounded")
        await expect(card).to_contain_text("4 of 24 pictures are safe")
        await expect(card).to_contain_text("does not answer")
        await page.get_by_test_id("capture-resume").click()
        await until(lambda: console.mission.records["run-1"].status.state == "running")


@built
@pytest.mark.parametrize("prefix", ["", "/lab/drones"])
async def test_pages_obey_their_own_policy_and_find_everything(
    tmp_path: Path, page: Page, prefix: str
) -> None:
    """Sign in, dashboard and 3D scene, with no content refused; also below a proxy's path."""
    refused: list[str] = []
    await page.add_init_script(
        "addEventListener('securitypolicyviolation', (event) => console.error("
        "`policy: ${event.violatedDirective} ${event.blockedURI} ${event.sourceFile}`))"
    )
    page.on("console", lambda m: refused.append(m.text) if m.text.startswith("policy") else None)
    missing: list[str] = []
    page.on("response", lambda r: missing.append(r.url) if r.status == 404 else None)
    async with SceneView() as scene, serve(tmp_path, scene.port, DIST, prefix) as console:
        await page.goto(f"{console.http}{prefix}/")
        main = page.locator("main")
        assert await main.evaluate("element => getComputedStyle(element).fontSize") == "16px"
        width = await page.locator("body").evaluate("body => getComputedStyle(body).maxWidth")
        assert width == "416px", "the plain page's own style sheet is applied"
        await page.fill("#token", TOKEN)
        await page.click("button")
        for drone_id in DRONES:
            await expect(page.get_by_test_id(f"tile-{drone_id}")).to_be_visible()
        await page.goto(f"{console.http}{prefix}/#/plan")
        frame = page.frame_locator("[data-testid=scene-frame]")
        await expect(frame.locator("canvas").first).to_be_visible(timeout=30_000)
        policy = (await page.request.get(f"{console.http}{prefix}/")).headers
        assert "unsafe" not in policy["content-security-policy"]
    assert refused == []
    assert missing == []


@built
async def test_a_drone_is_flown_by_hand_as_long_as_a_key_is_held(
    tmp_path: Path, page: Page
) -> None:
    async with serve(tmp_path, dist=DIST) as console:
        calls = console.mission.calls
        await dashboard(console, page)
        await page.keyboard.down("w")
        await page.get_by_test_id("manual-drone-2").click()
        await expect(page.get_by_role("button", name="Ahead")).to_be_visible()
        rest = ("steer", ("drone-2", AT_REST))
        await until(lambda: bool(calls))
        await asyncio.sleep(0.5)
        assert calls == [rest], "a key that was held before means nothing"
        await page.keyboard.up("w")
        await page.keyboard.down("w")
        await page.keyboard.down("q")
        await until(lambda: len(calls) > 5)
        assert calls[-1] == ("steer", ("drone-2", Sticks(1.0, 0.0, 0.0, 1.0)))
        await page.keyboard.up("q")
        await page.keyboard.up("w")
        await until(lambda: calls[-1] == rest)
        said = len(calls)
        # A button is held by the mouse; the space bar stops all, whatever is held.
        button = page.get_by_role("button", name="Back")
        await button.hover()
        await page.mouse.down()
        await until(lambda: calls[-1] == ("steer", ("drone-2", Sticks(-1.0, 0.0, 0.0, 0.0))))
        await page.keyboard.press("Space")
        await until(lambda: console.stops.calls == [("hold", None)])
        await page.mouse.up()
        await until(lambda: calls[-1] == rest)
        assert len(calls) > said
        # A capture that begins takes the sticks away.
        console.mission.events.publish(capture_changed("run-7"))
        await expect(page.get_by_test_id("manual-drone-2")).to_have_count(0)


@built
async def test_the_field_is_turned_while_it_is_trained(tmp_path: Path, page: Page) -> None:
    def views() -> list[FieldView]:
        said = [what for call, what in console.mission.calls if call == "view"]
        return [view for view in said if isinstance(view, FieldView)]

    async with serve(tmp_path, dist=DIST) as console:
        console.mission.keep(capture_changed("run-1", "running", "train"))
        await dashboard(console, page)
        await page.keyboard.press("3")
        publish = console.mission.events.publish
        publish(TrainingProgressed("train", 10, 1.0, 60.0, 0.1, 18.0, None, 5e5, 10))
        seen_from = FieldView(0.5, 0.2, 1.0)
        publish(PreviewRendered(jpeg(grey=90), np.eye(4), TELLO_INTRINSICS, seen_from))
        preview = page.get_by_test_id("preview-turned")
        box = await preview.bounding_box()
        assert box is not None
        middle = box["x"] + box["width"] / 2.0, box["y"] + box["height"] / 2.0
        await page.mouse.move(*middle)
        await page.mouse.down()
        await page.mouse.move(middle[0] + box["width"] / 4.0, middle[1], steps=8)
        await page.mouse.up()
        # It begins where the newest rendering was seen from, and what is grabbed comes along.
        await until(lambda: bool(views()) and abs(views()[-1].azimuth_rad + 0.285) < 0.02)
        assert views()[-1].elevation_rad == pytest.approx(0.2)
        await preview.focus()
        await page.keyboard.press("+")
        await until(lambda: views()[-1].distance < 1.0)
        await page.get_by_test_id("orbit").click()
        await until(lambda: console.mission.calls[-1] == ("view", None))
