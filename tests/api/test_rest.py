"""The REST interface over a real server and a real client."""

from __future__ import annotations

import asyncio
import json
import logging
import math
import re
from dataclasses import replace
from pathlib import Path

import httpx
import pytest
from fake_mission import DRONES, JPEG, capture_changed, frame, plan_found
from served_console import Console, until

from server.jobs.spec import JobSpec
from server.mission.commands import CaptureRequest
from server.mission.config import MissionConfig
from server.mission.events import FailsafeFired, FieldView, Noted, PlanProgressed, PlanViewChosen

pytestmark = pytest.mark.loopback


def is_problem(response: httpx.Response, status: int) -> dict[str, object]:
    assert response.status_code == status
    assert response.headers["content-type"] == "application/problem+json"
    document = response.json()
    assert document["status"] == status
    assert document["title"]
    return document


async def test_drones_are_listed_in_fleet_order(console: Console) -> None:
    async with console.client() as client:
        reports = (await client.get("/api/v1/drones")).json()
    assert [report["drone_id"] for report in reports] == list(DRONES)
    assert reports[0]["battery_pct"] == 80
    assert reports[0]["link_age_s"] == 0.4


async def test_newest_frame_or_a_reason(console: Console) -> None:
    async with console.client() as client:
        is_problem(await client.get("/api/v1/drones/drone-1/frame.jpg"), 404)
        is_problem(await client.get("/api/v1/drones/nobody/frame.jpg"), 404)
        console.mission.frames["drone-1"] = frame(sequence=7)
        response = await client.get("/api/v1/drones/drone-1/frame.jpg")
    assert response.content == JPEG
    assert response.headers["content-type"] == "image/jpeg"
    assert response.headers["x-frame-sequence"] == "7"
    assert response.headers["cache-control"] == "no-store"


@pytest.mark.parametrize(
    ("path", "call"), [("hold", "hold"), ("land", "land"), ("cut-motors", "cut_motors")]
)
async def test_fleet_stops_reach_stop_control_while_the_mission_hangs(
    console: Console, path: str, call: str
) -> None:
    console.mission.hangs = True
    async with console.client() as client:
        stuck = [
            asyncio.create_task(client.post("/api/v1/captures", timeout=60)) for _ in range(50)
        ]
        await until(lambda: len(console.mission.calls) == 50)
        async with console.client() as operator:
            response = await operator.post(f"/api/v1/fleet/{path}")
        for task in stuck:
            task.cancel()
        await asyncio.gather(*stuck, return_exceptions=True)
    assert response.status_code == 202
    assert console.stops.calls == [(call, None)]


@pytest.mark.parametrize("command", ["hold", "land", "cut_motors"])
async def test_stops_of_one_drone_bypass_the_mission(console: Console, command: str) -> None:
    async with console.client() as client:
        path = "/api/v1/drones/drone-2/commands"
        response = await client.post(path, json={"command": command})
        unknown = await client.post("/api/v1/drones/nobody/commands", json={"command": command})
    assert response.status_code == 202
    is_problem(unknown, 404)
    assert console.stops.calls == [(command, "drone-2")]
    assert console.mission.calls == []
    assert console.mission.stops_told == [(command, "drone-2")]


async def test_a_stop_counts_even_where_it_cannot_be_told(console: Console) -> None:
    console.mission.speechless = True
    async with console.client() as client:
        response = await client.post("/api/v1/fleet/land")
    assert response.status_code == 202
    assert console.stops.calls == [("land", None)]


async def test_other_commands_go_to_the_mission(console: Console) -> None:
    async with console.client() as client:
        path = "/api/v1/drones/drone-2/commands"
        assert (await client.post(path, json={"command": "takeoff"})).status_code == 202
        refused = is_problem(await client.post(path, json={"command": "rearm"}), 409)
        is_problem(await client.post(path, json={"command": "dance"}), 422)
        is_problem(await client.post(path, json={"command": "hold", "hard": True}), 422)
        is_problem(await client.post(path, content=b"{"), 422)
        is_problem(
            await client.post("/api/v1/drones/nobody/commands", json={"command": "takeoff"}), 404
        )
    assert refused["detail"] == "drone-2 is not held"
    assert refused["code"] == "refused"
    assert console.stops.calls == []
    assert console.mission.calls[0] == ("takeoff", "drone-2")


