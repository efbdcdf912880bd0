"""Behind a proxy that serves the console below a path of its own, as ``/drones``.

It does not matter whether the proxy takes the path away before it hands a request on. Redirects,
and where else a header tells an address of ours, are told with the path.
"""

from __future__ import annotations

import re

from starlette.datastructures import MutableHeaders
from starlette.responses import RedirectResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

_PREFIX = re.compile(r"(/[A-Za-z0-9._~-]+)+")


def checked_prefix(prefix: str) -> str:
    """Return ``prefix`` without a slash at its end; raises ValueError when it is no path."""
    prefix = prefix.rstrip("/")
    if prefix and not _PREFIX.fullmatch(prefix):
        raise ValueError(f"a path prefix is like /drones, not {prefix!r}")
    return prefix


class BehindPrefix:
    """ASGI middleware that takes ``prefix`` from the paths that come in and adds it going out."""

    def __init__(self, app: ASGIApp, prefix: str) -> None:
        self._app = app
        self._prefix = prefix

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Hand on without the prefix."""
        if not self._prefix or scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        if scope["path"] == self._prefix and scope["type"] == "http":
            # Addresses in our pages are relative: they need the slash.
            await RedirectResponse(f"{self._prefix}/", 308)(scope, receive, send)
            return
        if scope["path"].startswith(f"{self._prefix}/"):
            raw = scope.get("raw_path") or b""
            scope = {
                **scope,
                "path": scope["path"].removeprefix(self._prefix),
                "raw_path": raw.removeprefix(self._prefix.encode()),
            }
        await self._app(scope, receive, self._adding(send))

    def _adding(self, send: Send) -> Send:
        async def add(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                if headers.get("location", "").startswith("/"):
                    headers["location"] = self._prefix + headers["location"]
                if headers.get("link", "").startswith("</"):
                    headers["link"] = f"<{self._prefix}{headers['link'][1:]}"
            await send(message)

        return add
