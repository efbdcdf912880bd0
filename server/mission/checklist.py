"""The preflight checklist: what must be true of drones and console before a capture flies.

Each check is an item with a name, what was found and what to do about it. An operator may override
an item that is not final, with a reason that is kept with the capture.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from server.swarm.config import SafetyConfig
from server.swarm.drone import Drone
from server.swarm.safety import take_off_refusals

# A capture of 24 pictures with its field takes about 60 MB; below this the disk is as good as full.
_LEAST_FREE_MB = 500.0
# It is asked every few seconds; one that stays silent for so long will hold up every picture.
_DISK_SILENT_S = 30.0
# A drone that stands more crooked than this has a foot on something and takes off sideways.
_CROOKED_DEG = 8.0

_WHO_REMEDY = "Switch on the drone with that serial number, or mend the fleet file."
_REMEDIES = {
    "state": "Look at the Wi-Fi and at the firewall for UDP port 8890.",
    "battery": "Put in a charged battery.",
    "temperature": "Let it cool: switch it off, or put it into the wind of a fan.",
}


@dataclass(frozen=True, slots=True)
class Check:
    """One item of the checklist.

    Attributes:
        item: Name of what was checked: ``link``, ``battery`` and so on.
        drone_id: Which drone, None for the console itself.
        passed: Whether all is well.
        found: What was found.
        remedy: What to do about it; empty when it passed.
        final: True when no operator may override it.
    """

    item: str
    drone_id: str | None
    passed: bool
    found: str
    remedy: str = ""
    final: bool = False

    @property
    def key(self) -> str:
        """The name by which an override names it: ``drone-2.battery`` or ``disk``."""
        return f"{self.drone_id}.{self.item}" if self.drone_id else self.item


def check_drone(drone: Drone, now_s: float, safety: SafetyConfig) -> tuple[Check, ...]:
    """Return the checks of one drone."""

    def check(item: str, passed: bool, found: str, remedy: str, *, final: bool = True) -> Check:
        told = "" if passed else remedy
        return Check(item, drone.config.id, passed, found, told, final and not passed)

    name, telemetry = drone.config.label, drone.telemetry
    linked = drone.activity != "offline"
    checks = [
        check(
            "link",
            linked,
            "answers" if linked else f"does not answer at {drone.config.address}",
            f"Switch {name} on, wait for its light to blink yellow, and join its Wi-Fi.",
        )
    ]
    if not linked or telemetry is None:
        return tuple(checks)
    down = drone.activity == "ground"
    checks.append(
        check("on_ground", down, drone.activity.replace("_", " "), "Land it first; re-arm a CUT.")
    )
    checks.append(
        check("armed", not drone.held, "held" if drone.held else "armed", "Re-arm it after HOLD.")
    )
    checks.append(
        check("identity", not drone.stranger, drone.stranger or "as it should be", _WHO_REMEDY)
    )
    checks += _take_off_checks(drone, now_s, safety)
    moving = drone.newest_frame is not None and drone.video_fps > 0.0
    checks.append(
        check(
            "video",
            moving,
            f"{drone.video_fps:.0f} pictures per second",
            "Look at the firewall for UDP port 11111, or switch the drone off and on.",
        )
    )
    lean_rad = max(abs(telemetry.roll_rad), abs(telemetry.pitch_rad))
    lean_deg = round(lean_rad * 57.29578)
    checks.append(
        check(
            "level",
            lean_deg <= _CROOKED_DEG,
            f"leans {lean_deg} degrees",
            "Set it down on a level place.",
            final=False,
        )
    )
    return tuple(checks)


def _take_off_checks(drone: Drone, now_s: float, safety: SafetyConfig) -> list[Check]:
    telemetry = drone.telemetry
    assert telemetry is not None
    refusals = {refusal.name: refusal for refusal in take_off_refusals(telemetry, now_s, safety)}
    healthy = {
        "state": f"report {now_s - telemetry.received_s:.1f} s old",
        "battery": f"{telemetry.battery_pct} %",
        "temperature": f"{telemetry.temperature_c:.0f} degrees Celsius",
    }
    return [
        Check(
            name,
            drone.config.id,
            passed=name not in refusals,
            found=refusals[name].text if name in refusals else found,
            remedy=_REMEDIES[name] if name in refusals else "",
            final=name in refusals and refusals[name].final,
        )
        for name, found in healthy.items()
    ]


def check_disk(free_mb: float, age_s: float) -> Check:
    """Return the check of the disk that pictures go to, whose room was measured ``age_s`` ago."""
    if age_s > _DISK_SILENT_S:
        remedy = "Look at the disk or network share of the runs."
        return Check("disk", None, passed=False, found="the disk does not answer", remedy=remedy)
    return Check(
        "disk",
        None,
        passed=free_mb >= _LEAST_FREE_MB,
        found=f"{free_mb / 1000.0:.1f} GB free for pictures",
        remedy="" if free_mb >= _LEAST_FREE_MB else "Delete or move old runs.",
    )


def check_console(failed_task: str) -> Check:
    """Return the check of the console itself; ``failed_task`` names a standing task that ended."""
    return Check(
        "console",
        None,
        passed=not failed_task,
        found=f"its task “{failed_task}” has failed" if failed_task else "all its tasks run",
        remedy="Restart the console." if failed_task else "",
        final=bool(failed_task),
    )


def problems(checks: Sequence[Check], overrides: Mapping[str, str]) -> list[Check]:
    """Return the checks that keep a capture on the ground.

    Args:
        checks: The checklist.
        overrides: Reason by item (``battery``) or by key (``drone-2.battery``).
    """
    return [
        check
        for check in checks
        if not check.passed
        and (check.final or not (overrides.get(check.key) or overrides.get(check.item)))
    ]


def overridden(checks: Sequence[Check], overrides: Mapping[str, str]) -> dict[str, str]:
    """Return by key the reasons that let a failed check pass."""
    return {
        check.key: overrides.get(check.key) or overrides[check.item]
        for check in checks
        if not check.passed
        and not check.final
        and (overrides.get(check.key) or overrides.get(check.item))
    }
