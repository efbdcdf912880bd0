"""The fields trained anew on a capture, over REST."""

from __future__ import annotations

import asyncio
import json
import os
from datetime import UTC, datetime
from pathlib import Path

import pytest
from fake_mission import capture_changed
from served_console import Console, runner_of, serve, until
from test_rest import is_problem

from server.jobs.heartbeat import Heartbeat
from server.jobs.spec import JobSpec

TRAININGS = "/api/v1/captures/run-1/trainings"
ENDED_UNIX_S = datetime(2026, 5, 1, 12, 2, tzinfo=UTC).timestamp()


def keep_capture(console: Console, run: str = "run-1") -> Path:
    folder = console.mission.runs / run
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "transforms.json").write_text("{}")
    (folder / "capture.json").write_text("{}")
    console.mission.keep(capture_changed(run, "succeeded"))
    return folder


def keep_training(console: Console, name: str, **settings: object) -> Path:
    """Leave a training anew in the library, as an earlier console would have."""
    folder = console.mission.runs / name
    parameters = {"source": "dataset", "dataset": str(console.mission.runs / "run-1")}
    parameters |= {"train_seconds": 30.0, "object_only": False} | settings
    JobSpec("reconstruct", parameters, seed=5).write(folder / "jobs/reconstruct")
    metrics = {"dataset": parameters["dataset"], "psnr_db": 22.5, "ssim": float("nan")}
    (folder / "metrics.json").write_text(json.dumps(metrics))
    (folder / "mesh.glb").write_bytes(b"mesh")
    return folder


@pytest.mark.loopback
async def test_trainings_of_before_are_listed_with_settings_figures_and_files(
    console: Console,
) -> None:
    keep_capture(console)
    ended = keep_training(console, "20260501-120000-train-run-1", object_only=True)
    for file in (path for path in ended.rglob("*") if path.is_file()):
        os.utime(file, (ENDED_UNIX_S, ENDED_UNIX_S))
    keep_training(console, "20260502-120000-train-run-1", train_seconds=90.0)
    keep_training(console, "20260503-120000-train-other", dataset="/nowhere/else")
    async with console.client() as client:
        answer = await client.get(TRAININGS)
        second, first = answer.json()
        assert [each["id"] for each in (first, second)] == [
            "20260501-120000-train-run-1",
            "20260502-120000-train-run-1",
        ]
        assert first["created_at"] == "2026-05-01T12:00:00Z"
        assert first["updated_at"] == "2026-05-01T12:02:00Z"
        assert (first["state"], first["job"], first["error"]) == ("succeeded", None, None)
        assert (first["seconds"], first["seed"], first["object_only"]) == (30.0, 5, True)
        assert (second["seconds"], second["object_only"]) == (90.0, False)
        assert (first["metrics"]["psnr_db"], first["metrics"]["ssim"]) == (22.5, None)
        paths = {file["path"]: file for file in first["files"]}
        assert set(paths) == {"metrics.json", "mesh.glb", "jobs/reconstruct/spec.json"}
        assert first["size_bytes"] == sum(file["size_bytes"] for file in first["files"])
        assert (await client.get(paths["mesh.glb"]["url"])).content == b"mesh"
        page = await client.get(TRAININGS, params={"limit": 1})
        assert [each["id"] for each in page.json()] == [second["id"]]
        follow = page.links["next"]["url"]
        assert [each["id"] for each in (await client.get(follow)).json()] == [first["id"]]
        is_problem(await client.get("/api/v1/captures/run-9/trainings"), 404)


@pytest.mark.loopback
async def test_a_training_is_told_from_its_order_to_its_end(
    console: Console, tmp_path: Path
) -> None:
    keep_capture(console)
    async with console.client() as client:
        for seed in (1, 2):
            body = {"capture": "run-1", "seconds": 30.0, "seed": seed}
            await client.post("/api/v1/reconstructions", json=body)
        await until(lambda: len(runner_of(console).jobs) == 1)
        told = {each["seed"]: each for each in (await client.get(TRAININGS)).json()}
        assert {seed: each["state"] for seed, each in told.items()} == {1: "running", 2: "queued"}
        assert told[2]["seconds"] == 30.0
        assert {seed: each["ahead"] for seed, each in told.items()} == {1: 0, 2: 1}
        one = f"{TRAININGS}/{told[1]['id']}"
        # What is not over takes nothing away from under it.
        for path in (one, f"{TRAININGS}/{told[2]['id']}", "/api/v1/captures/run-1"):
            is_problem(await client.delete(path), 409)
        job = runner_of(console).jobs[0]
        news = {"event": "progressed", "stage": "train", "seconds": 6.0, "seconds_total": 24.0}
        job.news.put_nowait(news)
        await until(lambda: any(each.progress == 0.25 for each in console.book.jobs()))
        running = (await client.get(TRAININGS)).json()[-1]
        assert (running["phase"], running["progress"]) == ("train", 0.25)
        # What waits has left nothing; what was cut short is there, with its reason.
        await client.post(f"/api/v1/jobs/{told[2]['job']}/cancel")
        job.news.put_nowait({"event": "failed", "error": "no memory"})
        await until(lambda: all(each.over for each in console.book.jobs()))
        (failed,) = (await client.get(TRAININGS)).json()
        assert (failed["state"], failed["error"], failed["job"]) == ("failed", "no memory", None)
    async with serve(tmp_path) as later:
        later.mission.records = console.mission.records
        async with later.client() as client:
            (again,) = (await client.get(TRAININGS)).json()
            assert (again["id"], again["seed"]) == (failed["id"], 1)


