"""From what a drone says to what is wrong with it; values alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from server.doctor.config import DoctorConfig
from server.doctor.diagnosis import diagnose
from server.doctor.finding import Finding
from server.doctor.probe import Probe, StateHeard, VideoSeen
from server.stages import Telemetry
from server.swarm.config import DroneConfig
from server.swarm.protocol import Reply

DRONE = DroneConfig(id="red")
OPENING = "open the ports"
STATE = Telemetry(
    drone_id="red",
    received_s=100.0,
    yaw_rad=0.0,
    pitch_rad=0.0,
    roll_rad=0.0,
    velocity_m_s=np.zeros(3),
    acceleration_m_s2=np.array([0.0, 0.0, 9.81]),
    height_m=0.0,
    tof_m=None,
    baro_m=0.0,
    battery_pct=87,
    temperature_c=80.0,
    motor_time_s=24.0,
)


def healthy() -> Probe:
    """A drone with nothing wrong."""
    return Probe(
        hello=Reply("ok", "ok"),
        reads={"sdk?": "20", "sn?": "0TQDG3UEDBSP12", "battery?": "87", "wifi?": "90"},
        state=StateHeard(count=20, seconds=2.0, first=STATE, newest=STATE, age_s=0.05),
        video=VideoSeen(datagrams=900, first_whole_s=1.2, pictures=90, seconds=3.0),
    )


def about(probe: Probe, drone: DroneConfig = DRONE) -> dict[str, Finding]:
    return {item.check: item for item in diagnose(drone, probe, OPENING, DoctorConfig())}


def test_nothing_is_wrong_with_a_healthy_drone() -> None:
    found = about(healthy())
    assert {item.status for item in found.values()} == {"ok"}
    assert {item.drone_id for item in found.values()} == {"red"}
    assert found["SDK"].detail == "2.0"


@pytest.mark.parametrize(
    ("drone", "words"),
    [
        (DRONE, "join its Wi-Fi"),
        (replace(DRONE, interface="wlan1"), "with wlan1"),
        (replace(DRONE, link="station", address="192.168.1.20"), "--scan 192.168.1.0/24"),
        (replace(DRONE, link="relay", address="127.0.1.1"), "dronerf sim"),
    ],
)
def test_a_silent_drone(drone: DroneConfig, words: str) -> None:
    found = about(Probe(), drone)
    assert list(found) == ["drone"]
    assert found["drone"].status == "fail"
    assert words in found["drone"].remedy


def test_reports_without_replies_mean_another_program() -> None:
    found = about(Probe(state=StateHeard(count=20, seconds=2.0)))
    assert "other programs" in found["drone"].remedy


@pytest.mark.parametrize(("text", "words"), [("unactive", "activate"), ("error", "off and on")])
def test_a_drone_that_refuses(text: str, words: str) -> None:
    found = about(Probe(hello=Reply("error", text)))
    assert found["drone"].status == "fail"
    assert words in found["drone"].remedy


def test_a_consumer_drone() -> None:
    probe = healthy()
    probe.reads = {"battery?": "87"}
    assert about(probe)["SDK"].status == "warn"
    assert "edu = false" in about(probe)["SDK"].remedy
    assert about(probe, replace(DRONE, edu=False))["SDK"].status == "ok"
    assert about(probe)["serial"].status == "skip"


def test_another_serial_number() -> None:
    assert about(healthy(), replace(DRONE, serial="0TQDG3UEDBSP12"))["serial"].status == "ok"
    assert about(healthy(), replace(DRONE, serial="0TQDG3UEDXXXXX"))["serial"].status == "fail"


@pytest.mark.parametrize(
    ("charge", "status"), [(14, "fail"), (19, "fail"), (25, "warn"), (60, "ok")]
)
def test_battery(charge: int, status: str) -> None:
    probe = healthy()
    probe.state.newest = replace(STATE, battery_pct=charge)
    assert about(probe)["battery"].status == status


@pytest.mark.parametrize(("hot", "status"), [(85.0, "ok"), (92.0, "warn"), (99.0, "fail")])
def test_temperature(hot: float, status: str) -> None:
    probe = healthy()
    probe.state.newest = replace(STATE, temperature_c=hot)
    assert about(probe)["temperature"].status == status


def test_a_weak_signal() -> None:
    probe = healthy()
    probe.reads["wifi?"] = "20"
    assert about(probe)["Wi-Fi"].status == "warn"


EVERY_READ = {
    "sdk?": "30",
    "sn?": "0TQDG3UEDBSP12",
    "battery?": "87",
    "wifi?": "90",
    "speed?": "100.0",
    "time?": "24s",
    "height?": "15dm",
    "temp?": "85~88C",
    "attitude?": "pitch:0;roll:-1;yaw:0;",
    "baro?": "-102.865509",
    "acceleration?": "agx:-5.00;agy:7.00;agz:-999.00;",
    "tof?": "875mm",
}
FRIENDLY = {"battery?": "87%", "speed?": "100", "time?": "24", "height?": "150", "temp?": "88"}


@pytest.mark.parametrize("other", [{}, FRIENDLY])
def test_reads_are_understood_in_both_formats(other: dict[str, str]) -> None:
    probe = healthy()
    probe.reads = EVERY_READ | other
    assert (about(probe)["reads"].status, about(probe)["reads"].detail) == (
        "ok",
        "12 of 12 answered",
    )
    probe.state = StateHeard(seconds=2.0)
    assert about(probe)["battery"].detail == "87 %"


def test_a_read_that_a_drone_does_not_know_is_no_failure() -> None:
    probe = healthy()
    probe.reads = {key: text for key, text in EVERY_READ.items() if key not in ("sdk?", "sn?")}
    assert about(probe)["reads"].status == "ok"
    assert about(probe)["reads"].detail == "10 of 12 answered, not sdk?, sn?"


def test_an_answer_in_no_known_form_is_named() -> None:
    probe = healthy()
    probe.reads = EVERY_READ | {"temp?": "85-88K", "time?": "15dm"}
    found = about(probe)["reads"]
    assert found.status == "warn"
    assert found.detail.startswith("12 of 12 answered; not understood: ")
    assert "'15dm' to time?" in found.detail
    assert "'85-88K' to temp?" in found.detail


def test_running_motors() -> None:
    probe = healthy()
    probe.state.newest = replace(STATE, motor_time_s=26.0)
    probe.video = None
    found = about(probe)
    assert found["motors"].status == "warn"
    assert found["video"].status == "skip"


def test_commands_answered_but_no_state_is_the_firewall() -> None:
    probe = healthy()
    probe.state = StateHeard(seconds=2.0)
    found = about(probe)
    assert found["state"].status == "fail"
    assert found["state"].remedy.startswith(OPENING)
    assert found["battery"].detail == "87 %", "from the read"


def test_state_from_elsewhere_is_not_the_firewall() -> None:
    probe = healthy()
    probe.state = StateHeard(seconds=2.0, strangers=["192.168.1.23"])
    assert "192.168.1.23" in about(probe)["state"].detail
    assert OPENING not in about(probe)["state"].remedy
    probe.state = StateHeard(seconds=2.0, bad=20)
    assert "readable" in about(probe)["state"].detail


@pytest.mark.parametrize(
    ("count", "age_s", "status"), [(20, 0.05, "ok"), (6, 0.3, "warn"), (15, 1.6, "fail")]
)
def test_rate_and_age_of_state(count: int, age_s: float, status: str) -> None:
    probe = healthy()
    probe.state = replace(probe.state, count=count, age_s=age_s)
    assert about(probe)["state"].status == status


def test_no_video_is_the_firewall_unless_the_drone_cannot() -> None:
    probe = healthy()
    probe.video = VideoSeen()
    assert about(probe)["video"].remedy == OPENING
    station = replace(DRONE, link="station", address="192.168.1.20")
    assert "SDK 2.0 sends none in station mode" in about(probe, station)["video"].detail
    probe.reads["sdk?"] = "30"
    assert about(probe, station)["video"].remedy == OPENING
    probe.video = VideoSeen(refused="error")
    assert "'error'" in about(probe)["video"].detail
    probe.video = VideoSeen(strangers=["192.168.1.23"])
    assert "192.168.1.23" in about(probe)["video"].detail


@pytest.mark.parametrize(
    ("pictures", "damaged", "first_s", "status"),
    [
        (90, 0, 1.2, "ok"),
        (90, 9, 1.2, "warn"),
        (90, 60, 1.2, "fail"),
        (20, 0, 1.2, "warn"),
        (0, 0, 1.2, "fail"),
        (0, 0, None, "fail"),
    ],
)
def test_quality_of_video(pictures: int, damaged: int, first_s: float | None, status: str) -> None:
    probe = healthy()
    probe.video = VideoSeen(
        datagrams=500, first_whole_s=first_s, pictures=pictures, damaged=damaged, seconds=3.0
    )
    assert about(probe)["video"].status == status


@pytest.mark.parametrize(
    ("question", "text", "number"),
    [
        ("time?", "24s", 24.0),
        ("speed?", "100.0", 100.0),
        ("battery?", "87", 87.0),
        ("battery?", "87%", 87.0),
        ("height?", "15dm", 1.5),
        ("time?", "15dm", None),
        ("temp?", "85~88C", None),
        ("battery?", "ok", None),
    ],
)
def test_numbers_in_replies(question: str, text: str, number: float | None) -> None:
    assert Probe(reads={question: text}).number(question) == number
    assert Probe().number(question) is None