async def test_a_long_take_off_is_accepted_before_it_ends(console: Console) -> None:
    console.mission.hangs = True
    async with console.client() as client:
        path = "/api/v1/drones/drone-1/commands"
        response = await client.post(path, json={"command": "takeoff"})
    assert response.status_code == 202


async def test_a_field_is_seen_from_where_it_is_wanted(console: Console) -> None:
    console.mission.keep(capture_changed("run-1", "running", "train"))
    console.mission.keep(capture_changed("run-2", "succeeded", "done"))
    path = "/api/v1/captures/run-1/view"
    wish = {"azimuth_rad": 1.0, "elevation_rad": 0.5, "distance": 0.8}
    async with console.client() as client:
        assert (await client.put(path, json=wish)).status_code == 204
        assert (await client.delete(path)).status_code == 204
        for senseless in ({}, wish | {"elevation_rad": 1.6}, wish | {"distance": 0.0}):
            is_problem(await client.put(path, json=senseless), 422)
        is_problem(await client.put("/api/v1/captures/run-2/view", json=wish), 409)
        is_problem(await client.delete("/api/v1/captures/run-9/view"), 404)
    assert console.mission.calls == [("view", FieldView(1.0, 0.5, 0.8)), ("view", None)]


async def test_a_capture_from_start_to_abort(console: Console) -> None:
    async with console.client() as client:
        started = await client.post("/api/v1/captures", json={"mode": "standard", "name": "cow"})
        assert started.status_code == 202
        location = started.headers["location"]
        assert location == "/api/v1/captures/run-1"
        again = await client.post("/api/v1/captures")
        assert is_problem(again, 409)["detail"] == "a capture is running"
        shown = (await client.get(location)).json()
        assert shown == started.json()
        assert {"id", "state", "phase", "progress", "eta_s", "run", "error"} <= shown.keys()
        wanted = shown["images_total"]
        more = await client.post(location + "/pictures", json={"count": 4})
        assert more.json()["images_total"] == wanted + 4
        for senseless in ({}, {"count": 0}, {"count": 1.5}, {"count": 401}, {"counts": 4}):
            is_problem(await client.post(location + "/pictures", json=senseless), 422)
        assert (await client.post(location + "/pause")).json()["state"] == "paused"
        is_problem(await client.post(location + "/pause"), 409)
        is_problem(await client.post(location + "/pictures", json={"count": 4}), 409)
        assert (await client.post(location + "/resume")).json()["state"] == "running"
        assert (await client.post(location + "/abort")).json()["state"] == "aborted"
        is_problem(await client.post("/api/v1/captures/run-9/abort"), 404)
        assert [c["id"] for c in (await client.get("/api/v1/captures")).json()] == ["run-1"]
    asked = console.mission.calls[0][1]
    assert asked == CaptureRequest(mode="standard", name="cow")


async def test_a_whole_number_may_be_written_with_a_point(console: Console) -> None:
    async with console.client() as client:
        answer = await client.post("/api/v1/captures", json={"pictures": 8.0, "drones": 2.0})
    assert answer.status_code == 202
    assert console.mission.calls == [("start", CaptureRequest(pictures=8, drones=2))]


async def test_a_capture_needs_no_body(console: Console) -> None:
    async with console.client() as client:
        assert (await client.post("/api/v1/captures")).status_code == 202
    assert console.mission.calls == [("start", CaptureRequest())]


@pytest.mark.parametrize(
    ("body", "field"),
    [
        ({"mode": "best"}, "body.mode"),
        ({"pictures": "24"}, "body.pictures"),
        ({"pictures": 24.5}, "body.pictures"),
        ({"pictures": True}, "body.pictures"),
        ({"pictures": 0}, "body.pictures"),
        ({"drones": 0}, "body.drones"),
        ({"train_seconds": -1}, "body.train_seconds"),
        ({"name": "../../etc"}, "body.name"),
        ({"name": "a\nb"}, "body.name"),
        ({"speed": 3}, "body.speed"),
    ],
)
async def test_bad_capture_requests_name_the_field(
    console: Console, body: dict[str, object], field: str
) -> None:
    async with console.client() as client:
        problem = is_problem(await client.post("/api/v1/captures", json=body), 422)
    errors = problem["errors"]
    assert isinstance(errors, list)
    assert [error["field"] for error in errors] == [field]
    assert console.mission.calls == []


