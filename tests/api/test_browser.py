"""What only a browser can tell: origins of forms and fetches, cookies, content policies."""

from __future__ import annotations

import asyncio
import shutil
from collections.abc import AsyncIterator
from pathlib import Path

import numpy as np
import pytest
from playwright.async_api import Error, Page, async_playwright
from served_console import TOKEN, serve

from server.geometry.cameras import TELLO_INTRINSICS, TELLO_TILT_RAD
from server.geometry.poses import camera_pose
from server.mission.events import EventStream, PoseEstimated
from server.scene.scene import SceneView
from server.stages import CameraPose

pytestmark = [pytest.mark.browser, pytest.mark.loopback, pytest.mark.slow]

# A drawing context without a graphics card.
_ARGUMENTS = ["--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]


@pytest.fixture
async def page() -> AsyncIterator[Page]:
    async with async_playwright() as playwright:
        try:
            browser = await playwright.chromium.launch(
                executable_path=shutil.which("chromium"),
                args=_ARGUMENTS,
                chromium_sandbox=False,
            )
        except Error as error:
            pytest.skip(f"no Chromium: {error.message.splitlines()[0]}")
        try:
            yield await browser.new_page()
        finally:
            await browser.close()


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
