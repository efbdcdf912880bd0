"""The calibration of a camera over REST: with real pictures of a board, and what refuses it."""

from __future__ import annotations

import asyncio
import io
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import httpx
import numpy as np
import pytest
from fake_camera import LENS, board_shown
from fake_mission import capture_changed
from PIL import Image
from served_console import Console
from test_rest import is_problem

from server.swarm.fleet_file import load_fleet
from server.vision.calibration_board import DEFAULT_BOARD, BoardFinder, parse_board

pytestmark = pytest.mark.loopback

FLEET = "".join(f'[[drones]]\naddress = "10.0.0.{n}"\n' for n in range(1, 5))


def path(drone_id: str = "drone-1", rest: str = "") -> str:
    return f"/api/v1/drones/{drone_id}/calibration{rest}"


async def until(
    client: httpx.AsyncClient, holds: Callable[[dict[str, Any]], bool]
) -> dict[str, Any]:
    async with asyncio.timeout(60.0):
        while True:
            state = (await client.get(path())).json()
            if holds(state):
                return state
            await asyncio.sleep(0.02)


@pytest.mark.slow
async def test_from_the_first_view_into_the_fleet_file(console: Console, tmp_path: Path) -> None:
    file = tmp_path / "fleet.toml"
    file.write_text(FLEET)
    console.mission.fleet_file = file
    console.mission.cameras["drone-1"].pictures = board_shown()
    async with console.client() as client:
        idle = (await client.get(path())).json()
        assert (idle["state"], idle["views"], idle["file"]) == ("idle", 0, str(file))
        assert idle["coverage"] == [[0] * 8] * 6
        begun = await client.post(path())
        assert begun.status_code == 202
        assert begun.json()["state"] == "collecting"
        half = await until(client, lambda state: state["views"] >= 5)
        assert sum(map(sum, half["coverage"])) > 5 * 8
        assert max(half["tilted"]) > 0
        done = await until(client, lambda state: state["state"] == "solved")
        camera = done["result"]
        assert camera["fx"] == pytest.approx(LENS.fx, rel=0.01)
        assert camera["mean_px"] < 0.3
        assert len(camera["distortion"]) == 5
        assert camera["views_kept"] + camera["views_dropped"] == 12
        assert 0.5 < camera["coverage"] <= 1.0
        assert "[drones.intrinsics]" in camera["toml"]
        coverage = await client.get(path(rest="/coverage.png"))
        assert coverage.headers["content-type"] == "image/png"
        picture = cv2.imdecode(np.frombuffer(coverage.content, np.uint8), cv2.IMREAD_COLOR)
        assert picture is not None
        assert picture.shape == (LENS.height, LENS.width, 3)
        used = (await client.post(path(rest="/apply"))).json()
        assert used["applied"] == {
            "file": str(file),
            "backup": str(tmp_path / "fleet.toml.bak"),
            "problem": "",
        }
        (place, *_) = (await client.get("/api/v1/fleet")).json()["places"]
        assert place["calibrated"] is True
        assert place["focal_px"] == pytest.approx(camera["fx"])
        forgotten = (await client.delete(path())).json()
        assert (forgotten["state"], forgotten["result"]) == ("idle", None)
        is_problem(await client.get(path(rest="/coverage.png")), 404)
    assert load_fleet(file).drones[0].intrinsics.fx == pytest.approx(camera["fx"], abs=1e-3)


async def test_what_the_views_lack_is_named_and_can_be_made_good(console: Console) -> None:
    console.mission.cameras["drone-1"].pictures = board_shown(3)
    async with console.client() as client:
        await client.post(path(), json={"go_on": False})
        await until(client, lambda state: state["views"] >= 2)
        finished = await client.post(path(rest="/finish"))
        assert finished.status_code == 202
        refused = await until(client, lambda state: state["state"] == "refused")
        assert (refused["lack"], refused["result"]) == ("few_views", None)
        assert "10 are needed" in refused["reason"]
        is_problem(await client.post(path(rest="/apply")), 409)
        again = (await client.post(path(), json={"go_on": True})).json()
        assert (again["state"], again["views"]) == ("collecting", refused["views"])
        cancelled = (await client.delete(path())).json()
        assert (cancelled["state"], cancelled["ending"]) == ("ended", "cancelled")


