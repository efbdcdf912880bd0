"""The 3D scene's own server, brought behind our door.

Viser asks nobody for a token and looks at no origin, so it listens on loopback only and is reached
through here: its page at ``/scene/``, its socket at ``/scene``. (Its page finds the socket at its
own address less the trailing slash.) The client names its exact version as the subprotocol; it must
be forwarded, and what the scene answers must be echoed, or the two hang up on each other.
"""

from __future__ import annotations

import asyncio
import logging
from contextlib import suppress

import httpx
from fastapi import APIRouter, WebSocket
from fastapi.responses import RedirectResponse, Response
from starlette.types import Message
from starlette.websockets import WebSocketDisconnect
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, WebSocketException
from websockets.typing import Subprotocol

from server.api.problems import ProblemError

logger = logging.getLogger(__name__)

_OPEN_TIMEOUT_S = 5.0
_INTERNAL_ERROR = 1011
_TRY_AGAIN_LATER = 1013
# Codes that tell how a connection ended but may not be sent in a close frame.
_UNSENDABLE = frozenset({1004, 1005, 1006, 1015})


def make_scene_router(scene_port: int | None) -> APIRouter:
    """Return ``/scene/`` and its socket; without a port both say that there is no scene."""
    router = APIRouter(include_in_schema=False)

    @router.get("/scene")
    async def scene() -> RedirectResponse:
        return RedirectResponse("/scene/", status_code=307)

    @router.get("/scene/")
    async def scene_page() -> Response:
        if scene_port is None:
            raise ProblemError(404, "this console runs without a 3D scene", "no_scene")
        return await _page(scene_port)

    @router.websocket("/scene")
    async def scene_socket(socket: WebSocket) -> None:
        if scene_port is None:
            await socket.close(_TRY_AGAIN_LATER)
            return
        await _bridge(socket, scene_port)

    return router


async def _page(port: int) -> Response:
    try:
        # trust_env off: a proxy from the environment has no business between us and loopback.
        async with httpx.AsyncClient(
            trust_env=False, verify=False, timeout=_OPEN_TIMEOUT_S
        ) as client:
            page = await client.get(f"http://127.0.0.1:{port}/")
    except httpx.HTTPError as error:
        raise ProblemError(502, "the 3D scene does not answer", "scene_down") from error
    if page.status_code != httpx.codes.OK:
        raise ProblemError(502, f"the 3D scene answers {page.status_code}", "scene_down")
    return Response(
        page.content,
        media_type=page.headers.get("content-type", "text/html"),
        headers={"Cache-Control": "no-cache"},
    )


async def _bridge(socket: WebSocket, port: int) -> None:
    offered = [Subprotocol(name) for name in socket.scope.get("subprotocols", [])]
    try:
        scene = await connect(
            f"ws://127.0.0.1:{port}/",
            subprotocols=offered or None,
            max_size=None,
            compression=None,
            open_timeout=_OPEN_TIMEOUT_S,
            proxy=None,
        )
    except (OSError, TimeoutError, WebSocketException) as error:
        logger.warning("the 3D scene's socket does not answer: %s", error)
        await socket.close(_TRY_AGAIN_LATER)
        return
    async with scene:
        await socket.accept(subprotocol=scene.subprotocol)
        tasks = [
            asyncio.create_task(_upwards(socket, scene), name="scene upwards"),
            asyncio.create_task(_downwards(scene, socket), name="scene downwards"),
        ]
        try:
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in tasks:
                task.cancel()
            ends = await asyncio.gather(*tasks, return_exceptions=True)
        for end in ends:
            if isinstance(end, Exception):
                logger.error("the 3D scene's bridge broke", exc_info=end)


async def _upwards(socket: WebSocket, scene: ClientConnection) -> None:
    """Carry the browser's messages to the scene until one of them leaves."""
    try:
        while True:
            message: Message = await socket.receive()
            if message["type"] == "websocket.disconnect":
                return
            payload = message.get("bytes")
            await scene.send(message["text"] if payload is None else payload)
    except ConnectionClosed:
        return


async def _downwards(scene: ClientConnection, socket: WebSocket) -> None:
    """Carry the scene's messages to the browser; pass on how the scene ended."""
    try:
        async for message in scene:
            if isinstance(message, bytes):
                await socket.send_bytes(message)
            else:
                await socket.send_text(message)
    except WebSocketDisconnect:
        return
    except ConnectionClosed:
        pass
    code = scene.close_code
    if code is None or code in _UNSENDABLE:
        code = _INTERNAL_ERROR
    with suppress(RuntimeError, WebSocketDisconnect):  # The browser may leave at the same moment.
        await socket.close(code, scene.close_reason or "")
