"""One whole simulated Tello: body, protocol, power and what goes wrong; no I/O, no clock.

Datagrams and the time go in, datagrams come out. Whoever has it puts what it sends on the air
through ``downlink`` and what it is sent through ``uplink``: both carry its radio faults.
"""

from __future__ import annotations

import heapq
import logging
import math
import random
from dataclasses import dataclass
from typing import Literal

import numpy as np

from server.sim.camera import true_intrinsics
from server.sim.config import SimConfig
from server.sim.dynamics import Airframe
from server.sim.fault_plan import FaultPlan
from server.sim.faults import Fault
from server.sim.radio import Radio
from server.sim.sdk import TextSdk

_LOG = logging.getLogger(__name__)

STEP_S = 0.02
STATE_PERIOD_S = 0.1

_BOOT_S = 8.0
_SHUT_DOWN_C = 105.0
_START_ERROR_M = 0.20
_START_ERROR_DEG = 15.0
# A packet of the vendor's other protocol, which shares the command port.
_BINARY_PACKET = bytes.fromhex("cc58007c6082000000000000000000e2f0")

Sender = tuple[str, int]
Kind = Literal["reply", "state", "video"]


@dataclass(frozen=True, slots=True)
class Outgoing:
    """A datagram on its way out.

    Attributes:
        datagram: Its bytes.
        to: Address and port it goes to.
        kind: What it is; replies leave from the command port.
    """

    datagram: bytes
    to: Sender
    kind: Kind


def placed_airframe(config: SimConfig, index: int) -> Airframe:
    """Return the drone as somebody set it down: roughly on its place, roughly facing the centre."""
    rng = np.random.default_rng([config.seed, index])
    azimuth = math.radians(config.azimuth_deg(index))
    error = config.start_sigma_m * rng.standard_normal(2)
    # The cap bounds the length of the error, not each of its parts.
    error *= min(1.0, _START_ERROR_M / max(1e-9, float(np.linalg.norm(error))))
    turned_deg = config.start_sigma_deg * rng.standard_normal()
    turned_deg = min(max(turned_deg, -_START_ERROR_DEG), _START_ERROR_DEG)
    nominal = config.start_radius_m * np.array([math.cos(azimuth), math.sin(azimuth)])
    position = np.array([*(nominal + error), 0.0])
    yaw_rad = azimuth + math.pi + math.radians(turned_deg)
    return Airframe(position, yaw_rad, config.dynamics, rng)