async def test_refusals(console: Console) -> None:
    cameras = console.mission.cameras
    for camera in cameras.values():
        camera.video_wanted = False
    async with console.client() as client:
        for method, rest in (
            ("GET", ""),
            ("POST", ""),
            ("DELETE", ""),
            ("POST", "/finish"),
            ("POST", "/apply"),
            ("GET", "/board.png"),
            ("GET", "/coverage.png"),
        ):
            is_problem(await client.request(method, path("drone-9", rest)), 404)
        is_problem(await client.post(path(), json={"board": "charuco:60x60:1000:900"}), 422)
        is_problem(await client.post(path(rest="/finish")), 409)

        cameras["drone-1"].activity = "offline"
        answer = await client.post(path())
        assert "does not answer" in str(is_problem(answer, 409)["detail"])
        cameras["drone-1"].activity = "ground"
        cameras["drone-2"].airborne = True
        answer = await client.post(path())
        assert "drone-2 in the air" in str(is_problem(answer, 409)["detail"])
        cameras["drone-2"].airborne = False
        console.mission.keep(capture_changed("run-1", "running"))
        answer = await client.post(path())
        assert "a capture is active" in str(is_problem(answer, 409)["detail"])
        console.mission.keep(capture_changed("run-1", "succeeded"))
        assert not any(camera.videos for camera in cameras.values())
        assert (await client.post(path())).status_code == 202
        answer = await client.post(path("drone-2"))
        assert "drone-1 is being calibrated" in str(is_problem(answer, 409)["detail"])
        # A capture that begins ends it.
        console.mission.keep(capture_changed("run-2", "running"))
        over = await until(client, lambda state: state["state"] == "ended")
        assert over["ending"] == "capture"
    # Only the one that was begun had its video turned on, and off again in the end.
    videos = {drone_id: camera.videos for drone_id, camera in cameras.items() if camera.videos}
    assert videos == {"drone-1": [True, False]}


async def test_a_browser_that_only_watches_starts_nothing(console: Console) -> None:
    async with console.client() as client:
        flown = {"X-Dronerf-Client": "flies"}
        await client.post(
            "/api/v1/drones/drone-2/commands", json={"command": "takeoff"}, headers=flown
        )
        for method, rest in (("POST", ""), ("POST", "/finish"), ("POST", "/apply"), ("DELETE", "")):
            watching = {"X-Dronerf-Client": "watches"}
            answer = await client.request(method, path(rest=rest), headers=watching)
            assert is_problem(answer, 409)["code"] == "not_in_command"
        assert (await client.get(path(), headers={"X-Dronerf-Client": "watches"})).is_success


async def test_the_board_comes_to_be_printed(console: Console) -> None:
    async with console.client() as client:
        picture = await client.get(path(rest="/board.png"))
        assert picture.headers["content-type"] == "image/png"
        sheet = await client.get(path(rest="/board.pdf"))
        assert sheet.content.startswith(b"%PDF")
        assert 'filename="dronerf-board.pdf"' in sheet.headers["content-disposition"]
    with Image.open(io.BytesIO(picture.content)) as image:
        shown = np.asarray(image.convert("L").reduce(4), np.uint8)
    view = BoardFinder(parse_board(DEFAULT_BOARD)).find(shown)
    assert view is not None
    assert len(view.ids) == 24


async def test_hold_is_answered_while_a_board_is_searched(
    console: Console, monkeypatch: pytest.MonkeyPatch
) -> None:
    busy, go = threading.Event(), threading.Event()

    def find(*_: object) -> None:
        busy.set()
        go.wait(20.0)

    monkeypatch.setattr(BoardFinder, "find", find)
    console.mission.cameras["drone-1"].pictures = [np.zeros((360, 480, 3), np.uint8)]
    async with console.client() as client:
        await client.post(path())
        await asyncio.to_thread(busy.wait, 20.0)
        async with asyncio.timeout(5.0):
            assert (await client.post("/api/v1/fleet/hold")).status_code == 202
            assert (await client.delete(path())).json()["state"] == "ended"
        go.set()
    assert console.stops.calls == [("hold", None)]
