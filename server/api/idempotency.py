"""``Idempotency-Key``: a POST that is sent again is answered again, not carried out again.

A program that does not know whether its POST arrived repeats it with the same key: the second one
gets the first one's answer, with ``Idempotency-Replayed: true``. A refusal is not kept, for nothing
was done; a key is bound to who asked, the path and the body. Answers are kept in memory for a day:
what a restart of the console forgets, it has also ended.

Stops are carried out whenever they come, whatever key they carry: a script that uses one key for
every HOLD must not find its second one answered from memory while drones fly.

After draft-ietf-httpapi-idempotency-key-header.
"""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import get_args

from starlette.datastructures import Headers
from starlette.responses import Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from server.api.bodies import body_again
from server.api.problems import problem_response
from server.mission.commands import StopCommand

HEADER = "Idempotency-Key"
LONGEST_KEY = 255
_KEPT_S = 24 * 3600.0
_MOST_KEPT = 1000


@dataclass(slots=True)
class _Kept:
    """One answer; ``status`` is 0 while it is being worked out."""

    request: str
    until_s: float
    status: int = 0
    headers: list[tuple[bytes, bytes]] = field(default_factory=list)
    body: bytes = b""


class Idempotency:
    """ASGI middleware that keeps the answers to POSTs with a key; needs the whole body at once."""

    def __init__(self, app: ASGIApp, clock: Callable[[], float] = time.monotonic) -> None:
        self._app = app
        self._clock = clock
        self._kept: dict[tuple[str, str], _Kept] = {}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer as before, or hand on and keep the answer."""
        key = Headers(scope=scope).get(HEADER) if scope["type"] == "http" else None
        if key is None or scope["method"] != "POST":
            await self._app(scope, receive, send)
            return
        message = await receive()
        body = message.get("body", b"")
        if _is_stop(scope["path"], body):
            await self._app(scope, body_again(body, receive), send)
            return
        if not 1 <= len(key) <= LONGEST_KEY or not all("!" <= each <= "~" for each in key):
            text = f"{HEADER} must have 1 to {LONGEST_KEY} visible ASCII characters."
            await problem_response(422, text)(scope, receive, send)
            return
        request = hashlib.sha256(scope["path"].encode() + b"\0" + body).hexdigest()
        visitor = scope.get("state", {}).get("visitor")
        name = ("" if visitor is None else visitor.id, key)
        known = self._known(name)
        if known is not None:
            await _answer_again(known, request)(scope, receive, send)
            return
        entry = self._kept[name] = _Kept(request, self._clock() + _KEPT_S)
        try:
            await self._app(scope, body_again(body, receive), _recording(entry, send))
        finally:
            # What was not done can be asked for again; so can what nobody knows the end of.
            if not 200 <= entry.status < 300:
                self._kept.pop(name, None)

    def _known(self, name: tuple[str, str]) -> _Kept | None:
        now_s = self._clock()
        for old in [each for each, kept in self._kept.items() if now_s >= kept.until_s]:
            del self._kept[old]
        while len(self._kept) >= _MOST_KEPT:
            del self._kept[next(iter(self._kept))]
        return self._kept.get(name)


def _is_stop(path: str, body: bytes) -> bool:
    """Return whether a POST stops drones."""
    if path.startswith("/api/v1/fleet/"):
        return True
    if not (path.startswith("/api/v1/drones/") and path.endswith("/commands")):
        return False
    try:
        wanted = json.loads(body)
    except ValueError:
        return False
    return isinstance(wanted, dict) and wanted.get("command") in get_args(StopCommand)


def _answer_again(kept: _Kept, request: str) -> Response:
    if kept.request != request:
        return problem_response(
            409, "This Idempotency-Key was used for another request.", code="key_reused"
        )
    if kept.status == 0:
        return problem_response(
            409, "The first request with this key is still under way.", code="key_in_use"
        )
    response = Response(kept.body, kept.status)
    response.raw_headers = [*kept.headers, (b"idempotency-replayed", b"true")]
    return response


def _recording(entry: _Kept, send: Send) -> Send:
    started = 0

    async def record(message: Message) -> None:
        nonlocal started
        if message["type"] == "http.response.start":
            entry.headers, started = list(message.get("headers", [])), message["status"]
        elif message["type"] == "http.response.body":
            entry.body += message.get("body", b"")
            if not message.get("more_body", False):
                entry.status = started  # Only a whole answer can be given again.
        await send(message)

    return record
