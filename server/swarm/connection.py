"""Keeps one drone spoken to: SDK mode, who it is, keep-alive; all of it again after a reboot."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable

from server.stages import Telemetry
from server.swarm.asking import Asking
from server.swarm.config import DroneConfig, TimingConfig
from server.swarm.errors import DroneError
from server.swarm.facts import QUESTIONS, SDK_TOO_OLD_TO_TELL, DroneFacts, fact_of
from server.swarm.flight_watch import Activity
from server.swarm.pictures import Pictures
from server.swarm.protocol import ProtocolError, Reply

_LOG = logging.getLogger(__name__)

# A drone whose reports have stopped for so long may have been switched off and on.
_FORGOTTEN_S = 1.5
# Reports that begin again after so long, no boot being faster, come from a drone that started anew.
_REBOOT_S = 3.0
# Reports may overtake each other by about this much, which makes none of them a reboot's.
OVERTAKEN_S = 2.0
# Questions that went unanswered are asked again after this, while the drone stands.
_ASK_AGAIN_S = 10.0
# A question that every firmware answers.
_PROBE = "battery?"
# From this level of the protocol on, a drone can be told where to send state and video.
_SDK_WITH_PORTS = 30
# And from this one, how much video to send.
_SDK_WITH_RATE = 30


class Connection:
    """The acquaintance with one drone.

    Attributes:
        facts: What the drone told of itself.
    """

    def __init__(
        self,
        config: DroneConfig,
        asking: Asking,
        pictures: Pictures,
        clock: Callable[[], float],
        timing: TimingConfig,
    ) -> None:
        self.facts = DroneFacts()
        self._config = config
        self._asking = asking
        self._pictures = pictures
        self._clock = clock
        self._timing = timing
        self._suspicion = ""
        self._unconfirmed = False  # It was away and has not told its serial number since.
        self._wanted = False  # Somebody has asked for it.
        self._entering = False
        self._entered = False
        self._spoken_s = -1e9
        self._state_s: float | None = None
        self._motor_s = 0.0
        self._asking_all: asyncio.Task[None] | None = None
        self._asked_all_s = 0.0
        self._known = False  # Everything was answered.
        self._probed_s: float | None = None
        self._probing_since_s: float | None = None

    @property
    def stranger(self) -> str:
        """Why this is not the drone it should be; empty when nothing speaks against it."""
        if not self._suspicion and self._config.serial and self.facts.serial is None:
            return f"has not told its serial number, which should be {self._config.serial}"
        if not self._suspicion and self._unconfirmed and (self._config.serial or self.facts.serial):
            return "was away and has not told its serial number since"
        return self._suspicion

    @property
    def answers(self) -> bool:
        """Whether it has answered all that is needed to begin."""
        return self._entered

    # Beginning -------------------------------------------------------------------------------

    async def enter(self) -> None:
        """Enter SDK mode, repeated until answered; make sure who it is; start the video.

        Raises:
            DroneError: If it is not the drone it should be, or cannot do what is asked of it.
        """
        self._wanted = self._entering = True
        try:
            await self._asking.until_ok("command")
            await self._enter()
        finally:
            self._entering = False
        self._entered = True
        self._ask_all_in_background()

    async def _enter(self) -> None:
        self.facts, self._suspicion = DroneFacts(), ""
        if self._config.serial:
            await self._ask("sn?")
        if self.stranger:
            raise DroneError(f"{self._config.id}: {self.stranger}")
        if self._config.moves_ports:
            await self._move_ports()
        await self._asking.until_ok("streamon")
        self._pictures.want(True, self._clock())

    async def _move_ports(self) -> None:
        await self._ask("sdk?")
        if self.facts.sdk is not None and self.facts.sdk < _SDK_WITH_PORTS:
            raise DroneError(
                f"{self._config.id}: SDK {self.facts.sdk} cannot send to other ports; leave out"
                " state_port and video_port, drones are told apart by their addresses"
            )
        await self._asking.until_ok(self._ports)

    @property
    def _ports(self) -> str:
        return f"port {self._config.state_port} {self._config.video_port}"

    async def close(self) -> None:
        """Ask no more."""
        if self._asking_all is not None:
            self._asking_all.cancel()
            await asyncio.gather(self._asking_all, return_exceptions=True)

    # Going on --------------------------------------------------------------------------------

    def set_video(self, on: bool) -> None:
        """Turn the video on or off."""
        self._pictures.want(on, self._clock())
        self._asking.command("streamon" if on else "streamoff")

    @property
    def video_wanted(self) -> bool:
        """True while the video is meant to be on."""
        return self._pictures.wanted

    def observe_state(self, telemetry: Telemetry) -> None:
        """Take the newest report; one after a silence or with a younger motor clock is a reboot."""
        since_s, motor_s = self._state_s, self._motor_s
        self._state_s, self._motor_s = telemetry.received_s, telemetry.motor_time_s
        silent = since_s is not None and telemetry.received_s - since_s > _REBOOT_S
        younger = telemetry.motor_time_s < motor_s - OVERTAKEN_S
        late = self._wanted and not self._entered and not self._entering
        if late or (self._entered and (silent or younger)):
            _LOG.warning("%s: is %s", self._config.id, "there after all" if late else "back")
            self._entered = True
            # Who knows which drone this is: ask everything again.
            self._known = False
            self._unconfirmed = True
            # Another drone may not know the loss-proof form.
            self._asking.channel.labels_known = None
            self._ask_all_in_background()
            if late or self._pictures.wanted:
                self.set_video(True)

    def beat(self, now_s: float, doing: Activity, silent_s: float, state_age_s: float) -> None:
        """Send what keeps the drone awake or brings it back.

        Args:
            now_s: The time.
            doing: What the drone does.
            silent_s: Seconds since anything was sent to it.
            state_age_s: Seconds since its newest state report.
        """
        # Nothing may disturb a take-off.
        if not self._wanted or doing == "taking_off":
            return
        if doing == "offline" or state_age_s > _FORGOTTEN_S:
            # After a reboot it is deaf to all but ``command``, and tells nobody that it stands.
            due_s = silent_s if doing == "offline" else now_s - self._spoken_s
            if min(due_s, now_s - self._spoken_s) >= self._timing.retry_s:
                self._speak(now_s)
        elif doing in ("ground", "cut"):
            overdue = self._entered and not self._known
            if overdue and doing == "ground" and now_s - self._asked_all_s > _ASK_AGAIN_S:
                self._ask_all_in_background()
            elif silent_s >= self._timing.keep_alive_s:
                self._speak(now_s)
        self._probe(now_s, doing)
        # A landing is not disturbed for the sake of pictures.
        if doing == "landing" or not self._pictures.wanted:
            return
        if self._pictures.must_ask_again(now_s, self._timing.video_silence_s):
            self._asking.command("streamon")
        order = self._pictures.rate.order(now_s, flies=doing not in ("ground", "cut"))
        if order is not None and (self.facts.sdk or 0) >= _SDK_WITH_RATE:
            _LOG.info("%s: %s, for the losses of its video", self._config.id, order)
            self._asking.command(order)

    def _probe(self, now_s: float, doing: Activity) -> None:
        """Ask a drone in flight what it will answer at once, to know that it hears."""
        if doing != "flying":
            self._probing_since_s = None
            return
        if self._probing_since_s is None:
            self._probing_since_s = self._probed_s = now_s
        assert self._probed_s is not None
        # Whoever waits for a reply hears as well whether it answers.
        if now_s - self._probed_s >= self._timing.probe_s and not self._asking.turn.locked():
            self._probed_s = now_s
            self._asking.command(_PROBE)

    def link_age_s(self, now_s: float) -> float | None:
        """Return the seconds since a drone in flight last answered.

        None on the ground, and for one that has not answered a question in this flight: perhaps its
        firmware answers none while it flies.
        """
        since_s, channel = self._probing_since_s, self._asking.channel
        if since_s is None or channel.valued_s is None or channel.valued_s < since_s:
            return None
        assert channel.replied_s is not None
        return now_s - channel.replied_s

    def _speak(self, now_s: float) -> None:
        # Whoever waits for a reply keeps the drone awake, too.
        if self._asking.turn.locked():
            return
        self._spoken_s = now_s
        self._asking.command("command")
        if self._config.moves_ports:
            self._asking.command(self._ports)

    # Who it is -------------------------------------------------------------------------------

    def _ask_all_in_background(self) -> None:
        if self._asking_all is None or self._asking_all.done():
            self._asking_all = asyncio.create_task(self._ask_all(), name=f"facts {self._config.id}")

    async def _ask_all(self) -> None:
        self._asked_all_s = self._clock()
        answered = [await self._ask(question) for question in QUESTIONS]
        self._known = all(answered)

    async def _ask(self, question: str) -> bool:
        """Ask one question; return whether it was answered, were it by a refusal."""
        reply = await self._asking.read(question, lambda reply: _answers(question, reply))
        if reply is None:
            return False
        if reply.kind == "error":
            told = DroneFacts(sdk=SDK_TOO_OLD_TO_TELL) if question == "sdk?" else DroneFacts()
        else:
            told = fact_of(question, reply.text)
        if question == "sn?":
            self._unconfirmed = False
        if told.serial is not None:
            self._check(told.serial)
        self.facts = told.over(self.facts, self._clock())
        return True

    def _check(self, serial: str) -> None:
        expected = self._config.serial or self.facts.serial
        if expected and serial != expected:
            self._suspicion = f"another drone answers, with serial number {serial}, not {expected}"
            _LOG.error("%s: %s", self._config.id, self._suspicion)


def _answers(question: str, reply: Reply) -> bool:
    if reply.kind == "error":
        return True
    try:
        fact_of(question, reply.text)
    except ProtocolError:
        return False
    return True
