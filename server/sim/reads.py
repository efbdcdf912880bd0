"""What a drone answers to reads, and its state report; pure."""

from __future__ import annotations

from server.sim.dynamics import Airframe
from server.sim.words import SdkLevel

_WIFI_SNR = "90"
_SDK_NUMBERS = {"2.0": "20", "3.0": "30"}
_REPORT = (
    "pitch:%d;roll:%d;yaw:%d;vgx:%d;vgy:%d;vgz:%d;templ:%d;temph:%d;tof:%d;h:%d;bat:%d;baro:%.2f;"
    "time:%d;agx:%.2f;agy:%.2f;agz:%.2f;\r\n"
)
# Detection of mission pads off, and on without a pad in sight.
_PADS_OFF = {
    "1.3": "",
    "2.0": "mid:-1;x:0;y:0;z:0;mpry:0,0,0;",
    "3.0": "mid:-2;x:-200;y:-200;z:-200;mpry:0,0,0;",
}
_PADS_ON = {**_PADS_OFF, "3.0": "mid:-1;x:-100;y:-100;z:-100;mpry:-1,-1,-1;"}


def state_line(airframe: Airframe, level: SdkLevel = "3.0", looks_for_pads: bool = False) -> bytes:
    """Return the state report of a drone of this level."""
    pads = (_PADS_ON if looks_for_pads else _PADS_OFF)[level]
    return (pads + _REPORT % tuple(airframe.readings().values())).encode("ascii")


def read_reply(
    name: str,
    airframe: Airframe,
    *,
    speed_cm_s: float,
    serial: str,
    level: SdkLevel,
    friendly: bool,
) -> str:
    """Return the reply to a read that the level knows, line end included.

    Args:
        name: The read without its question mark.
        airframe: Whose sensors to read.
        speed_cm_s: The speed set for moves.
        serial: The serial number.
        level: The SDK level.
        friendly: True for plain whole numbers instead of a real drone's units and decimals.
    """
    values = airframe.readings()
    match name:
        case "battery":
            body = f"{values['bat']:.0f}"
        case "speed":
            body = f"{speed_cm_s:.0f}" if friendly else f"{speed_cm_s:.1f}"
        case "time":
            body = f"{values['time']:.0f}" + ("" if friendly else "s")
        case "wifi":
            body = _WIFI_SNR
        case "sdk":
            body = _SDK_NUMBERS[level]
        case "sn":
            body = serial
        case "hardware":
            body = "TELLO"
        case "active":
            body = "active"
        case "height":
            body = f"{values['h']:.0f}" if friendly else f"{values['h'] / 10:.0f}dm"
        case "temp":
            body = f"{values['temph']:.0f}"
            body = body if friendly else f"{values['templ']:.0f}~{body}C"
        case "attitude":
            body = "pitch:{pitch:.0f};roll:{roll:.0f};yaw:{yaw:.0f};".format(**values)
        case "acceleration":
            body = "agx:{agx:.2f};agy:{agy:.2f};agz:{agz:.2f};".format(**values)
        case "baro":
            body = f"{values['baro']:.0f}" if friendly else f"{values['baro']:.6f}"
        case "tof":
            # Clients in the wild cut the unit off without looking, so it stays in both forms.
            body = f"{10 * values['tof']:.0f}mm"
        case _:
            raise ValueError(f"no such read: {name}")
    return body + "\r\n"
