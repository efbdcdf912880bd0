"""Roles and tokens, from outside: who may do what, and how a token comes and goes."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path

import httpx
import pytest
from fake_mission import capture_changed
from served_console import TOKEN, Console
from test_rest import is_problem
from websockets.asyncio.client import connect

from server.api.access import ROLES, KeyFile, KeyRing, Role
from server.api.attempts import Attempts
from server.api.door import needed_role

pytestmark = pytest.mark.loopback


def as_role(console: Console, role: Role) -> httpx.AsyncClient:
    _, token = console.ring.add(f"a {role}", role)
    headers = {"Authorization": f"Bearer {token}"}
    return httpx.AsyncClient(base_url=console.http, headers=headers, trust_env=False)


async def test_every_operation_asks_for_a_role(console: Console) -> None:
    """Try every operation that the document names with every role; the stops included."""
    async with console.client() as client:
        paths = (await client.get("/api/v1/openapi.json")).json()["paths"]
    refused = {
        "viewer": lambda needed: needed != "viewer",
        "operator": lambda needed: needed == "admin",
        "admin": lambda _: False,
    }
    for role in ROLES:
        async with as_role(console, role) as client:
            for path, operations in paths.items():
                for method in operations:
                    at = path.replace("{", "").replace("}", "")
                    answer = await client.request(method.upper(), at)
                    needed = needed_role(method.upper(), path)
                    assert (answer.status_code == 403) == refused[role](needed), (role, method, at)
                    if answer.status_code == 403:
                        assert is_problem(answer, 403)["code"] == "forbidden"


async def test_a_viewer_looks_and_changes_nothing(console: Console) -> None:
    console.mission.keep(capture_changed())
    async with as_role(console, "viewer") as client:
        for path in ("/api/v1/drones", "/api/v1/captures", "/metrics", "/api/v1/preflight"):
            assert (await client.get(path)).status_code == 200
        is_problem(await client.post("/api/v1/fleet/cut-motors"), 403)
        is_problem(await client.post("/api/v1/captures"), 403)
        is_problem(await client.get("/api/v1/tokens"), 403)
    assert console.mission.calls == []
    assert console.stops.calls == []


async def test_a_viewer_s_socket_takes_no_command(console: Console) -> None:
    _, token = console.ring.add("screen in the hall", "viewer")
    headers = {"Authorization": f"Bearer {token}"}
    url = console.socket + "/api/v1/stream"
    async with connect(url, additional_headers=headers, proxy=None) as socket, asyncio.timeout(10):
        await socket.send(json.dumps({"type": "take_command", "client": "hall"}))
        await socket.send(json.dumps({"type": "show_tiles", "drone_ids": []}))
        # Whatever was said before this ping has been dealt with when its answer is here.
        await (await socket.ping())
        async with console.client() as client:
            at = "/api/v1/drones/drone-1/commands"
            named = {"X-Dronerf-Client": "another"}
            assert (
                await client.post(at, json={"command": "takeoff"}, headers=named)
            ).status_code == 202
    assert console.mission.operator.count("here") <= 1  # Only what the take-off itself notes.


async def test_only_an_admin_deletes(console: Console) -> None:
    console.mission.keep(capture_changed("run-1", "succeeded"))
    async with as_role(console, "operator") as client:
        is_problem(await client.delete("/api/v1/captures/run-1"), 403)
        is_problem(await client.delete("/api/v1/captures/run-1/trainings/one"), 403)
        # To look at the field from the orbit again deletes nothing.
        is_problem(await client.delete("/api/v1/captures/run-1/view"), 409)
        assert (await client.delete("/api/v1/captures/run-1/star")).status_code == 204
        assert (await client.post("/api/v1/fleet/hold")).status_code == 202
    async with as_role(console, "admin") as client:
        assert (await client.delete("/api/v1/captures/run-1")).status_code == 204


async def test_a_token_is_told_once_kept_as_a_digest_and_taken_back(
    console: Console, tmp_path: Path
) -> None:
    async with console.client() as client:
        made = await client.post("/api/v1/tokens", json={"name": "Ana", "role": "operator"})
        assert made.status_code == 201
        token, name = made.json()["token"], made.headers["location"]
        listed = (await client.get("/api/v1/tokens")).text
        assert "Ana" in listed
        assert token not in listed
        kept = tmp_path / "tokens.json"
        assert token not in kept.read_text()
        assert TOKEN not in kept.read_text()
        assert kept.stat().st_mode & 0o077 == 0

        async with console.client(signed_in=False) as ana:
            assert (await ana.post("/login", data={"token": token})).status_code == 303
            me = (await ana.get("/api/v1/me")).json()
            assert (me["name"], me["role"]) == ("Ana", "operator")
            assert (await client.delete(name)).status_code == 204
            # The session that the token opened ends with it.
            is_problem(await ana.get("/api/v1/me"), 401)
        is_problem(await client.delete(name), 404)
        is_problem(await client.delete("/api/v1/tokens/console"), 409)
        for body in ({"name": "", "role": "viewer"}, {"name": "x", "role": "pilot"}, {}):
            is_problem(await client.post("/api/v1/tokens", json=body), 422)


def test_another_program_hands_out_tokens_to_a_console_that_runs(tmp_path: Path) -> None:
    file = tmp_path / "tokens.json"
    ring, elsewhere = KeyRing(TOKEN, file), KeyFile(file)
    key, token = elsewhere.add("door camera", "viewer")
    assert ring.find(token) == key
    assert elsewhere.remove(key.id)
    assert ring.find(token) is None


def test_a_damaged_file_lets_nobody_in_and_is_not_written_over(tmp_path: Path) -> None:
    file = tmp_path / "tokens.json"
    _, token = KeyFile(file).add("Ana", "admin")
    damaged = file.read_text().replace("admin", "emperor")
    file.write_text(damaged)
    ring = KeyRing(TOKEN, file)
    assert ring.find(token) is None
    assert ring.find(TOKEN) is not None
    with pytest.raises(ValueError, match="no file of tokens"):
        ring.add("Ben", "viewer")
    assert file.read_text() == damaged


async def test_wrong_tokens_have_to_wait_at_the_sign_in(console: Console) -> None:
    async with console.client(signed_in=False) as client:
        for _ in range(10):
            assert (await client.post("/login", data={"token": "guess"})).status_code == 401
        # By now not even the right one is tried, in neither form.
        for answer in (
            await client.post("/login", data={"token": TOKEN}),
            await client.get("/", params={"token": TOKEN}),
        ):
            assert answer.status_code == 429
            assert 0 < int(answer.headers["retry-after"]) <= 60
            assert "set-cookie" not in answer.headers
    async with console.client() as program:  # Whoever flies by a token still does.
        assert (await program.post("/api/v1/fleet/hold")).status_code == 202


def test_attempts_are_counted_per_address_over_a_while() -> None:
    attempts = Attempts(2, 60.0)
    for now_s in (0.0, 10.0):
        assert attempts.wait_s("a", now_s) == 0.0
        attempts.note("a", now_s)
    assert attempts.wait_s("a", 20.0) == pytest.approx(40.0)
    assert attempts.wait_s("b", 20.0) == 0.0
    assert attempts.wait_s("a", 60.0) == 0.0


async def test_signing_out_ends_the_session(console: Console) -> None:
    async with console.client(signed_in=False) as client:
        await client.post("/login", data={"token": TOKEN})
        assert (await client.get("/api/v1/me")).json()["role"] == "admin"
        cookie = "; ".join(f"{name}={value}" for name, value in client.cookies.items())
        assert (await client.post("/logout")).status_code == 303
        again = await client.get("/api/v1/me", headers={"Cookie": cookie})
    is_problem(again, 401)