async def test_infinite_training_is_refused(console: Console) -> None:
    async with console.client() as client:
        response = await client.post("/api/v1/captures", content=b'{"train_seconds": Infinity}')
    is_problem(response, 422)


async def test_numbers_that_no_capture_can_have_are_422(console: Console) -> None:
    async with console.client() as client:
        for body in ({"pictures": 4000}, {"drones": 9}, {"train_seconds": 1e6}):
            is_problem(await client.post("/api/v1/captures", json=body), 422)
    assert console.mission.calls == []


async def test_numbers_that_this_mission_cannot_have_are_refused(console: Console) -> None:
    async with console.client() as client:
        response = await client.post("/api/v1/captures", json={"drones": 5})
    assert is_problem(response, 409)["detail"] == "drones must be 1 to 4, not 5"


async def test_metrics_and_reconstructions_exist_only_when_measured(console: Console) -> None:
    console.mission.keep(capture_changed("run-1", "running"))
    async with console.client() as client:
        is_problem(await client.get("/api/v1/captures/run-1/metrics"), 404)
        assert (await client.get("/api/v1/reconstructions")).json() == []
        console.mission.keep(
            capture_changed("run-1", "succeeded"),
            metrics={"psnr_db": 21.5, "psnr_db_object": float("nan")},
        )
        metrics = (await client.get("/api/v1/captures/run-1/metrics")).json()
        assert metrics == {"psnr_db": 21.5, "psnr_db_object": None}
        found = (await client.get("/api/v1/reconstructions")).json()
    assert [view["id"] for view in found] == ["run-1"]


async def test_the_event_log_goes_on_where_one_left_off(console: Console) -> None:
    async with console.client() as client:
        for text in ("one", "two", "three"):
            console.mission.events.publish(Noted("info", text, "drone-1"))
        await asyncio.sleep(0)
        page = (await client.get("/api/v1/events", params={"limit": 2})).json()
        assert [line["text"] for line in page["events"]] == ["one", "two"]
        rest = (await client.get("/api/v1/events", params={"since": page["next"]})).json()
        assert [line["text"] for line in rest["events"]] == ["three"]
        end = (await client.get("/api/v1/events", params={"since": rest["next"]})).json()
        is_problem(await client.get("/api/v1/events", params={"since": -1}), 422)
    assert end == {"events": [], "next": rest["next"]}


async def test_the_plan_belongs_to_the_newest_capture(console: Console) -> None:
    async with console.client() as client:
        assert (await client.get("/api/v1/plans")).json() == []
        console.mission.events.publish(capture_changed("run-1"))
        console.mission.events.publish(plan_found())
        await asyncio.sleep(0)
        (plan,) = (await client.get("/api/v1/plans")).json()
        assert plan["capture_id"] == "run-1"
        assert plan["terms"] == {"coverage": 0.9, "overlap": None}  # NaN is not JSON.
        assert len(plan["viewpoints"]) == 8
        assert plan["viewpoints"][5]["round_index"] == 1
        console.mission.events.publish(capture_changed("run-2"))
        await asyncio.sleep(0)
        assert (await client.get("/api/v1/plans")).json() == []


def make_run(console: Console) -> Path:
    folder = console.mission.runs / "run-1"
    (folder / "images").mkdir(parents=True)
    (folder / "images" / "000.jpg").write_bytes(JPEG)
    (folder / "transforms.json").write_text("{}")
    (folder / "page.html").write_text("<script>alert(1)</script>")
    (folder / ".partial").write_text("not yet")
    (console.mission.runs / "secret.txt").write_text("secret")
    (folder / "link.txt").symlink_to(console.mission.runs / "secret.txt")
    console.mission.keep(capture_changed("run-1", "succeeded"))
    return folder


