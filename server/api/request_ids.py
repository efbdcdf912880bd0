"""Gives every request a name that all it sets off carries, down to the datagram.

The name is a context variable: tasks and timers copy the context they are made in, so a capture's
whole mission, and the repeats of a stop, keep the name of the request that began them.
"""

from __future__ import annotations

import logging
import re
import secrets
import time
from contextvars import ContextVar

from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

logger = logging.getLogger(__name__)

REQUEST_ID: ContextVar[str | None] = ContextVar("request_id", default=None)

_HEADER = "X-Request-ID"
# What others hand us goes into log lines.
_SOUND = re.compile(r"[A-Za-z0-9._-]{1,64}")
_SAFE_METHODS = frozenset({"GET", "HEAD", "OPTIONS"})


class RequestIds:
    """ASGI middleware that names requests and logs them; the proxy's name is kept if it is sound.

    Only paths are logged: the printed address carries the token in its query.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Hand on to the application under a name."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        given = Headers(scope=scope).get(_HEADER, "")
        name = given if _SOUND.fullmatch(given) else secrets.token_hex(8)
        status = 0

        async def named(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
                MutableHeaders(scope=message)[_HEADER] = name
            await send(message)

        begun_s = time.monotonic()
        token = REQUEST_ID.set(name)
        try:
            await self._app(scope, receive, named)
        finally:
            method = scope.get("method", "WEBSOCKET")
            logger.log(
                logging.DEBUG if method in _SAFE_METHODS else logging.INFO,
                "%s %s: %d",
                method,
                scope["path"],
                status,
                extra={"seconds": round(time.monotonic() - begun_s, 4)},
            )
            REQUEST_ID.reset(token)
