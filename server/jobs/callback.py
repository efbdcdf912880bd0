"""Where workers on other machines tell their progress: a small HTTP server of the console's own.

A worker posts its new events and is answered whether it shall stop; without news it posts an empty
list as a sign of life. Each job has a token of its own, good for nothing else.
"""

from __future__ import annotations

import asyncio
import contextlib
import hmac
import json
import socket
from collections.abc import Iterator
from typing import Any

import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from server.jobs.unsignalled import UnsignalledServer

_BODY_LIMIT = 4 << 20
# A worker tells some three events a second; whoever follows it reads them at once.
_QUEUE = 4096


class Channel:
    """What one job tells, and the wish that it should stop; lives on the event loop.

    Attributes:
        stop: Set to have the worker told to stop.
        heard_s: When it was last heard, on the event loop's clock.
    """

    def __init__(self, token: str) -> None:
        self.stop = False
        self.heard_s = asyncio.get_running_loop().time()
        self._token = token
        self._next = 0
        self._events: asyncio.Queue[dict[str, Any]] = asyncio.Queue(_QUEUE)

    def opens_to(self, header: str) -> bool:
        """Return whether an ``Authorization`` header shows this job's token."""
        return hmac.compare_digest(header.encode(), f"Bearer {self._token}".encode())

    def take(self, first: int, events: list[dict[str, Any]]) -> None:
        """Take events numbered from ``first``; those taken before, and the oldest of too many, go.

        A worker repeats what it got no answer to.
        """
        self.heard_s = asyncio.get_running_loop().time()
        for event in events[max(0, self._next - first) :]:
            if self._events.full():
                self._events.get_nowait()
            self._events.put_nowait(event)
        self._next = max(self._next, first + len(events))

    async def next_event(self, timeout_s: float) -> dict[str, Any] | None:
        """Return the next event, None when there is none within ``timeout_s``."""
        with contextlib.suppress(TimeoutError):
            return await asyncio.wait_for(self._events.get(), timeout_s)
        return None


class CallbackServer:
    """Hears the workers; an async context manager.

    Args:
        sock: A bound socket to listen on.
    """

    def __init__(self, sock: socket.socket) -> None:
        self._sock = sock
        self._channels: dict[str, Channel] = {}
        self._dismissed: set[str] = set()
        web = Starlette(routes=[Route("/jobs/{job}/events", self._hear, methods=["POST"])])
        config = uvicorn.Config(
            web, log_config=None, log_level="warning", access_log=False, server_header=False
        )
        self._server = UnsignalledServer(config)
        self._serving: asyncio.Task[None] | None = None

    async def __aenter__(self) -> CallbackServer:
        self._serving = asyncio.create_task(
            self._server.serve(sockets=[self._sock]), name="job callbacks"
        )
        return self

    async def __aexit__(self, *_: object) -> None:
        self._server.should_exit = True
        if self._serving is not None:
            await asyncio.wait([self._serving], timeout=5.0)

    def dismiss(self, job: str) -> None:
        """Have a worker that may yet begin end at once."""
        self._dismissed.add(job)

    @contextlib.contextmanager
    def channel(self, job: str, token: str) -> Iterator[Channel]:
        """Yield the channel of a job; it is open until the ``with`` block ends."""
        channel = self._channels[job] = Channel(token)
        try:
            yield channel
        finally:
            del self._channels[job]

    async def _hear(self, request: Request) -> Response:
        job = request.path_params["job"]
        if job in self._dismissed:
            return JSONResponse({"error": "not wanted any more"}, status_code=410)
        channel = self._channels.get(job)
        # The same answer for an unknown job and a wrong token: nobody learns which jobs there are.
        if channel is None or not channel.opens_to(request.headers.get("authorization", "")):
            return JSONResponse({"error": "no such job or token"}, status_code=401)
        body = b""
        async for part in request.stream():
            body += part
            if len(body) > _BODY_LIMIT:
                return JSONResponse({"error": "too long"}, status_code=413)
        try:
            told = json.loads(body)
            first, events = told["first"], told["events"]
            if type(first) is not int or first < 0 or not isinstance(events, list):
                raise ValueError("no list of events")
            if not all(isinstance(event, dict) and "event" in event for event in events):
                raise ValueError("no events")
        except (ValueError, KeyError, TypeError):
            return JSONResponse({"error": "not understood"}, status_code=422)
        channel.take(first, events)
        return JSONResponse({"stop": channel.stop})
