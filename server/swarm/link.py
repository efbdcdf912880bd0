"""Datagrams to and from one drone.

Command replies, state reports and video arrive on three local ports, see ``server.swarm.ports``.
"""

from __future__ import annotations

import logging
from typing import Protocol

from server.swarm.config import DroneConfig
from server.swarm.ports import VIDEO_BUFFER_BYTES, LinkError, Port, PortBoard, Receiver

logger = logging.getLogger(__name__)


class DroneLink(Protocol):
    """Sends datagrams to a drone and hands over what it sends; lives on the event loop.

    Attributes:
        unsent: Datagrams that could not be handed to the network.
    """

    unsent: int

    async def open(self, on_reply: Receiver, on_state: Receiver, on_video: Receiver) -> None:
        """Open the sockets; receivers are called with (datagram, arrival time in seconds).

        Raises:
            LinkError: If a socket cannot be opened.
        """
        ...

    def send(self, datagram: bytes) -> None:
        """Send one datagram to the command port at once; losses are counted, never raised."""
        ...

    def close(self) -> None:
        """Close the sockets; may be called twice."""
        ...


class UdpDroneLink:
    """A drone over UDP.

    Attributes:
        address: Where it is; empty while that is not known.
        unsent: See ``DroneLink``.
    """

    def __init__(self, config: DroneConfig, board: PortBoard | None = None) -> None:
        self.address = config.address
        self.unsent = 0
        self._config = config
        self._board = board if board is not None else PortBoard()
        self._command: Port | None = None
        self._receivers: tuple[Receiver, Receiver, Receiver] | None = None

    async def open(self, on_reply: Receiver, on_state: Receiver, on_video: Receiver) -> None:
        """See ``DroneLink.open``."""
        self._receivers = on_reply, on_state, on_video
        config, board, address = self._config, self._board, self.address
        try:
            await board.join(config, address, config.state_port, on_state)
            await board.join(config, address, config.video_port, on_video, VIDEO_BUFFER_BYTES)
            # Replies go to the port a command came from, so every drone gets a port of its own.
            self._command = await board.join(config, address, 0, on_reply)
        except LinkError:
            self.close()
            raise

    async def move_to(self, address: str) -> None:
        """Go on with the drone at another address.

        Raises:
            LinkError: If a socket cannot be opened.
        """
        before, self.address = self.address, address
        if self._receivers is None or before == address:
            return
        if self._command is not None:
            self._board.close(self._command)
        await self.open(*self._receivers)
        # Only now, so that a shared port stays open.
        self._leave(before)

    def send(self, datagram: bytes) -> None:
        """See ``DroneLink.send``."""
        port, to = self._command, (self.address, self._config.command_port)
        if port is None or not self.address or not port.send(datagram, to):
            self.unsent += 1
        elif not datagram.startswith(b"rc "):
            # After it was sent: nothing comes before a stop. Sticks go out ten times a second.
            logger.info("sent %s", datagram, extra={"drone_id": self._config.id})

    def close(self) -> None:
        """See ``DroneLink.close``."""
        if self._command is not None:
            self._board.close(self._command)
            self._command = None
        self._leave(self.address)

    def _leave(self, address: str) -> None:
        if self._receivers is not None:
            _, on_state, on_video = self._receivers
            self._board.leave(self._config, address, self._config.state_port, on_state)
            self._board.leave(self._config, address, self._config.video_port, on_video)
