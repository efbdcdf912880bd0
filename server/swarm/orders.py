"""Orders that stand until they are seen to be carried out: LAND and CUT; and the burst of HOLD.

Each goes out several times at once. LAND and CUT then go on until state reports show the motors
standing. The replies are hints: which order they answer is not always known.
"""

from __future__ import annotations

from collections.abc import Callable

from server.stages import Telemetry
from server.swarm.asking import STRAY_S, Asking
from server.swarm.burst import Burst
from server.swarm.config import TimingConfig
from server.swarm.flight_watch import FlightWatch
from server.swarm.protocol import (
    ProtocolError,
    decode_reply,
    encode_command,
    encode_labelled,
    encode_rc,
    split_label,
)

STILL = encode_rc((0, 0, 0, 0))
_STOP = encode_command("stop")
_LAND = encode_command("land")
_EMERGENCY = encode_command("emergency")

# For so long after its order a take-off may still be under way; it refuses all but ``stop``.
_CLIMB_S = 8.0
# While a landing is neither answered nor seen, its order is repeated this often at first.
_HASTE_S, _HASTY_S = 0.2, 1.2
# Faster downward than this, a drone has taken the order to land.
_SINKING_M_S = 0.1


class StandingOrders:
    """What one drone was told last, and has to be told until it does it.

    Attributes:
        ordered_down: The newest order was to land.
    """

    def __init__(
        self,
        asking: Asking,
        send: Callable[[bytes], None],
        clock: Callable[[], float],
        timing: TimingConfig,
        watch: FlightWatch,
    ) -> None:
        self.ordered_down = False
        self._asking = asking
        self._send = send
        self._clock = clock
        self._timing = timing
        self._watch = watch
        self.burst = Burst(send, timing.stop_repeats_s)
        self._climbs_until_s = -1e9
        self._landing_s = 0.0
        self._land_sent_s = 0.0
        self._land_answered = False
        self._sinks = False
        self._land_labels: set[int] = set()
        self._cut_s = 0.0
        self._cut_sent_s = 0.0

    # Take-off --------------------------------------------------------------------------------

    def begin_climb(self) -> None:
        """Note that a take-off is ordered now; ends the repeats of whatever was ordered before."""
        self.burst.cancel()
        self.ordered_down = False
        self._climbs_until_s = self._clock() + _CLIMB_S

    def end_climb(self) -> None:
        """Note that the take-off is over."""
        self._climbs_until_s = -1e9

    # Stops -----------------------------------------------------------------------------------

    def hold(self) -> None:
        """Stop where it is, at once."""
        self._asking.interrupt()
        self._owe(1)
        self.burst.send((STILL, _STOP))

    def land(self, begins: bool) -> None:
        """Land, at once; ``begins`` is False when it was landing already."""
        now_s = self._clock()
        self.ordered_down = True
        if begins:
            self._landing_s = now_s
            self._land_answered = self._sinks = False
            self._land_labels.clear()
        self._asking.interrupt()
        self._land_sent_s = now_s
        channel = self._asking.channel
        if now_s >= self._climbs_until_s and channel.labels_known:
            # Each has a label of its own, so that each is a fresh attempt: copies of one that was
            # refused are only refused again.
            labels = [channel.new_label() for _ in range(self.burst.copies)]
            self._land_labels.update(labels)
            self.burst.send_each([(STILL, encode_labelled(label, 1, "land")) for label in labels])
            return
        datagrams = self._land_datagrams(now_s)
        self._owe(len(datagrams))
        self.burst.send((STILL, *datagrams))

    def cut(self) -> None:
        """Stop the motors, at once."""
        self._cut_s = self._cut_sent_s = self._clock()
        self._asking.interrupt()
        self._owe(1)
        self.burst.send((_EMERGENCY,))

    def _owe(self, per_copy: int) -> None:
        patience_s = self._timing.stop_repeats_s[-1] + STRAY_S
        self._asking.channel.owe(self._clock(), patience_s, per_copy * self.burst.copies)

    def _land_datagrams(self, now_s: float) -> tuple[bytes, ...]:
        # A drone refuses a motion command while another one, here a take-off, is under way.
        return (_STOP, _LAND) if now_s < self._climbs_until_s else (_LAND,)

    # Repeats ---------------------------------------------------------------------------------

    def repeat_land(self, now_s: float) -> None:
        """Order the landing again when it is time; without labels, which might be used up.

        Sooner at first: a drone that heard nothing flies on by its last sticks, which is why each
        order comes with centred ones, behind it, so that they cannot swallow it.
        """
        unheard = not self._land_answered and not self._sinks
        burst_s = self._timing.stop_repeats_s[-1]
        hasty = unheard and burst_s < now_s - self._landing_s < _HASTY_S
        if now_s - self._land_sent_s >= (_HASTE_S if hasty else self._timing.land_repeat_s):
            self._land_sent_s = now_s
            self._asking.send_unanswered(*self._land_datagrams(now_s))
            if unheard:
                self._send(STILL)

    def repeat_cut(self, now_s: float) -> None:
        """Order the cut again when it is time."""
        if now_s - self._cut_sent_s >= self._timing.cut_repeat_s:
            self._cut_sent_s = now_s
            self._asking.send_unanswered(_EMERGENCY)

    # What is seen ----------------------------------------------------------------------------

    def observe_state(self, telemetry: Telemetry) -> None:
        """Take the newest report."""
        if telemetry.velocity_m_s[2] < -_SINKING_M_S:
            self._sinks = True
            self.end_climb()

    def observe_reply(self, datagram: bytes, arrived_s: float) -> None:
        """Take a datagram of a landing drone that may be the reply to the order."""
        label, body = split_label(datagram)
        try:
            ok = decode_reply(body).kind == "ok"
        except ProtocolError:
            return
        late_enough = arrived_s - self._landing_s > STRAY_S
        # Without a label it is perhaps another command's: believed only together with the height.
        if ok and (label in self._land_labels if label is not None else late_enough):
            self._land_answered = True

    def has_landed(self, now_s: float, telemetry: Telemetry | None, fresh_s: float) -> bool:
        """Return whether the drone is surely down; silence proves nothing."""
        if telemetry is None or now_s - telemetry.received_s > fresh_s:
            return False
        if self._land_answered and self._watch.is_down() and now_s - self._landing_s > 1.0:
            return True
        return self._watch.motors_idle_since(self._landing_s)

    def stands_since_cut(self) -> bool:
        """Return whether reports show the motors standing since the cut."""
        return self._watch.motors_idle_since(self._cut_s)