async def test_the_ring_stands_beside_the_plan_to_compare_with(console: Console) -> None:
    console.mission.keep(capture_changed("run-1"))
    plan = plan_found()
    compared = replace(plan, ring=plan_found(rounds=1).assignment)
    async with console.client() as client:
        for event, views in ((plan, 0), (compared, 4)):
            console.mission.events.publish(event)
            await asyncio.sleep(0)
            (told,) = (await client.get("/api/v1/plans")).json()
            assert len(told["ring"]) == views
            assert len(told["viewpoints"]) == 8


async def test_a_plan_tells_how_it_was_found(console: Console) -> None:
    def progressed(iteration: int, fitness: float) -> PlanProgressed:
        return PlanProgressed(iteration, 4000, 1e-3, fitness)

    console.mission.events.publish(capture_changed("run-1"))
    for event in (progressed(0, 0.1), progressed(2000, 0.2), progressed(0, 0.6)):
        console.mission.events.publish(event)
    console.mission.events.publish(progressed(2000, 0.7))
    console.mission.events.publish(plan_found())
    async with console.client() as client:
        (plan,) = (await client.get("/api/v1/plans")).json()
    # An annealing that begins anew leaves nothing of the last one.
    assert [step["fitness"] for step in plan["annealing"]] == [0.6, 0.7]
    assert [step["iteration"] for step in plan["annealing"]] == [0, 2000]


async def test_the_scene_shows_what_was_chosen(console: Console) -> None:
    with console.mission.events.subscribe() as subscription:
        async with console.client() as client:
            for shown in ("ring", "both", "planned"):
                answer = await client.put("/api/v1/plans/view", json={"shown": shown})
                assert answer.status_code == 204
                event = await anext(aiter(subscription))
                assert isinstance(event, PlanViewChosen)
                assert event.shown == shown
            is_problem(await client.put("/api/v1/plans/view", json={"shown": "nothing"}), 422)


async def test_a_capture_is_deleted_once_it_is_over(console: Console) -> None:
    folder = console.mission.runs / "run-1"
    folder.mkdir(parents=True)
    console.mission.keep(capture_changed("run-1", "running"))
    async with console.client() as client:
        is_problem(await client.delete("/api/v1/captures/run-1"), 409)
        assert folder.is_dir()
        console.mission.keep(capture_changed("run-1", "succeeded"))
        assert (await client.delete("/api/v1/captures/run-1")).status_code == 204
        assert not folder.exists()
        is_problem(await client.delete("/api/v1/captures/run-1"), 404)
        assert (await client.get("/api/v1/captures")).json() == []


async def test_a_capture_keeps_its_star_until_it_is_taken_back(console: Console) -> None:
    folder = console.mission.runs / "run-1"
    folder.mkdir(parents=True)
    console.mission.keep(replace(capture_changed("run-1", "succeeded"), run=str(folder)))
    async with console.client() as client:
        for method, starred in (("PUT", True), ("PUT", True), ("DELETE", False), ("DELETE", False)):
            answer = await client.request(method, "/api/v1/captures/run-1/star")
            assert answer.status_code == 204
            assert (folder / "starred").exists() is starred
            assert (await client.get("/api/v1/captures/run-1")).json()["starred"] is starred
        is_problem(await client.put("/api/v1/captures/run-9/star"), 404)


async def test_the_floor_plan_says_where_each_drone_stands(console: Console) -> None:
    async with console.client() as client:
        plan = (await client.get("/api/v1/fleet")).json()
    assert [place["drone_id"] for place in plan["places"]] == list(DRONES)
    assert plan["start_radius_m"] == 1.8
    for place in plan["places"]:
        assert math.hypot(place["x_m"], place["y_m"]) == pytest.approx(1.8)
        ahead = (math.cos(place["yaw_rad"]), math.sin(place["yaw_rad"]))
        inwards = (-place["x_m"] / 1.8, -place["y_m"] / 1.8)
        assert ahead == pytest.approx(inwards, abs=1e-3)


async def test_settings_are_told_with_their_meaning(console: Console) -> None:
    console.mission.mission_config = MissionConfig(control_rate_hz=10.0)
    async with console.client() as client:
        settings = (await client.get("/api/v1/settings")).json()
    rate = next(each for each in settings if each["name"] == "control_rate_hz")
    assert rate == {
        "group": "mission",
        "name": "control_rate_hz",
        "value": 10.0,
        "default": 15.0,
        "meaning": "How often setpoints are computed and sent.",
        "variable": "DRONERF_MISSION__CONTROL_RATE_HZ",
        "least": None,
        "more_than": 0.0,
        "most": None,
    }


