"""The take-off of one drone: ordered once, believed when it is seen."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager

from server.swarm.asking import Asking
from server.swarm.config import TimingConfig
from server.swarm.errors import DroneError
from server.swarm.flight import Flight
from server.swarm.protocol import Reply

# A take-off takes about 4 s. Only after this do state reports settle one whose reply is missing.
_REPLY_OVERDUE_S = 6.0
# How long an earlier command may keep a take-off waiting.
_TURN_S = 6.0
# For so long after the reply the height may still be on its way.
_SEEN_AFTER_S = 3.0


class TakeOff:
    """Takes one drone off.

    The order is given once: a repeat could start a drone again that somebody has just landed. To an
    EDU it goes in several copies, of which the drone carries out one. Whether it was carried out is
    read from the state reports when the reply is lost, and also when it is not: an ``ok`` of a
    drone that stayed on the ground has been seen.
    """

    def __init__(
        self,
        flight: Flight,
        asking: Asking,
        clock: Callable[[], float],
        timing: TimingConfig,
        edu: bool,
    ) -> None:
        """Build it; ``edu`` drones get loss-proof copies until one complains about them."""
        self._flight = flight
        self._asking = asking
        self._clock = clock
        self._timing = timing
        self._edu = edu

    async def __call__(self, reason_to_stay: Callable[[], str]) -> None:
        """Take off and wait until the drone hovers.

        Args:
            reason_to_stay: Asked right before the order, which may have waited for its turn: why
                the drone must not take off, empty when it may.

        Raises:
            DroneError: If it is stopped on the way, refused by the drone, or not seen to rise.
        """
        flight = self._flight
        # LAND and HOLD may leave no trace in a drone on the ground, so they are counted.
        stops = flight.stops
        async with self._turn():
            _refuse_unless(flight.stops == stops, "stopped before take-off")
            reason = reason_to_stay()
            _refuse_unless(not reason, reason)
            failed = False
            try:
                reply = await self._climb()
                _refuse_unless(flight.stops == stops, "stopped during take-off")
                patience_s = _SEEN_AFTER_S
                if reply is not None and reply.kind == "error" and not flight.watch.is_up():
                    # This complaint about a manoeuvre under way tells that there is one: the
                    # network delivered the order twice.
                    if "joystick" not in reply.text.lower():
                        raise DroneError(f"refused to take off: {reply.text}")
                    patience_s = _REPLY_OVERDUE_S
                await self._until_up_or_stopped(stops, patience_s)
                _refuse_unless(flight.stops == stops, "stopped during take-off")
                _refuse_unless(flight.watch.is_up(), "not seen to take off")
                flight.orders.end_climb()
            except DroneError:
                failed = True
                raise
            finally:
                if flight.stops == stops:
                    # No copy may leave after somebody gave up waiting for the take-off.
                    flight.orders.burst.cancel()
                flight.end_climb()
                if failed and flight.stops == stops:
                    # Perhaps it climbs after all: nobody would fly it.
                    flight.land_now()

    @asynccontextmanager
    async def _turn(self) -> AsyncIterator[None]:
        """Wait until no other command is under way; what answers none takes no order, either."""
        try:
            async with asyncio.timeout(_TURN_S):
                await self._asking.turn.acquire()
        except TimeoutError:
            raise DroneError("does not answer an earlier command") from None
        try:
            yield
        finally:
            self._asking.turn.release()

    async def _climb(self) -> Reply | None:
        """Order the take-off and return its reply, None when it is lost or a stop came."""
        flight, asking, timeout_s = self._flight, self._asking, self._timing.take_off_s
        flight.begin_climb()
        begun_s = self._clock()
        stops = flight.stops

        def settled() -> bool:
            if self._clock() - begun_s < _REPLY_OVERDUE_S:
                return False
            return flight.watch.is_up() or not flight.watch.motors_run()

        if self._edu and asking.channel.labels_known is not False:
            burst = flight.orders.burst
            reply = await asking.exchange_labelled("takeoff", burst, timeout_s, settled)
            if flight.stops != stops or asking.channel.labels_known is not False:
                return reply
            burst.cancel()
            # It took the label for a command and did nothing: from now on it is told plainly.
        return await asking.exchange("takeoff", timeout_s, settled)

    async def _until_up_or_stopped(self, stops: int, patience_s: float) -> None:
        flight = self._flight
        deadline_s = self._clock() + patience_s
        while (  # noqa: ASYNC110
            not flight.watch.is_up() and flight.stops == stops and self._clock() < deadline_s
        ):
            await asyncio.sleep(self._timing.beat_s)


def _refuse_unless(holds: bool, reason: str) -> None:
    if not holds:
        raise DroneError(reason)
