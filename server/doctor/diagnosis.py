"""From what a drone was found to say to findings; pure."""

from __future__ import annotations

from collections.abc import Iterator
from ipaddress import IPv4Address

from server.doctor.config import DoctorConfig
from server.doctor.finding import Finding, Status
from server.doctor.probe import Probe, VideoSeen
from server.doctor.reads import READS, not_understood
from server.swarm.config import AP_ADDRESS, DroneConfig

# Before this level a drone that has joined a network sends no video.
_STATION_VIDEO_SDK = 30


def diagnose(drone: DroneConfig, probe: Probe, opening: str, config: DoctorConfig) -> list[Finding]:
    """Return the findings about one drone.

    Args:
        drone: As the fleet file describes it.
        probe: What it was found to say.
        opening: What opens the drones' ports in the firewall, see ``server.doctor.firewall``.
        config: The limits.
    """
    found = [_hello(drone, probe)]
    if found[0].status == "fail":
        return found
    found += _identity(drone, probe)
    found.append(_reads(probe))
    found += _body(probe, config)
    found.append(_state(drone, probe, opening, config))
    found.append(_video(drone, probe, opening, config))
    return [Finding(item.check, item.status, item.detail, item.remedy, drone.id) for item in found]


def _hello(drone: DroneConfig, probe: Probe) -> Finding:
    where = drone.address + (f" on {drone.interface}" if drone.interface else "")
    if probe.hello is None:
        detail = f"no answer to `command` from {where}"
        return Finding("drone", "fail", detail, _absent(drone, probe), drone.id)
    if probe.hello.kind != "ok":
        text = probe.hello.text
        if text.lower() == "unactive":
            remedy = "activate the drone once in the Tello app"
        else:
            remedy = "switch the drone off and on; no other program or app may be connected to it"
        return Finding("drone", "fail", f"answers {text!r} to `command`", remedy, drone.id)
    return Finding("drone", "ok", f"answers at {where}", "", drone.id)


def _absent(drone: DroneConfig, probe: Probe) -> str:
    if probe.state.count:
        return "reports come but no replies: end other programs that command it, then try again"
    if drone.address == AP_ADDRESS:
        return (
            "switch it on and wait until its light blinks yellow, join its Wi-Fi (TELLO-...) with"
            f" {drone.interface or 'this machine'}; an app on a phone must let go of it"
        )
    if IPv4Address(drone.address).is_loopback:
        return "start the simulator: dronerf sim"
    return (
        "is it on, and in this network? Its address may have changed:"
        f" dronerf doctor --scan {drone.address.rsplit('.', 1)[0]}.0/24"
    )


def _identity(drone: DroneConfig, probe: Probe) -> Iterator[Finding]:
    level = probe.number("sdk?")
    if level is None:
        detail = "does not tell its SDK level: 1.3, a consumer Tello"
        if drone.edu:
            yield Finding("SDK", "warn", detail, "set `edu = false` in the fleet file")
        else:
            yield Finding("SDK", "ok", detail)
    else:
        yield Finding("SDK", "ok", f"{level / 10:.1f}")
    serial = probe.reads.get("sn?")
    if serial and drone.serial and serial != drone.serial:
        remedy = "another drone has this address: correct `serial` or `address` in the fleet file"
        yield Finding("serial", "fail", f"{serial}, expected {drone.serial}", remedy)
    elif serial:
        yield Finding("serial", "ok", serial)
    else:
        yield Finding("serial", "skip", "it does not tell its serial number")


def _reads(probe: Probe) -> Finding:
    """Judge the answers to the reads; which of them a drone knows depends on its firmware."""
    detail = f"{len(probe.reads)} of {len(READS)} answered"
    missing = [question for question in READS if question not in probe.reads]
    if missing:
        detail += f", not {', '.join(missing)}"
    strange = not_understood(probe.reads)
    if strange:
        told = ", ".join(f"{probe.reads[question]!r} to {question}" for question in strange)
        remedy = "update the drone's firmware with its app; a flight goes by the state reports"
        return Finding("reads", "warn", f"{detail}; not understood: {told}", remedy)
    if "battery?" in missing:
        remedy = "in flight nothing shows whether it hears; keep its way to the adapter free"
        return Finding("reads", "warn", detail, remedy)
    return Finding("reads", "ok", detail)