async def test_artifacts_are_listed_and_handed_out(console: Console) -> None:
    make_run(console)
    async with console.client() as client:
        listed = (await client.get("/api/v1/artifacts", params={"capture": "run-1"})).json()
        assert [a["path"] for a in listed] == ["images/000.jpg", "page.html", "transforms.json"]
        assert (await client.get("/api/v1/artifacts")).json() == listed
        picture = await client.get(listed[0]["url"])
        assert picture.content == JPEG
        assert picture.headers["content-type"] == "image/jpeg"
        part = await client.get(listed[0]["url"], headers={"Range": "bytes=0-9"})
        assert part.status_code == 206
        assert part.content == JPEG[:10]
        page = await client.get(listed[1]["url"])
        assert page.headers["content-disposition"].startswith("attachment")
        is_problem(await client.get("/api/v1/artifacts", params={"capture": "run-9"}), 404)
        is_problem(await client.get("/api/v1/artifacts/run-9/images/000.jpg"), 404)


@pytest.mark.parametrize(
    "path",
    [
        "../secret.txt",
        "%2e%2e/secret.txt",
        "..%2fsecret.txt",
        "images/../../secret.txt",
        "images/%2e%2e/%2e%2e/secret.txt",
        "..%5csecret.txt",
        "%2fetc/passwd",
        "/etc/passwd",
        "link.txt",
        ".partial",
        "images",
        "transforms.json%00",
    ],
)
async def test_no_way_leads_out_of_a_run_folder(console: Console, path: str) -> None:
    make_run(console)
    # Written by hand: a client library would tidy the path up before sending it.
    host, port = console.address.split(":")
    reader, writer = await asyncio.open_connection(host, int(port))
    head = f"GET /api/v1/artifacts/run-1/{path} HTTP/1.1\r\nHost: {console.address}\r\n"
    auth = f"Authorization: {console.headers['Authorization']}\r\nConnection: close\r\n\r\n"
    writer.write((head + auth).encode())
    answer = await reader.read()
    writer.close()
    await writer.wait_closed()
    assert answer.startswith((b"HTTP/1.1 404", b"HTTP/1.1 400"))
    assert b"secret\n" not in answer
    assert not answer.endswith(b"secret")


async def test_whatever_is_not_there_is_a_problem_document(console: Console) -> None:
    async with console.client() as client:
        is_problem(await client.get("/api/v1/nothing"), 404)
        is_problem(await client.get("/nothing/at/all"), 404)
        is_problem(await client.get("/scene/"), 404)
        wrong = await client.get("/api/v1/fleet/hold")
        is_problem(wrong, 405)
        other = await client.delete("/api/v1/captures")
        is_problem(other, 405)
    assert wrong.headers["allow"] == "POST"
    assert other.headers["allow"] == "GET, HEAD, POST"
    assert console.stops.calls == []


