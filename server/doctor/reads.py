"""The reads a drone is asked, and what it answers: each firmware in its own form.

Real drones answer ``24s``, ``15dm`` or ``85~88C`` where others answer bare numbers;
``server.swarm.protocol`` reads both.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import partial

from server.doctor.config import DoctorConfig
from server.doctor.ears import ask
from server.swarm.config import DroneConfig
from server.swarm.protocol import (
    ProtocolError,
    read_fields,
    read_length_m,
    read_number,
    read_serial,
    read_temperature_c,
)

# What understands the answer to each question, in the order in which they are asked.
READS: Mapping[str, Callable[[str], object]] = {
    "sdk?": read_number,
    "sn?": read_serial,
    "battery?": partial(read_number, unit="%"),
    "wifi?": read_number,
    "speed?": read_number,
    "time?": partial(read_number, unit="s"),
    "height?": partial(read_length_m, plain="cm"),
    "temp?": read_temperature_c,
    "attitude?": read_fields,
    "baro?": partial(read_length_m, plain="m"),
    "acceleration?": read_fields,
    "tof?": partial(read_length_m, plain="mm"),
}


async def ask_reads(
    drone: DroneConfig, questions: Iterable[str], config: DoctorConfig
) -> dict[str, str]:
    """Ask reads, one after the other; return by question what was answered with a value.

    Raises:
        OSError: If no socket can be opened.
    """
    answers: dict[str, str] = {}
    for question in questions:
        reply = await ask(drone, question, tries=config.tries, wait_s=config.reply_s)
        if reply is not None and reply.kind == "value":
            answers[question] = reply.text
    return answers


def number_in(answers: Mapping[str, str], question: str) -> float | None:
    """Return the number a read was answered with, such as 87 of ``87%``; None without one."""
    try:
        value = READS[question](answers.get(question, ""))
    except ProtocolError:
        return None
    return value if isinstance(value, float) else None


def not_understood(answers: Mapping[str, str]) -> list[str]:
    """Return the questions whose answers are in no known form."""
    strange: list[str] = []
    for question, text in answers.items():
        try:
            READS[question](text)
        except ProtocolError:
            strange.append(question)
    return strange
