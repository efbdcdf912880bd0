"""How the application is served: uvicorn's settings that matter here."""

from __future__ import annotations

from pathlib import Path

import uvicorn
from fastapi import FastAPI

# Client messages are tiny, but the 3D viewer may send pictures of itself through the bridge.
_WEBSOCKET_LIMIT_BYTES = 64 * 1024 * 1024


def uvicorn_config(
    web: FastAPI,
    host: str = "127.0.0.1",
    port: int = 0,
    tls: tuple[Path, Path] | None = None,
) -> uvicorn.Config:
    """Return the server configuration for ``web`` at ``host`` and ``port`` (0 picks a free one).

    With ``tls``, certificate (chain) and key in PEM, it speaks HTTPS alone.

    The application needs its lifespan (it follows the event log in it). A server that is given
    open sockets takes those instead of ``host`` and ``port``.

    The access log stays off and uvicorn's logger at warnings: both write query strings, and the
    printed address carries the token in its query string.
    """
    return uvicorn.Config(
        web,
        host=host,
        port=port,
        ssl_certfile=None if tls is None else tls[0],
        ssl_keyfile=None if tls is None else str(tls[1]),
        log_config=None,
        log_level="warning",
        access_log=False,
        server_header=False,
        lifespan="on",
        # Video tiles are JPEG already; deflating them would only burn the processor.
        ws_per_message_deflate=False,
        ws_max_size=_WEBSOCKET_LIMIT_BYTES,
        ws_ping_interval=10.0,
        ws_ping_timeout=20.0,
        timeout_graceful_shutdown=3,
    )