async def test_a_failure_is_a_problem_document_without_details(
    console: Console, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def fail() -> list[object]:
        raise RuntimeError("inner workings")

    monkeypatch.setattr(console.mission, "drones", fail)
    async with console.client() as client:
        response = await client.get("/api/v1/drones")
    is_problem(response, 500)
    assert "inner workings" not in response.text
    assert "inner workings" in caplog.text


async def test_health_is_open_and_metrics_are_not(console: Console) -> None:
    console.mission.keep(capture_changed())
    async with console.client(signed_in=False) as client:
        assert (await client.get("/livez")).json() == {"status": "live"}
        assert (await client.get("/readyz")).json() == {"status": "ready"}
        is_problem(await client.get("/metrics"), 401)
    async with console.client() as client:
        text = (await client.get("/metrics")).text
    assert 'dronerf_build_info{version="0.1.0"} 1' in text
    assert 'dronerf_drone_battery_ratio{drone="drone-1"} 0.8' in text
    assert "dronerf_capture_progress_ratio 0.25" in text
    assert "dronerf_stream_clients 0" in text
    dropped = "dronerf_drone_datagrams_dropped_total"
    assert f'{dropped}{{drone="drone-1",reason="garbage"}} 3' in text
    assert 'dronerf_drone_datagrams_unsent_total{drone="drone-1"} 5' in text
    assert 'dronerf_video_overflows_total{drone="drone-1"} 2' in text
    assert "dronerf_disk_free_bytes 2500000000" in text


async def test_metrics_count_failsafes_and_jobs(console: Console) -> None:
    for drone_id in ("drone-1", "drone-2"):
        console.mission.events.publish(
            FailsafeFired(drone_id, "battery_pct", 15.0, "land", 14.0, "battery at 14 %")
        )
    async with console.client() as client:
        async with asyncio.timeout(5.0):
            fired = 'dronerf_failsafes_fired_total{event="battery_pct",action="land"} 2'
            while fired not in (text := (await client.get("/metrics")).text):  # noqa: ASYNC110
                await asyncio.sleep(0.01)
        assert "# TYPE dronerf_jobs gauge" in text
        assert "dronerf_jobs{" not in text
        runs = console.mission.runs
        console.book.request(JobSpec("plan", {}), runs / "job", runs)
        text = (await client.get("/metrics")).text
    assert re.search(r'dronerf_jobs\{kind="plan",state="(queued|running)"\} 1', text)


async def test_the_dashboard_is_served_when_built(console: Console) -> None:
    async with console.client() as client:
        unbuilt = await client.get("/")
        assert unbuilt.status_code == 503
        assert "make web" in unbuilt.text
        (console.dist / "assets").mkdir(parents=True)
        (console.dist / "index.html").write_text("<h1>Console</h1>")
        (console.dist / "icon.svg").write_text("<svg/>")
        (console.dist / "assets" / "main-1234.js").write_text("export {};")
        index = await client.get("/")
        assert index.text == "<h1>Console</h1>"
        assert index.headers["cache-control"] == "no-cache"
        script = await client.get("/assets/main-1234.js")
        assert "javascript" in script.headers["content-type"]
        assert "immutable" in script.headers["cache-control"]
        assert (await client.get("/icon.svg")).status_code == 200
        is_problem(await client.get("/assets/../../runs/x"), 404)
        is_problem(await client.get("/assets/none.js"), 404)


async def test_every_answer_carries_the_security_headers(console: Console) -> None:
    async with console.client() as client:
        for path in ("/", "/api/v1/drones", "/livez", "/nothing/there"):
            headers = (await client.get(path)).headers
            assert "frame-ancestors 'self'" in headers["content-security-policy"]
            assert "script" not in headers["content-security-policy"]
            assert headers["x-content-type-options"] == "nosniff"
            assert headers["referrer-policy"] == "same-origin"


async def test_openapi_describes_every_path_with_a_stable_name(console: Console) -> None:
    async with console.client() as client:
        document = (await client.get("/api/v1/openapi.json")).json()
    operations = [
        operation for methods in document["paths"].values() for operation in methods.values()
    ]
    capture = document["components"]["schemas"]["CaptureSpec"]["properties"]
    assert (capture["pictures"]["minimum"], capture["pictures"]["maximum"]) == (1, 400)
    assert capture["drones"]["anyOf"][0]["maximum"] == 8
    assert capture["seed"]["minimum"] == 0
    names = [operation["operationId"] for operation in operations]
    assert len(names) == len(set(names))
    assert {"holdFleet", "startCapture", "commandDrone", "listArtifacts"} <= set(names)
    assert "HTTPValidationError" not in json.dumps(document)
    references = json.dumps(document).split('"#/components/schemas/')[1:]
    for reference in references:
        assert reference.split('"')[0] in document["components"]["schemas"]


async def test_no_token_reaches_the_log(console: Console, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    caplog.set_level(logging.WARNING, "httpx")  # The client's own log, not the server's.
    token = console.headers["Authorization"].split()[1]
    async with console.client(signed_in=False) as client:
        assert (await client.get("/", params={"token": token})).status_code == 303
        assert (await client.get("/", params={"token": token + "x"})).status_code == 401
        assert (await client.get("/api/v1/drones", params={"token": token})).status_code == 200
    assert token not in caplog.text
