"""The scale of a capture from a known length, over REST."""

from __future__ import annotations

import asyncio
import json
import threading
from typing import Any

import cv2
import numpy as np
import pytest
from fake_mission import capture_changed
from served_console import Console, runner_of, until
from test_rest import is_problem

from server.geometry.boxes import Box3
from server.geometry.cameras import Intrinsics
from server.geometry.poses import look_at
from server.nerf.dataset import PosedFile, load_dataset, write_transforms
from server.nerf.pose_scale import KnownScale
from server.store.scaling import scale_by_length

CAMERA = Intrinsics(320, 240, 300.0, 300.0, 159.5, 119.5)
ENDS = np.array([[-0.2, 0.0, 0.1], [0.2, 0.05, 0.15]])
SEEMS_M = float(np.linalg.norm(ENDS[1] - ENDS[0]))
POSES = [
    look_at(np.array([1.5 * np.cos(a), 1.5 * np.sin(a), 0.7]), np.zeros(3)) for a in (0.0, 1.0, 2.0)
]


def keep_run(console: Console, state: str = "succeeded") -> None:
    console.mission.keep(capture_changed("run-1", state))
    folder = console.mission.run_folder("run-1")
    folder.mkdir(parents=True, exist_ok=True)
    for k in range(3):
        cv2.imwrite(str(folder / f"{k}.png"), np.zeros((240, 320, 3), np.uint8))
    box = Box3(np.full(3, -0.3), np.full(3, 0.3))
    files = [PosedFile(f"{k}.png", T) for k, T in enumerate(POSES)]
    write_transforms(folder, files, CAMERA, box)


def marks(pictures: tuple[int, ...] = (0, 1)) -> list[list[dict[str, Any]]]:
    seen = [[(k, CAMERA.project(end[None], POSES[k])[0][0]) for k in pictures] for end in ENDS]
    return [[{"picture": k, "x": float(p[0]), "y": float(p[1])} for k, p in end] for end in seen]


async def ask(console: Console, **body: Any) -> Any:
    async with console.client() as client:
        wish = {"length_m": 0.5, "ends": marks()} | body
        return await client.post("/api/v1/captures/run-1/scale", json=wish)


async def test_a_known_length_sets_the_scale(console: Console) -> None:
    keep_run(console)
    told = (await ask(console)).json()
    assert told["measured_m"] == pytest.approx(SEEMS_M, abs=1e-6)
    assert told["factor"] == pytest.approx(0.5 / SEEMS_M, abs=1e-6)
    assert 0.0 < told["sigma"] < 0.1
    folder = console.mission.run_folder("run-1")
    after = load_dataset(folder)
    np.testing.assert_allclose(
        after.T_world_cam[0, :3, 3], told["factor"] * POSES[0][:3, 3], atol=1e-9
    )
    kept = json.loads((folder / "scale.json").read_text())
    assert kept["length_m"] == 0.5
    # The same marks again: by now the thing is as long as it is said to be.
    assert (await ask(console)).json()["factor"] == pytest.approx(1.0, abs=1e-6)


async def test_what_tells_no_scale_is_named(console: Console) -> None:
    keep_run(console)
    is_problem(await ask(console, ends=marks((0,))), 422)
    once = marks((0, 1))
    once[0] = [once[0][0], once[0][0]]
    answer = await ask(console, ends=once)
    is_problem(answer, 422)
    assert "two pictures" in answer.json()["detail"]
    far = marks()
    far[1][0]["picture"] = 7
    answer = await ask(console, ends=far)
    is_problem(answer, 422)
    assert "no picture 7" in answer.json()["detail"]
    for bad in (0.0, -1.0, 1e9):
        is_problem(await ask(console, length_m=bad), 422)
    folder = console.mission.run_folder("run-1")
    np.testing.assert_allclose(load_dataset(folder).T_world_cam[0], POSES[0], atol=1e-12)


@pytest.mark.parametrize("state", ["running", "paused", "aborted", "interrupted", "failed"])
async def test_only_a_finished_capture_is_scaled(console: Console, state: str) -> None:
    keep_run(console, state)
    answer = await ask(console)
    is_problem(answer, 409)
    assert state in answer.json()["detail"]
    async with console.client() as client:
        wish = {"length_m": 0.5, "ends": marks()}
        is_problem(await client.post("/api/v1/captures/none/scale", json=wish), 404)


async def test_nothing_is_scaled_while_anything_works_on_it(console: Console) -> None:
    keep_run(console)
    console.mission.keep(capture_changed("run-2", "running"))
    is_problem(await ask(console), 409)  # Drones are in the air.
    console.mission.keep(capture_changed("run-2", "succeeded"))
    async with console.client() as client:
        await client.post("/api/v1/reconstructions", json={"capture": "run-1"})
        await until(lambda: len(runner_of(console).jobs) == 1)
    answer = await ask(console)
    is_problem(answer, 409)
    assert "training" in answer.json()["detail"]


async def test_a_run_without_poses_has_no_scale(console: Console) -> None:
    console.mission.keep(capture_changed("run-1", "succeeded"))
    console.mission.run_folder("run-1").mkdir(parents=True, exist_ok=True)
    answer = await ask(console)
    is_problem(answer, 409)
    assert "transforms.json" in answer.json()["detail"]


async def test_nothing_is_taken_away_or_begun_while_it_is_scaled(
    console: Console, monkeypatch: pytest.MonkeyPatch
) -> None:
    keep_run(console)
    begun, go_on = threading.Event(), threading.Event()

    def slowly(*asked: Any) -> KnownScale:
        begun.set()
        assert go_on.wait(20.0)
        return scale_by_length(*asked)

    monkeypatch.setattr("server.api.scale.scale_by_length", slowly)
    async with console.client() as client, asyncio.timeout(20.0):
        scaling = asyncio.create_task(ask(console))
        await until(begun.is_set)
        for answer in (
            await client.delete("/api/v1/captures/run-1/trainings/any"),
            await client.delete("/api/v1/captures/run-1"),
            await client.post("/api/v1/reconstructions", json={"capture": "run-1"}),
            await ask(console),
        ):
            is_problem(answer, 409)
            assert answer.json()["detail"] == "run-1 is being scaled; wait until that is done"
        go_on.set()
        assert (await scaling).status_code == 200
        assert (await client.delete("/api/v1/captures/run-1")).status_code == 204