class Tello:
    """One simulated drone.

    Attributes:
        drone_id: Its id in the simulation.
        address: Its IPv4 address.
        airframe: Its body: the truth.
        lens: Its camera's true intrinsics.
        sdk: Its side of the protocol; a new one after every restart.
        uplink: The air to it.
        downlink: The air from it.
        powered: False while it is off or starting.
        left_ground_s: When it first left the ground, None before.
    """

    def __init__(self, config: SimConfig, index: int) -> None:
        self.drone_id = config.drone_id(index)
        self.address = config.address(index)
        self.airframe = placed_airframe(config, index)
        self.lens = true_intrinsics(config.camera, config.seed, index)
        self.uplink: Radio[tuple[bytes, Sender]] = Radio(_rng(config, index, "up"))
        self.downlink: Radio[Outgoing] = Radio(_rng(config, index, "down"))
        self.powered = True
        self.left_ground_s: float | None = None
        self._config = config
        self._serial = f"0TQSIM{config.seed % 10000:04d}{index + 1:04d}"
        self.sdk = self._started_sdk(config.station)
        self._whims = _rng(config, index, "whims")
        self._plan = FaultPlan(f for f in config.faults if f.concerns(self.drone_id))
        self._started_s: float | None = None
        self._stepped_s = 0.0
        self._state_s = 0.0
        self._boot_s: float | None = None
        self._garbage_s = math.inf
        self._asker: Sender | None = None
        self._held: list[tuple[float, int, Outgoing]] = []
        self._held_count = 0

    def _started_sdk(self, station: bool) -> TextSdk:
        return TextSdk(
            self.airframe,
            self._serial,
            self._config.sdk,
            friendly_reads=self._config.friendly_reads,
            station=station,
        )

    @property
    def wants_pictures(self) -> bool:
        """True while somebody has switched the video on and the camera works."""
        sdk = self.sdk
        return (
            self.powered
            and sdk.streaming
            and sdk.client is not None
            and not self._plan.active("no_video")
        )

    # Time and datagrams ----------------------------------------------------------------------

    def receive(self, datagram: bytes, sender: Sender, now_s: float) -> list[Outgoing]:
        """Take one datagram; return what it sends at once (and what was due before)."""
        out = self.advance(now_s)
        if not self.powered:
            return out
        self._asker = sender
        entered = self.sdk.client is not None
        replies = self.sdk.receive(datagram, sender, now_s)
        out += self._replies(replies, now_s)
        if self._plan.active("garbage") and not entered and self.sdk.client is not None:
            out.append(Outgoing(_BINARY_PACKET, sender, "reply"))
        return out

    def advance(self, now_s: float) -> list[Outgoing]:
        """Live on until ``now_s``; return what it sends meanwhile."""
        if self._started_s is None:
            self._begin(now_s)
        out: list[Outgoing] = []
        while now_s - self._stepped_s >= STEP_S - 1e-6:
            self._stepped_s += STEP_S
            self._step(self._stepped_s, out)
        while self._held and self._held[0][0] <= now_s + 1e-9:
            out.append(heapq.heappop(self._held)[2])
        if now_s >= self._state_s - 1e-6:
            # After a stall reports are left out, not sent in a burst.
            late = now_s - self._state_s > STATE_PERIOD_S
            self._state_s = (now_s if late else self._state_s) + STATE_PERIOD_S
            if self.powered and self.sdk.client is not None:
                to = (self.sdk.client, self.sdk.settings.state_port)
                out.append(Outgoing(self.sdk.state(), to, "state"))
        if now_s >= self._garbage_s and self._asker is not None and self.powered:
            self._garbage_s = now_s + self._garbage_gap_s()
            out.append(Outgoing(_BINARY_PACKET, self._asker, "reply"))
        return out

    def video(self, datagram: bytes) -> Outgoing | None:
        """Return a video datagram with where it goes, None while nobody wants any."""
        if not self.wants_pictures or self.sdk.client is None:
            return None
        return Outgoing(datagram, (self.sdk.client, self.sdk.settings.video_port), "video")

    def inject(self, fault: Fault, now_s: float) -> None:
        """Let something go wrong from now on; its ``at_s`` counts from now, too."""
        if self._started_s is None:
            self._begin(now_s)
        self._plan.add(fault, now_s)

    def _begin(self, now_s: float) -> None:
        self._started_s = self._stepped_s = self._state_s = now_s
        self._plan.start(now_s)
        self._apply_faults(now_s)

    def _step(self, now_s: float, out: list[Outgoing]) -> None:
        airframe = self.airframe
        airframe.step(STEP_S)
        if self.left_ground_s is None and airframe.height_m > 0.0:
            self.left_ground_s = now_s
            self._plan.leave_ground(now_s)
        if self._plan.due_s <= now_s:
            self._apply_faults(now_s)
        if self._boot_s is not None and now_s >= self._boot_s:
            self._boot()
        if not self.powered:
            return
        replies = self.sdk.tick(now_s)
        if replies:
            out += self._replies(replies, now_s)
        if self.sdk.restart_at_s is not None and now_s >= self.sdk.restart_at_s:
            self.restart(now_s)
        elif airframe.battery_pct <= 0.0 or airframe.temperature_c >= _SHUT_DOWN_C:
            self._lose_power()

    def _replies(self, replies: list[tuple[bytes, Sender]], now_s: float) -> list[Outgoing]:
        out = [Outgoing(datagram, to, "reply") for datagram, to in replies]
        late_s = self._plan.total("late_replies")
        if late_s <= 0.0:
            return out
        for outgoing in out:
            self._held_count += 1
            heapq.heappush(self._held, (now_s + late_s, self._held_count, outgoing))
        return []

    # Power -----------------------------------------------------------------------------------

    def restart(self, now_s: float) -> None:
        """Go off and come up again, as after ``reboot``; in the air it falls."""
        self._lose_power()
        self._boot_s = now_s + _BOOT_S

    def _lose_power(self) -> None:
        self.airframe.cut()
        self.powered = False
        self._boot_s = None
        self._held.clear()

    def _boot(self) -> None:
        self._boot_s = None
        if self._plan.active("power_cut"):
            return
        self.powered = True
        self.airframe.power_on()
        self.sdk = self._started_sdk(self.sdk.station)

    # Faults ----------------------------------------------------------------------------------

    def _apply_faults(self, now_s: float) -> None:
        """Let the plan's faults begin and end, and set what depends on those in force."""
        plan = self._plan
        begun, ended = plan.turn(now_s)
        for fault in begun:
            _LOG.debug("%s: %s begins", self.drone_id, fault.kind)
            if fault.kind == "reboot":
                self.restart(now_s)
            elif fault.kind == "power_cut":
                self._lose_power()
            elif fault.kind == "low_battery":
                self.airframe.battery_pct = min(self.airframe.battery_pct, fault.amount)
            elif fault.kind == "garbage":
                self._garbage_s = now_s + self._garbage_gap_s()
        for fault in ended:
            if fault.kind == "power_cut":
                self._boot_s = now_s + _BOOT_S
            elif fault.kind == "garbage" and not plan.active("garbage"):
                self._garbage_s = math.inf
        for radio, way in ((self.uplink, "up"), (self.downlink, "down")):
            radio.loss = plan.share("loss", f"loss_{way}")
            radio.delay_s = plan.total("delay", f"delay_{way}")
            radio.reorder = plan.share("reorder", f"reorder_{way}")
            radio.duplicate = plan.share("duplicate", f"duplicate_{way}")
        airframe = self.airframe
        airframe.whims.wind = plan.wind(self._direction)
        airframe.sees_floor = not plan.active("no_valid_imu")
        airframe.stays_down = plan.active("stays_down")
        airframe.heat_c = plan.most("high_temperature")

    def _direction(self) -> float:
        return self._whims.uniform(-math.pi, math.pi)

    def _garbage_gap_s(self) -> float:
        per_s = self._plan.total("garbage")
        return self._whims.expovariate(per_s) if per_s > 0.0 else math.inf


def _rng(config: SimConfig, index: int, what: str) -> random.Random:
    return random.Random(f"{config.seed} {index} {what}")
