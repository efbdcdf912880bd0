"""Somebody who watches a console's event stream, video included, as the dashboard does."""

from __future__ import annotations

import asyncio
import json
import time

from websockets.asyncio.client import ClientConnection, connect


class Viewer:
    """Takes every tile and says that it has shown it; an async context manager.

    Attributes:
        tiles: Pictures received.
        tile_bytes: Their bytes, headers included.
        newest: The newest JPEG of each drone.
        messages: Messages received.
        missed: Messages the console had to leave out for this viewer.
    """

    def __init__(self, address: str, headers: dict[str, str]) -> None:
        """Watch the console at ``address``, let in by ``headers``."""
        self.tiles = 0
        self.tile_bytes = 0
        self.newest: dict[str, bytes] = {}
        self.messages = 0
        self.missed = 0
        self._gap_s = 0.0
        self._url = address.replace("http", "ws", 1) + "/api/v1/stream"
        self._headers = headers
        self._tile_s = time.monotonic()
        self._socket: ClientConnection | None = None
        self._taking: asyncio.Task[None] | None = None

    async def __aenter__(self) -> Viewer:
        self._socket = await connect(
            self._url, additional_headers=self._headers, proxy=None, compression=None
        )
        self._taking = asyncio.create_task(self._take(self._socket), name="viewer")
        return self

    async def __aexit__(self, *_: object) -> None:
        if self._taking is not None:
            self._taking.cancel()
            await asyncio.gather(self._taking, return_exceptions=True)
        if self._socket is not None:
            await self._socket.close()

    def begin_anew(self) -> None:
        """Count from now on."""
        self.tiles = self.tile_bytes = self.messages = self.missed = 0
        self._gap_s, self._tile_s = 0.0, time.monotonic()

    @property
    def longest_gap_s(self) -> float:
        """Longest time between two tiles, or since the last one, seconds."""
        return max(self._gap_s, time.monotonic() - self._tile_s)

    @property
    def connected(self) -> bool:
        """Whether the line stands."""
        return self._taking is not None and not self._taking.done()

    async def _take(self, socket: ClientConnection) -> None:
        async for message in socket:
            if isinstance(message, str):
                self.messages += 1
                # Most are reports: only the few that may be this one are read.
                if '"type":"missed"' in message:
                    self.missed += json.loads(message)["events"]
                continue
            end = 4 + int.from_bytes(message[:4])
            header = json.loads(message[4:end])
            self._note_tile(message, end, header["drone_id"])
            shown = {"drone_id": header["drone_id"], "sequence": header["sequence"]}
            await socket.send(json.dumps({"type": "tile_shown"} | shown))

    def _note_tile(self, message: bytes, header_end: int, drone_id: str) -> None:
        self._gap_s, self._tile_s = self.longest_gap_s, time.monotonic()
        self.tiles += 1
        self.tile_bytes += len(message)
        self.newest[drone_id] = message[header_end:]
