"""Waits and limits of the doctor and of a live calibration."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields


@dataclass(frozen=True, slots=True)
class DoctorConfig:
    """How long things may take and from where on they are reported.

    Attributes:
        reply_s: Wait for a reply before the question is sent again, seconds.
        tries: How often a question is sent.
        state_s: How long state reports are listened to, seconds.
        state_rate_hz: A slower rate of state reports is reported, hertz (a drone sends 10).
        state_age_s: An older newest report is a failure, seconds.
        key_picture_s: Longest wait for the first whole picture, seconds.
        video_s: How long pictures are counted, seconds.
        fps_least: A slower video is reported, pictures per second (a drone sends 30).
        fps_least_simulated: The same for a drone on a loopback address.
        damaged_warn: Share of damaged pictures from which on it is reported.
        damaged_fail: Share of damaged pictures from which on it is a failure.
        battery_fly_pct: No drone takes off with less charge, percent.
        battery_warn_pct: Less is too little for a whole capture, percent.
        temperature_warn_c: Hotter is reported, degrees Celsius (85 is normal for an idle drone).
        temperature_fail_c: No drone takes off when it is so hot, degrees Celsius.
        wifi_warn: A weaker signal-to-noise figure of the drone is reported.
        scan_pause_s: Pause between two addresses of a scan, seconds.
        disk_fail_gb: With less free disk no capture is safe, gigabytes.
        disk_warn_gb: With less free disk it is reported, gigabytes.
        memory_fail_gb: With less available memory nothing trains, gigabytes.
        memory_warn_gb: With less available memory it is reported, gigabytes.
        clock_step_s: A wall clock that differs so much from the steady one was set meanwhile,
            seconds.
        gpu_s: Longest wait for what torch says about the GPU, seconds.
    """

    reply_s: float = 1.0
    tries: int = 3
    state_s: float = 2.2
    state_rate_hz: float = 5.0
    state_age_s: float = 1.0
    key_picture_s: float = 8.0
    video_s: float = 3.0
    fps_least: float = 15.0
    fps_least_simulated: float = 3.0
    damaged_warn: float = 0.05
    damaged_fail: float = 0.5
    battery_fly_pct: float = 20.0
    battery_warn_pct: float = 40.0
    temperature_warn_c: float = 90.0
    temperature_fail_c: float = 95.0
    wifi_warn: float = 40.0
    scan_pause_s: float = 0.004
    disk_fail_gb: float = 0.5
    disk_warn_gb: float = 5.0
    memory_fail_gb: float = 0.7
    memory_warn_gb: float = 2.0
    clock_step_s: float = 0.1
    gpu_s: float = 60.0

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if not math.isfinite(value) or value <= 0:
                raise ValueError(f"{item.name} must be positive, not {value!r}")
        if self.tries != int(self.tries):
            raise ValueError(f"tries must be a whole number, not {self.tries!r}")


@dataclass(frozen=True, slots=True)
class LiveConfig:
    """How views are collected from a live stream.

    Attributes:
        views: How many distinct views are collected.
        patience_s: After so long without a new view the collection ends, seconds.
        keep_alive_s: ``command`` is sent this often, seconds; the drone sleeps without it.
        state_wait_s: Reports are watched so long before the stream is switched on, seconds.
        video_silence_s: After so long without video it is switched on again, seconds.
    """

    views: int = 25
    patience_s: float = 90.0
    keep_alive_s: float = 4.0
    state_wait_s: float = 2.2
    video_silence_s: float = 3.0

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if not math.isfinite(value) or value <= 0:
                raise ValueError(f"{item.name} must be positive, not {value!r}")
