"""What a drone tells of itself when asked: who it is, what it can do, how it hears us."""

from __future__ import annotations

import re
from dataclasses import dataclass

from server.swarm.protocol import ProtocolError, read_number, read_serial

# Below this level a drone knows neither ``sdk?`` nor ``sn?`` nor ``stop``.
SDK_TOO_OLD_TO_TELL = 13
# What is asked, the most important first.
QUESTIONS = ("sn?", "sdk?", "hardware?", "wifi?", "battery?")


@dataclass(frozen=True, slots=True)
class DroneFacts:
    """Answers of a drone; None where it has not answered or does not know the question.

    Attributes:
        serial: Serial number, which stays with the drone whatever its address.
        sdk: Level of its protocol: 13 for a drone too old to tell, 20, 30.
        hardware: ``TELLO`` or ``RMTT``; only from SDK 3.0 on.
        wifi_snr: How well it hears us, signal to noise ratio as it counts it, 0-100.
        battery_pct: Charge when asked, percent.
        read_s: When the newest of these was read.
    """

    serial: str | None = None
    sdk: int | None = None
    hardware: str | None = None
    wifi_snr: int | None = None
    battery_pct: int | None = None
    read_s: float | None = None

    def age_s(self, now_s: float) -> float | None:
        """Return the seconds since something was read, None before that."""
        return None if self.read_s is None else now_s - self.read_s

    def over(self, older: DroneFacts, now_s: float) -> DroneFacts:
        """Return these facts, and the older ones where these know nothing, as read now."""
        return DroneFacts(
            serial=self.serial or older.serial,
            sdk=older.sdk if self.sdk is None else self.sdk,
            hardware=self.hardware or older.hardware,
            wifi_snr=older.wifi_snr if self.wifi_snr is None else self.wifi_snr,
            battery_pct=older.battery_pct if self.battery_pct is None else self.battery_pct,
            read_s=now_s,
        )


def fact_of(question: str, answer: str) -> DroneFacts:
    """Return what an answer tells.

    Raises:
        ProtocolError: If the answer is none to this question.
    """
    match question:
        case "sn?":
            return DroneFacts(serial=read_serial(answer))
        case "sdk?":
            return DroneFacts(sdk=round(read_number(answer)))
        case "hardware?":
            if not re.fullmatch(r"[A-Z][A-Z0-9]{1,15}", answer):
                raise ProtocolError(f"{question} answered with {answer!r}")
            return DroneFacts(hardware=answer)
        case "wifi?":
            return DroneFacts(wifi_snr=round(read_number(answer)))
        case "battery?":
            return DroneFacts(battery_pct=round(read_number(answer, "%")))
        case _:
            raise ProtocolError(f"{question!r} is no question about facts")
