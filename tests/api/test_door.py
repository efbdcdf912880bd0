"""Who may come in: decided without a server first, then over real connections."""

from __future__ import annotations

import asyncio

import httpx
import pytest
from hypothesis import given
from hypothesis import strategies as st
from served_console import TOKEN, Console
from starlette.datastructures import Headers
from websockets.asyncio.client import connect
from websockets.exceptions import InvalidStatus

from server.api.access import KeyRing
from server.api.door import Door, is_own_origin

RING = KeyRing(TOKEN)


class Clock:
    def __init__(self) -> None:
        self.now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


def bearer(token: str) -> Headers:
    return Headers({"authorization": f"Bearer {token}"})


@given(st.text(alphabet=st.characters(max_codepoint=255)))
def test_only_the_token_opens(guess: str) -> None:
    assert (Door(RING).visitor(bearer(guess)) is not None) == (guess.strip() == TOKEN)


@pytest.mark.parametrize("token", ["", "two words", "naïve", "line\n"])
def test_tokens_that_no_header_can_carry_are_refused(token: str) -> None:
    with pytest.raises(ValueError, match="token"):
        KeyRing(token)


def test_a_session_id_is_neither_token_nor_bearer() -> None:
    door = Door(RING)
    session_id = door.sessions.open(RING.own)
    assert TOKEN not in session_id
    assert door.visitor(bearer(session_id)) is None
    assert door.visitor(Headers({"cookie": f"{door.cookie_name}={TOKEN}"})) is None
    assert door.visitor(Headers({"cookie": f"a=b; {door.cookie_name}={session_id}"})) == RING.own


def test_two_consoles_on_one_host_have_cookies_of_their_own() -> None:
    assert Door(KeyRing("one-token")).cookie_name != Door(KeyRing("another")).cookie_name


@pytest.mark.parametrize(
    ("host", "origin", "own"),
    [
        ("127.0.0.1:8000", None, True),
        ("127.0.0.1:8000", "http://127.0.0.1:8000", True),
        ("Lab.local:8000", "http://lab.LOCAL:8000", True),
        ("console.example", "https://console.example", True),
        ("console.example:443", "https://console.example", True),
        ("127.0.0.1:8000", "http://127.0.0.1:8001", False),
        ("127.0.0.1:8000", "http://localhost:8000", False),
        ("127.0.0.1:8000", "http://evil.example", False),
        ("127.0.0.1:8000", "http://127.0.0.1:8000.evil.example", False),
        ("127.0.0.1:8000", "null", False),
        ("127.0.0.1:8000", "", False),
        ("127.0.0.1:8000", "file://", False),
        ("127.0.0.1:8000", "http://[", False),
        ("", "http://", False),
    ],
)
def test_origins(host: str, origin: str | None, own: bool) -> None:
    fields = {"host": host} | ({} if origin is None else {"origin": origin})
    assert is_own_origin(Headers(fields)) is own


PATHS = ["/api/v1/drones", "/api/v1/captures", "/metrics", "/scene/", "/assets/x.js", "/nothing"]


@pytest.mark.loopback
async def test_without_the_token_everything_is_401(console: Console) -> None:
    async with console.client(signed_in=False) as client:
        for path in PATHS:
            for headers in ({}, {"Authorization": "Bearer wrong"}, {"Cookie": "dronerf=1"}):
                response = await client.get(path, headers=headers)
                assert response.status_code == 401, path
                assert response.headers["content-type"] == "application/problem+json"
                assert response.headers["www-authenticate"].startswith("Bearer")
        assert (await client.post("/api/v1/fleet/hold")).status_code == 401
        assert (await client.post("/api/v1/fleet/cut-motors")).status_code == 401
        login = await client.get("/")
        assert login.status_code == 401
        assert '<form method="post" action="login">' in login.text
    assert console.stops.calls == []


@pytest.mark.loopback
async def test_the_printed_address_exchanges_the_token_for_a_cookie(console: Console) -> None:
    async with console.client(signed_in=False) as client:
        response = await client.get("/", params={"token": TOKEN})
        assert response.status_code == 303
        assert response.headers["location"] == "/"
        assert response.headers["cache-control"] == "no-store"
        cookie = response.headers["set-cookie"].lower()
        assert "httponly" in cookie
        assert "samesite=strict" in cookie
        assert TOKEN not in cookie
        assert (await client.get("/api/v1/drones")).status_code == 200


@pytest.mark.loopback
async def test_the_login_form_does_the_same(console: Console) -> None:
    async with console.client(signed_in=False) as client:
        wrong = await client.post("/login", data={"token": "guess"})
        assert wrong.status_code == 401
        assert "not the token" in wrong.text
        assert "set-cookie" not in wrong.headers
        own = {"Origin": console.http}
        assert (await client.post("/login", data={"token": TOKEN}, headers=own)).status_code == 303
        assert (await client.get("/api/v1/drones")).status_code == 200
    async with console.client(signed_in=False) as client:
        huge = await client.post("/login", content=b"a" * 100_000)
        assert huge.status_code == 401


@pytest.mark.loopback
async def test_other_origins_may_not_change_anything(console: Console) -> None:
    foreign = {"Origin": "http://evil.example"}
    async with console.client() as client:
        refused = await client.post("/api/v1/fleet/cut-motors", headers=foreign)
        assert refused.status_code == 403
        assert refused.headers["content-type"] == "application/problem+json"
        assert console.stops.calls == []
        own = {"Origin": console.http}
        assert (await client.post("/api/v1/fleet/hold", headers=own)).status_code == 202
    assert console.stops.calls == [("hold", None)]


async def _refusal(url: str, headers: dict[str, str], origin: str | None) -> int:
    with pytest.raises(InvalidStatus) as caught:
        async with connect(url, additional_headers=headers, origin=origin, proxy=None):  # type: ignore[arg-type]
            pass
    return caught.value.response.status_code


@pytest.mark.loopback
@pytest.mark.parametrize("path", ["/api/v1/stream", "/scene", "/nothing", "/"])
async def test_sockets_need_the_token_and_our_origin(console: Console, path: str) -> None:
    url = console.socket + path
    assert await _refusal(url, {}, None) == 401
    assert await _refusal(url, {"Authorization": "Bearer wrong"}, None) == 401
    assert await _refusal(url, console.headers, "http://evil.example") == 403


@pytest.mark.loopback
async def test_a_cookie_opens_the_stream_from_our_own_page_only(console: Console) -> None:
    async with console.client(signed_in=False) as client:
        await client.get("/", params={"token": TOKEN})
        cookie = {"Cookie": "; ".join(f"{n}={v}" for n, v in client.cookies.items())}
    url = console.socket + "/api/v1/stream"
    async with connect(url, additional_headers=cookie, origin=console.http, proxy=None) as socket:  # type: ignore[arg-type]
        async with asyncio.timeout(5):
            assert await socket.recv()
    assert await _refusal(url, cookie, "http://evil.example") == 403


@pytest.mark.loopback
async def test_refused_requests_do_not_break_keep_alive(console: Console) -> None:
    limits = httpx.Limits(max_connections=1)
    async with httpx.AsyncClient(base_url=console.http, limits=limits, trust_env=False) as client:
        for _ in range(3):
            assert (await client.post("/api/v1/captures", json={})).status_code == 401
