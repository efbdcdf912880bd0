"""HEAD for every GET, and in a 405 the methods that a path does know."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping

from starlette.routing import compile_path
from starlette.types import ASGIApp, Message, Receive, Scope, Send


class HeadAsGet:
    """ASGI middleware that answers HEAD as GET would be answered, less the body."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Hand on, a HEAD as a GET."""
        if scope["type"] != "http" or scope["method"] != "HEAD":
            await self._app(scope, receive, send)
            return

        async def bodiless(message: Message) -> None:
            if message["type"] == "http.response.body":
                if message.get("more_body", False):
                    return
                message = {**message, "body": b""}
            await send(message)

        # A copy: the server still has to know that this was a HEAD.
        await self._app({**scope, "method": "GET"}, receive, bodiless)


def make_allowed(paths: Mapping[str, Mapping[str, object]]) -> Callable[[str], str | None]:
    """Return what gives the header ``Allow`` of a path, by the ``paths`` of an OpenAPI document.

    It gives None for a path that the document does not describe.
    """
    known: list[tuple[re.Pattern[str], set[str]]] = []
    for template, operations in paths.items():
        # A file's path is the one parameter that holds slashes.
        pattern, _, _ = compile_path(template.replace("{path}", "{path:path}"))
        known.append((pattern, {method.upper() for method in operations}))

    def allowed(path: str) -> str | None:
        methods: set[str] = set()
        for pattern, names in known:
            if pattern.match(path):
                methods |= names
        if "GET" in methods:
            methods.add("HEAD")
        return ", ".join(sorted(methods)) or None

    return allowed
