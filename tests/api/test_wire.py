"""The manners of the REST interface: keys, pages, conditions, bounds, a prefix."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from pathlib import Path

import httpx
import pytest
from fake_mission import capture_changed
from served_console import Console, serve, until
from test_rest import is_problem, make_run

from server.api.problems import CODES, TYPE_PREFIX

pytestmark = pytest.mark.loopback

CAPTURES = "/api/v1/captures"
KEY = {"Idempotency-Key": "8e03978e-40d5-43dd-bc93-6894a57f9324"}


async def test_a_post_that_is_repeated_with_its_key_is_carried_out_once(console: Console) -> None:
    async with console.client() as client:
        first = await client.post(CAPTURES, json={"name": "cow"}, headers=KEY)
        again = await client.post(CAPTURES, json={"name": "cow"}, headers=KEY)
        assert (first.status_code, again.status_code) == (202, 202)
        assert again.json() == first.json()
        assert again.headers["location"] == first.headers["location"]
        assert again.headers["idempotency-replayed"] == "true"
        assert "idempotency-replayed" not in first.headers
        other = await client.post(CAPTURES, json={"name": "pig"}, headers=KEY)
        assert is_problem(other, 409)["code"] == "key_reused"
        is_problem(await client.post(CAPTURES, headers={"Idempotency-Key": "x" * 300}), 422)
        _, token = console.ring.add("somebody else", "operator")
        theirs = {"Authorization": f"Bearer {token}"} | KEY
        # Another's key is another key: this one is carried out, and refused.
        is_problem(await client.post(CAPTURES, json={"name": "cow"}, headers=theirs), 409)
    assert len(console.mission.records) == 1


async def test_a_key_under_way_is_refused_and_a_refusal_is_not_kept(console: Console) -> None:
    console.mission.hangs = True
    async with console.client() as client:
        first = asyncio.create_task(client.post(CAPTURES, headers=KEY))
        await until(lambda: len(console.mission.calls) == 1)
        assert is_problem(await client.post(CAPTURES, headers=KEY), 409)["code"] == "key_in_use"
        console.mission.released.set()
        assert (await first).status_code == 202
        later = {"Idempotency-Key": "later"}
        is_problem(await client.post(CAPTURES, headers=later), 409)  # One runs already.
        console.mission.keep(capture_changed("run-1", "succeeded"))
        assert (await client.post(CAPTURES, headers=later)).status_code == 202


async def test_stops_are_carried_out_each_time_whatever_key_they_carry(console: Console) -> None:
    drone = "/api/v1/drones/drone-2/commands"
    too_long = {"Idempotency-Key": "x" * 300}
    async with console.client() as client:
        for headers in (KEY, KEY, too_long):
            answers = [
                await client.post("/api/v1/fleet/hold", headers=headers),
                await client.post(drone, json={"command": "land"}, headers=headers),
                await client.post(drone, json={"command": "cut_motors"}, headers=headers),
            ]
            assert [answer.status_code for answer in answers] == [202, 202, 202]
            assert not any("idempotency-replayed" in answer.headers for answer in answers)
    once = [("hold", None), ("land", "drone-2"), ("cut_motors", "drone-2")]
    assert console.stops.calls == 3 * once


async def all_pages(client: httpx.AsyncClient, path: str, **query: str | int) -> list[list[str]]:
    pages = []
    answer = await client.get(path, params=query)
    while True:
        pages.append([item.get("path") or item["id"] for item in answer.json()])
        if "next" not in answer.links:
            return pages
        answer = await client.get(answer.links["next"]["url"])


async def test_lists_come_in_pages(console: Console) -> None:
    for number in range(5):
        console.mission.keep(capture_changed(f"run-{number}", "succeeded"), metrics={})
    make_run(console)
    async with console.client() as client:
        for path in (CAPTURES, "/api/v1/reconstructions"):
            console.mission.keep(capture_changed("run-1", "succeeded"), metrics={})
            pages = await all_pages(client, path, limit=2)
            assert pages == [["run-4", "run-3"], ["run-2", "run-1"], ["run-0"]]
        console.mission.keep(capture_changed("run-2", "failed"))
        assert await all_pages(client, CAPTURES, state="failed", limit=1) == [["run-2"]]
        files = await all_pages(client, "/api/v1/artifacts", limit=2)
        assert files == [["images/000.jpg", "page.html"], ["transforms.json"]]
        one_by_one = await all_pages(client, "/api/v1/artifacts", capture="run-1", limit=1)
        assert one_by_one == [["images/000.jpg"], ["page.html"], ["transforms.json"]]
        for cursor in ("no", "run-1/", "/", "%00", "\U0001f600"):
            for path in (CAPTURES, "/api/v1/artifacts", "/api/v1/jobs"):
                assert (await client.get(path, params={"cursor": cursor})).status_code == 200
        is_problem(await client.get(CAPTURES, params={"limit": 0}), 422)


async def test_a_run_that_goes_meanwhile_leaves_no_gap(console: Console) -> None:
    for number in range(4):
        console.mission.keep(capture_changed(f"run-{number}", "succeeded"))
    async with console.client() as client:
        first = await client.get(CAPTURES, params={"limit": 2})
        assert (await client.delete(f"{CAPTURES}/run-3")).status_code == 204
        console.mission.keep(capture_changed("run-9", "succeeded"))
        second = await client.get(first.links["next"]["url"])
        assert [capture["id"] for capture in second.json()] == ["run-1", "run-0"]


async def test_files_are_sent_once_and_in_parts(console: Console) -> None:
    file = make_run(console) / "transforms.json"
    file.write_text('{"frames": []}')
    url = "/api/v1/artifacts/run-1/transforms.json"
    async with console.client() as client:
        whole = await client.get(url)
        etag = {"If-None-Match": whole.headers["etag"]}
        same = await client.get(url, headers=etag)
        assert (same.status_code, same.content) == (304, b"")
        assert same.headers["etag"] == whole.headers["etag"]
        dated = {"If-Modified-Since": whole.headers["last-modified"]}
        assert (await client.get(url, headers=dated)).status_code == 304
        assert (await client.get(url, headers={"If-Match": '"other"'})).status_code == 412
        part = await client.get(url, headers={"Range": "bytes=2-7"})
        assert (part.status_code, part.text) == (206, "frames")
        beyond = await client.get(url, headers={"Range": "bytes=500-"})
        assert beyond.headers["content-range"] == "bytes */14"
        assert is_problem(beyond, 416)["code"] == "no_range"
        head = await client.head(url)
        assert (head.content, head.headers["content-length"]) == (b"", "14")
        assert head.headers["etag"] == whole.headers["etag"]
        file.write_text('{"frames": [1]}')
        assert (await client.get(url, headers=etag)).status_code == 200
        # A part of the old file is not mixed with one of the new.
        ranged = {"Range": "bytes=2-7", "If-Range": whole.headers["etag"]}
        assert (await client.get(url, headers=ranged)).status_code == 200


async def test_head_is_answered_wherever_get_is(console: Console) -> None:
    async with console.client() as client:
        for path in ("/livez", "/metrics", CAPTURES, "/api/v1/openapi.json"):
            answer = await client.head(path)
            assert (answer.status_code, answer.content) == (200, b"")
        assert (await client.head("/api/v1/fleet/hold")).status_code == 405
    assert console.stops.calls == []


async def test_large_bodies_are_refused_however_they_come(console: Console) -> None:
    async def stream() -> AsyncIterator[bytes]:
        for _ in range(100):
            yield b'"' * 10_000

    json = {"Content-Type": "application/json"}
    async with console.client() as client:
        told = await client.post(CAPTURES, content=b" " * 1_000_000, headers=json)
        assert is_problem(told, 413)["code"] == "too_large"
    async with console.client() as client:
        untold = await client.post(CAPTURES, content=stream(), headers=json)
        is_problem(untold, 413)
    assert console.mission.calls == []


async def test_every_problem_has_a_type_that_the_document_names(console: Console) -> None:
    async with console.client() as client:
        document = (await client.get("/api/v1/openapi.json")).json()
        named = document["components"]["schemas"]["Problem"]["properties"]["type"]["enum"]
        assert named == [TYPE_PREFIX + code for code in CODES]
        for path in ("/nothing", f"{CAPTURES}/none", f"{CAPTURES}?limit=no", "/api/v1/fleet/hold"):
            problem = (await client.get(path)).json()
            assert problem["type"] in named
            assert problem["type"].endswith(f":{problem['code']}")


async def test_behind_a_proxy_s_path(tmp_path: Path) -> None:
    async with serve(tmp_path, prefix="/lab/drones") as console:
        make_run(console)
        async with console.client() as client:
            for strip in ("/lab/drones", ""):  # Proxies take the path away, or do not.
                made = await client.post(f"{strip}{CAPTURES}", json={"name": "cow"})
                assert made.headers["location"].startswith(f"/lab/drones{CAPTURES}/")
                await client.post(made.headers["location"] + "/abort")
                (picture, *_) = (await client.get(f"{strip}/api/v1/artifacts")).json()
                assert picture["url"].startswith("/lab/drones/api/v1/artifacts/run-1/")
                assert (await client.get(picture["url"])).status_code == 200
            assert (await client.get("/lab/drones")).headers["location"] == "/lab/drones/"
            paged = await client.get(f"/lab/drones{CAPTURES}", params={"limit": 1})
            assert paged.links["next"]["url"].startswith(f"/lab/drones{CAPTURES}?")
        async with console.client(signed_in=False) as browser:
            login = await browser.get("/lab/drones/")
            assert 'action="login"' in login.text
            token = console.headers["Authorization"].split()[1]
            signed = await browser.post("/lab/drones/login", data={"token": token})
            assert signed.headers["location"] == "/lab/drones/"
            assert "path=/lab/drones/" in signed.headers["set-cookie"].lower()
            assert (await browser.get("/lab/drones/api/v1/me")).status_code == 200
