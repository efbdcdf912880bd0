"""A web server that keeps what it is sent, and answers as it is told."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field


@dataclass
class Listener:
    """What came, as headers (names in small letters) and body."""

    url: str
    requests: list[tuple[dict[str, str], bytes]] = field(default_factory=list)


@asynccontextmanager
async def listening(*answers: int) -> AsyncIterator[Listener]:
    """Listen on loopback; answer each request with the next of ``answers``, then with 204."""
    statuses = iter(answers)

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        head = (await reader.readuntil(b"\r\n\r\n")).decode().splitlines()[1:]
        pairs = [line.split(": ", 1) for line in head if line]
        headers = {name.lower(): value for name, value in pairs}
        body = await reader.readexactly(int(headers["content-length"]))
        listener.requests.append((headers, body))
        status = next(statuses, 204)
        writer.write(f"HTTP/1.1 {status} Told\r\nContent-Length: 0\r\n".encode())
        writer.write(b"Connection: close\r\n\r\n")
        await writer.drain()
        writer.close()

    server = await asyncio.start_server(serve, "127.0.0.1", 0)
    host, port = server.sockets[0].getsockname()
    listener = Listener(f"http://{host}:{port}/told")
    async with server:
        yield listener
