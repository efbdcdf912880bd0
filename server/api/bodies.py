"""How large a request may be: its body is read whole before anybody works with it, or refused."""

from __future__ import annotations

from starlette.datastructures import Headers
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from server.api.problems import problem_response

# So much of a body that is too large is read and dropped: many clients listen only after they have
# sent everything. Beyond it the connection is closed on them.
_STILL_READ = 16 * 1024 * 1024


class BoundedBodies:
    """ASGI middleware that answers 413 to a body of more than ``limit`` bytes."""

    def __init__(self, app: ASGIApp, limit: int) -> None:
        self._app = app
        self._limit = limit

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Read the body and hand on, or refuse."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        told = Headers(scope=scope).get("content-length", "0")
        # Of a body that is much too large nothing is read.
        size = int(told) if told.isdecimal() and int(told) > _STILL_READ else 0
        body = b""
        more = size == 0
        while more:
            message = await receive()
            if message["type"] != "http.request":
                return  # Whoever asked is gone.
            part = message.get("body", b"")
            size += len(part)
            if size <= self._limit:
                body += part
            more = message.get("more_body", False) and size <= _STILL_READ
        if size > self._limit:
            text = f"No request here needs more than {self._limit} bytes."
            refusal = problem_response(413, text, headers={"Connection": "close"})
            await refusal(scope, receive, send)
            return
        await self._app(scope, body_again(body, receive), send)


def body_again(body: bytes, receive: Receive) -> Receive:
    """Return a ``receive`` that gives ``body`` first, and then what else comes."""
    given = False

    async def again() -> Message:
        nonlocal given
        if given:
            return await receive()
        given = True
        return {"type": "http.request", "body": body, "more_body": False}

    return again
