"""Asks one drone who it is and measures what it sends; never anything that moves it.

Sent are ``command``, reads, ``port`` where the fleet file asks for it, and, only while the motors
stand still, ``streamon`` with ``streamoff`` afterwards.
"""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, field, replace

from server.doctor.config import DoctorConfig
from server.doctor.ears import Ears, ask, move_ports
from server.doctor.reads import READS, ask_reads, number_in
from server.stages import Frame, Telemetry
from server.swarm.config import DroneConfig
from server.swarm.protocol import ProtocolError, Reply, decode_state
from server.swarm.video import VideoDecoder

_POLL_S = 0.05


@dataclass(slots=True)
class StateHeard:
    """State reports of a drone.

    Attributes:
        count: How many could be read.
        bad: How many could not.
        seconds: How long was listened, seconds.
        first: The first one.
        newest: The newest one.
        age_s: Age of the newest at the end, seconds.
        strangers: Addresses that are no drone of the fleet and sent reports, too.
    """

    count: int = 0
    bad: int = 0
    seconds: float = 0.0
    first: Telemetry | None = None
    newest: Telemetry | None = None
    age_s: float | None = None
    strangers: list[str] = field(default_factory=list)

    @property
    def rate_hz(self) -> float:
        """Reports per second."""
        return self.count / self.seconds if self.seconds else 0.0

    @property
    def motors_run(self) -> bool:
        """Whether the motors ran meanwhile: the drone counts their seconds."""
        if self.first is None or self.newest is None:
            return False
        return self.newest.motor_time_s > self.first.motor_time_s


@dataclass(slots=True)
class VideoSeen:
    """Video of a drone.

    Attributes:
        refused: What the drone answered to ``streamon`` in place of ok; empty for ok.
        was_on: Whether it streamed before it was asked to.
        datagrams: How many arrived.
        first_whole_s: From asking to the first undamaged picture, seconds; None without one.
        pictures: Pictures while they were counted.
        damaged: Of these damaged ones.
        seconds: How long they were counted, seconds.
        strangers: Addresses that are no drone of the fleet and sent video.
    """

    refused: str = ""
    was_on: bool = False
    datagrams: int = 0
    first_whole_s: float | None = None
    pictures: int = 0
    damaged: int = 0
    seconds: float = 0.0
    strangers: list[str] = field(default_factory=list)


@dataclass(slots=True)
class Probe:
    """Everything one drone was found to say.

    Attributes:
        hello: Its reply to ``command``; None for silence.
        reads: Replies to the reads that were answered with a value, by question.
        state: Its state reports.
        video: Its video; None when it was not looked at.
    """

    hello: Reply | None = None
    reads: dict[str, str] = field(default_factory=dict)
    state: StateHeard = field(default_factory=StateHeard)
    video: VideoSeen | None = None

    def number(self, question: str) -> float | None:
        """Return the number a read was answered with, such as 24 of ``24s``; None without one."""
        return number_in(self.reads, question)


async def probe_drone(drone: DroneConfig, ears: Ears, config: DoctorConfig) -> Probe:
    """Ask and measure one drone; see the module for what is sent.

    Raises:
        OSError: If a socket cannot be opened.
    """
    loop = asyncio.get_running_loop()
    probe = Probe()
    video = VideoSeen()
    state = probe.state

    def take_state(datagram: bytes, arrived_s: float) -> None:
        try:
            state.newest = decode_state(datagram, drone.id, arrived_s)
        except ProtocolError:
            state.bad += 1
            return
        state.first = state.first or state.newest
        state.count += 1

    def take_frame(frame: Frame) -> None:
        whole_since = video.first_whole_s is not None
        if not whole_since and not frame.damaged:
            video.first_whole_s = loop.time() - asked_s
        elif whole_since:
            video.pictures += 1
            video.damaged += frame.damaged

    asked_s = loop.time()
    async with VideoDecoder(drone.id, take_frame) as decoder:

        def take_video(datagram: bytes, arrived_s: float) -> None:
            video.datagrams += 1
            decoder.feed(datagram, arrived_s)

        await ears.listen(drone, drone.state_port, take_state)
        await ears.listen(drone, drone.video_port, take_video)
        probe.hello = await ask(drone, "command", tries=config.tries, wait_s=config.reply_s)
        if probe.hello is None or probe.hello.kind != "ok":
            state.strangers = ears.strangers(drone, drone.state_port)
            return probe
        await move_ports(drone, tries=config.tries, wait_s=config.reply_s)
        heard_s = loop.time()
        state.count, state.first = 0, None
        reading = asyncio.create_task(ask_reads(drone, READS, config), name=f"reads of {drone.id}")
        await asyncio.sleep(config.state_s)
        # A copy: reports go on coming while the video is looked at.
        probe.state = replace(
            state,
            seconds=loop.time() - heard_s,
            age_s=loop.time() - state.newest.received_s if state.newest is not None else None,
            strangers=ears.strangers(drone, drone.state_port),
        )
        probe.reads = await reading
        video.was_on = video.datagrams > 0
        if video.was_on or not probe.state.motors_run:
            probe.video = video
            asked_s = loop.time()
            video.first_whole_s, video.pictures, video.damaged = None, 0, 0
            await _watch(drone, video, config)
            video.strangers = ears.strangers(drone, drone.video_port)
    return probe


async def _watch(drone: DroneConfig, video: VideoSeen, config: DoctorConfig) -> None:
    loop = asyncio.get_running_loop()
    if not video.was_on:
        reply = await ask(drone, "streamon", tries=config.tries, wait_s=config.reply_s)
        if reply is None or reply.kind != "ok":
            video.refused = reply.text if reply is not None else "nothing"
    try:
        deadline_s = loop.time() + config.key_picture_s
        while video.first_whole_s is None and loop.time() < deadline_s:  # noqa: ASYNC110
            await asyncio.sleep(_POLL_S)
        if video.first_whole_s is None:
            return
        video.pictures = video.damaged = 0
        begun_s = loop.time()
        await asyncio.sleep(config.video_s)
        video.seconds = loop.time() - begun_s
    finally:
        if not video.was_on:
            await ask(drone, "streamoff", tries=config.tries, wait_s=config.reply_s)