def _body(probe: Probe, config: DoctorConfig) -> Iterator[Finding]:
    newest = probe.state.newest
    battery = newest.battery_pct if newest is not None else probe.number("battery?")
    if battery is None:
        yield Finding("battery", "skip", "neither reports nor replies tell it")
    else:
        remedy = "charge it, or change the battery; a flight lasts 8 to 10 minutes from full"
        status: Status = "ok"
        if battery < config.battery_warn_pct:
            status = "fail" if battery < config.battery_fly_pct else "warn"
        yield Finding("battery", status, f"{battery:.0f} %", "" if status == "ok" else remedy)
    if newest is not None:
        hot = newest.temperature_c
        status = "ok"
        if hot >= config.temperature_warn_c:
            status = "fail" if hot >= config.temperature_fail_c else "warn"
        remedy = "" if status == "ok" else "switch it off for some minutes, or let a fan blow at it"
        yield Finding("temperature", status, f"{hot:.0f} C", remedy)
    signal = probe.number("wifi?")
    if signal is not None and signal < config.wifi_warn:
        remedy = "bring it nearer, another channel, or adapters further apart"
        yield Finding("Wi-Fi", "warn", f"signal to noise {signal:.0f}", remedy)
    elif signal is not None:
        yield Finding("Wi-Fi", "ok", f"signal to noise {signal:.0f}")
    if probe.state.motors_run:
        detail = "the motors run: the drone was only asked, nothing was switched"
        yield Finding("motors", "warn", detail, "land it and run the doctor again for its video")


def _state(drone: DroneConfig, probe: Probe, opening: str, config: DoctorConfig) -> Finding:
    state = probe.state
    if not state.count:
        if state.bad:
            detail = f"{state.bad} state reports, none of them readable"
            return Finding("state", "fail", detail, "update the drone's firmware with its app")
        if state.strangers:
            detail = f"reports come from {state.strangers[0]}, not from {drone.address}"
            remedy = "correct `address` in the fleet file, or `interface` if the network has a NAT"
            return Finding("state", "fail", detail, remedy)
        detail = f"commands are answered, but nothing arrives at UDP {drone.state_port}: firewall?"
        remedy = f"{opening}; or it still reports to another computer: switch it off and on"
        return Finding("state", "fail", detail, remedy)
    age_s = state.age_s or 0.0
    detail = f"{state.rate_hz:.1f} reports per second, the newest {age_s:.2f} s old"
    if state.bad:
        detail += f", {state.bad} unreadable"
    near = "bring drone and adapter nearer, choose a quieter Wi-Fi channel"
    if age_s > config.state_age_s:
        return Finding("state", "fail", detail, near)
    if state.rate_hz < config.state_rate_hz:
        return Finding("state", "warn", detail, near)
    return Finding("state", "ok", detail)


def _video(drone: DroneConfig, probe: Probe, opening: str, config: DoctorConfig) -> Finding:
    video = probe.video
    if video is None:
        return Finding("video", "skip", "not switched on while the motors run")
    if not video.datagrams:
        return _no_video(drone, probe, video, opening)
    if video.first_whole_s is None:
        detail = f"{video.datagrams} datagrams, no whole picture in {config.key_picture_s:.0f} s"
        remedy = "too much is lost on the way: nearer, another channel, fewer drones per channel"
        return Finding("video", "fail", detail, remedy)
    fps = video.pictures / video.seconds
    share = video.damaged / video.pictures if video.pictures else 0.0
    detail = (
        f"first picture after {video.first_whole_s:.1f} s, {fps:.1f} per second,"
        f" {share:.0%} damaged"
    )
    simulated = IPv4Address(drone.address).is_loopback
    least = config.fps_least_simulated if simulated else config.fps_least
    if not video.pictures or share >= config.damaged_fail:
        remedy = "too much is lost on the way: nearer, another channel, fewer drones per channel"
        return Finding("video", "fail", detail, remedy)
    if share >= config.damaged_warn:
        remedy = "damaged pictures never enter a dataset; a quieter Wi-Fi channel helps"
        return Finding("video", "warn", detail, remedy)
    if fps < least:
        remedy = f"at least {least:g} are expected: a quieter channel, a less busy machine"
        return Finding("video", "warn", detail, remedy)
    return Finding("video", "ok", detail)


def _no_video(drone: DroneConfig, probe: Probe, video: VideoSeen, opening: str) -> Finding:
    level = probe.number("sdk?") or 13
    if drone.link == "station" and level < _STATION_VIDEO_SDK:
        detail = f"none: a drone of SDK {level / 10:.1f} sends none in station mode"
        remedy = "update its firmware to SDK 3.0, or fly it over its own Wi-Fi"
        return Finding("video", "fail", detail, remedy)
    if video.refused:
        detail = f"none: it answers {video.refused!r} to `streamon`"
        return Finding("video", "fail", detail, "switch the drone off and on")
    if video.strangers:
        detail = f"video comes from {video.strangers[0]}, not from {drone.address}"
        return Finding("video", "fail", detail, "correct `address` in the fleet file")
    if probe.state.count:
        detail = f"state arrives, but nothing at UDP {drone.video_port}: firewall?"
    else:
        detail = f"nothing arrives at UDP {drone.video_port}: firewall?"
    return Finding("video", "fail", detail, opening)