@pytest.mark.loopback
async def test_one_is_deleted_and_nothing_beside_it(console: Console) -> None:
    capture = keep_capture(console)
    keep_capture(console, "run-2")
    one = keep_training(console, "20260501-120000-train-run-1")
    other = keep_training(console, "20260502-120000-train-run-1")
    secret = console.mission.runs.parent / "secret"
    secret.mkdir()
    (secret / "metrics.json").write_text(json.dumps({"dataset": str(capture)}))
    (console.mission.runs / "link").symlink_to(secret)
    async with console.client() as client:
        for name in ("run-1", "run-2", "link", "..%2Fsecret", "none"):
            answer = await client.delete(f"{TRAININGS}/{name}")
            assert answer.status_code in (404, 405), name
        is_problem(await client.delete(f"/api/v1/captures/run-2/trainings/{one.name}"), 404)
        is_problem(await client.delete(f"/api/v1/captures/{one.name}"), 404)
        assert one.is_dir()
        assert (await client.delete(f"{TRAININGS}/{one.name}")).status_code == 204
        assert not one.exists()
        assert [each["id"] for each in (await client.get(TRAININGS)).json()] == [other.name]
        assert capture.is_dir()
        assert (secret / "metrics.json").is_file()
        assert (await client.delete("/api/v1/captures/run-1")).status_code == 204
        assert not capture.exists()
        assert not other.exists()
        assert (console.mission.runs / "run-2").is_dir()


@pytest.mark.loopback
async def test_what_somebody_else_trains_is_not_deleted(console: Console) -> None:
    keep_capture(console)
    training = keep_training(console, "20260501-120000-train-run-1")
    (training / "metrics.json").unlink()
    Heartbeat(training / "jobs/reconstruct")
    async with console.client() as client:
        (running,) = (await client.get(TRAININGS)).json()
        age_s = datetime.now(UTC) - datetime.fromisoformat(running["updated_at"])
        assert (running["state"], age_s.total_seconds() < 60.0) == ("running", True)
        answer = await client.delete(f"{TRAININGS}/{training.name}")
        is_problem(answer, 409)
        # All of it is there, and the answer says nothing else.
        assert answer.json()["detail"].startswith(f"the training {training.name} is not over")
        assert training.is_dir()


@pytest.mark.loopback
async def test_a_capture_that_is_being_deleted_is_left_alone(
    console: Console, monkeypatch: pytest.MonkeyPatch
) -> None:
    keep_capture(console)
    training = keep_training(console, "20260501-120000-train-run-1")
    begun, go_on = asyncio.Event(), asyncio.Event()
    delete = console.mission.delete_capture

    async def slowly(capture_id: str) -> None:
        begun.set()
        await go_on.wait()
        await delete(capture_id)

    monkeypatch.setattr(console.mission, "delete_capture", slowly)
    async with console.client() as client, asyncio.timeout(20.0):
        deletion = asyncio.create_task(client.delete("/api/v1/captures/run-1"))
        await begun.wait()
        for answer in (
            await client.post("/api/v1/reconstructions", json={"capture": "run-1"}),
            await client.delete(f"{TRAININGS}/{training.name}"),
            await client.delete("/api/v1/captures/run-1"),
            await client.post("/api/v1/captures/run-1/resume"),
        ):
            is_problem(answer, 409)
            assert answer.json()["detail"] == "run-1 is being deleted; wait until that is done"
        go_on.set()
        assert (await deletion).status_code == 204
        is_problem(await client.post("/api/v1/reconstructions", json={"capture": "run-1"}), 404)
    assert console.book.jobs() == []
