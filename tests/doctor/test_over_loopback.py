"""The doctor against simulated drones, with faults made by hand."""

from __future__ import annotations

import asyncio
import json
import socket
from dataclasses import replace
from pathlib import Path

import pytest
from rig import HARMLESS, rig, some_block

from server.doctor import network
from server.doctor.command import run_doctor
from server.doctor.config import DoctorConfig
from server.doctor.examination import Subject, examine, may_scan, named_by_scan
from server.doctor.finding import Finding
from server.doctor.network import Holder
from server.doctor.reads import READS
from server.doctor.scan import parse_subnet, scan
from server.sim.config import DynamicsConfig
from server.swarm.config import DroneConfig, FleetConfig, StationConfig

pytestmark = [pytest.mark.loopback, pytest.mark.slow]

# A busy machine answers late, and its cameras are slow: neither is what is tested here.
PATIENT = DoctorConfig(
    reply_s=2.0,
    state_rate_hz=0.1,
    state_age_s=10.0,
    key_picture_s=15.0,
    video_s=2.0,
    fps_least_simulated=0.1,
)
TOLERANT = replace(PATIENT, damaged_warn=0.99, damaged_fail=1.0)
HURRIED = DoctorConfig(reply_s=0.3, tries=2, key_picture_s=2.0, video_s=1.0)


async def findings_about_drones(
    fleet: FleetConfig, config: DoctorConfig, tmp_path: Path
) -> dict[tuple[str, str], Finding]:
    """Run all checks; return those about drones by (drone, check)."""
    subject = Subject(fleet, tmp_path, tmp_path, replace(config, gpu_s=0.01))
    return {
        (finding.drone_id, finding.check): finding
        async for finding in examine(subject)
        if finding.drone_id
    }


async def test_two_healthy_drones(tmp_path: Path) -> None:
    async with rig(drones=2) as made:
        found = await findings_about_drones(made.fleet, TOLERANT, tmp_path)
        streaming = [drone.sdk.streaming for drone in made.drones]
        standing = [drone.airframe.phase for drone in made.drones]
    assert {key: item.status for key, item in found.items() if item.status != "ok"} == {}
    for drone_id in ("drone-1", "drone-2"):
        checks = {check for about, check in found if about == drone_id}
        assert {"network", "drone", "SDK", "serial", "battery", "state", "video"} <= checks
    rate_hz = float(found["drone-1", "state"].detail.split()[0])
    # A simulated drone leaves reports out when it is late, it never sends more than ten.
    assert 0.0 < rate_hz <= 12.0
    assert found["drone-1", "serial"].detail != found["drone-2", "serial"].detail
    assert set(made.heard) <= HARMLESS
    assert streaming == [False, False], "the video was off before, so it is off afterwards"
    assert standing == ["standing", "standing"]


@pytest.mark.parametrize("friendly", [False, True])
async def test_every_read_is_understood_in_both_formats(tmp_path: Path, friendly: bool) -> None:
    async with rig(friendly_reads=friendly) as made:
        found = await findings_about_drones(made.fleet, PATIENT, tmp_path)
    reads = found["drone-1", "reads"]
    assert (reads.status, reads.detail) == ("ok", "12 of 12 answered")
    assert set(READS) < set(made.heard) <= HARMLESS


async def test_a_consumer_drone_does_not_know_all_reads(tmp_path: Path) -> None:
    async with rig(sdk="1.3") as made:
        found = await findings_about_drones(made.with_drone(edu=False), PATIENT, tmp_path)
    reads = found["drone-1", "reads"]
    assert (reads.status, reads.detail) == ("ok", "10 of 12 answered, not sdk?, sn?")


async def test_a_station_with_ports_of_its_own_is_told_them(tmp_path: Path) -> None:
    async with rig(station=True) as made:
        fleet = made.with_drone(link="station", state_port=8990, video_port=11990)
        found = await findings_about_drones(fleet, TOLERANT, tmp_path)
    assert [found["drone-1", check].status for check in ("state", "video")] == ["ok", "ok"]
    assert set(made.heard) - HARMLESS == {"port 8990 11990"}


async def test_nobody_there(tmp_path: Path) -> None:
    async with rig() as made:
        fleet = made.with_drone(address=made.config.address.rsplit(".", 1)[0] + ".77")
        found = await findings_about_drones(fleet, HURRIED, tmp_path)
    drone = found["drone-1", "drone"]
    assert drone.status == "fail"
    assert "no answer" in drone.detail
    assert "dronerf sim" in drone.remedy
    assert ("drone-1", "video") not in found, "nothing more is guessed about a silent drone"
    assert made.heard == []


async def test_state_that_is_eaten_on_the_way(tmp_path: Path) -> None:
    async with rig() as made:
        # The drone sends to 8890 as always; here is listened elsewhere, as behind a firewall.
        found = await findings_about_drones(made.with_drone(state_port=8990), PATIENT, tmp_path)
    state = found["drone-1", "state"]
    assert state.status == "fail"
    assert "firewall" in state.detail
    assert "8990" in state.remedy
    assert found["drone-1", "drone"].status == "ok"
    assert found["drone-1", "battery"].detail == "100 %", "asked for, since no report tells it"


async def test_a_low_battery(tmp_path: Path) -> None:
    async with rig(dynamics=DynamicsConfig(battery_pct=12.0)) as made:
        found = await findings_about_drones(made.fleet, PATIENT, tmp_path)
    assert found["drone-1", "battery"].status == "fail"
    assert "charge" in found["drone-1", "battery"].remedy


async def test_no_video(tmp_path: Path) -> None:
    async with rig(lost=lambda number: True) as made:
        found = await findings_about_drones(made.fleet, HURRIED, tmp_path)
        streaming = made.drones[0].sdk.streaming
    video = found["drone-1", "video"]
    assert video.status == "fail"
    assert "nothing at UDP 11111" in video.detail
    assert "11111" in video.remedy
    assert not streaming


async def test_damaged_video(tmp_path: Path) -> None:
    async with rig(lost=lambda number: number % 30 == 29) as made:
        found = await findings_about_drones(made.fleet, PATIENT, tmp_path)
    assert found["drone-1", "video"].status in ("warn", "fail")


async def test_a_drone_in_the_air_is_only_asked(tmp_path: Path) -> None:
    async with rig() as made:
        airframe = made.drones[0].airframe
        airframe.take_off()
        found = await findings_about_drones(made.fleet, PATIENT, tmp_path)
        phase = airframe.phase
    assert phase in ("taking_off", "flying")
    assert found["drone-1", "motors"].status == "warn"
    assert found["drone-1", "video"].status == "skip"
    assert set(made.heard) <= HARMLESS - {"streamon", "streamoff"}


async def test_a_stream_that_was_on_stays_on(tmp_path: Path) -> None:
    async with rig() as made:
        sdk = made.drones[0].sdk
        sender = (made.config.local_address, 40000)
        for text in (b"command", b"streamon"):
            sdk.receive(text, sender, asyncio.get_running_loop().time())
        found = await findings_about_drones(made.fleet, TOLERANT, tmp_path)
        streaming = sdk.streaming
    assert found["drone-1", "video"].status == "ok"
    assert streaming
    assert not {"streamon", "streamoff"} & set(made.heard)


async def test_another_drone_than_expected(tmp_path: Path) -> None:
    async with rig() as made:
        fleet = made.with_drone(serial="0TQDG3UEDBSP12")
        found = await findings_about_drones(fleet, PATIENT, tmp_path)
    assert found["drone-1", "serial"].status == "fail"
    assert "0TQDG3UEDBSP12" in found["drone-1", "serial"].detail


async def test_a_taken_port_is_named_and_the_drone_not_asked(tmp_path: Path) -> None:
    async with rig() as made:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as held:
            held.bind((made.config.local_address, 8890))
            subject = Subject(made.fleet, tmp_path, tmp_path, replace(HURRIED, gpu_s=0.01))
            findings = [finding async for finding in examine(subject)]
    taken = [f for f in findings if f.check == "UDP port 8890"]
    assert [finding.status for finding in taken] == ["fail"]
    drones = [f for f in findings if f.check == "drone"]
    assert [finding.status for finding in drones] == ["skip"]
    assert made.heard == []


async def test_a_bad_interface(tmp_path: Path) -> None:
    async with rig() as made:
        fleet = made.with_drone(interface="wlan-nowhere", local_address="")
        found = await findings_about_drones(fleet, HURRIED, tmp_path)
    assert found["drone-1", "network"].status == "fail"
    assert "no interface wlan-nowhere" in found["drone-1", "network"].detail
    assert found["drone-1", "drone"].status == "skip"
    assert made.heard == []


async def test_a_drone_known_by_its_serial_number_alone_is_not_looked_for(tmp_path: Path) -> None:
    lost = DroneConfig(id="red", address="", serial="0TQDG3UEDBSP12")
    fleet = FleetConfig((lost,), station=StationConfig(subnet="192.168.1.0/24"))
    found = await findings_about_drones(fleet, HURRIED, tmp_path)
    assert found["red", "drone"].status == "skip"
    assert "--scan 192.168.1.0/24" in found["red", "drone"].detail


async def test_a_scan_finds_drones_and_says_who_they_are() -> None:
    told: list[tuple[int, int, int]] = []
    async with rig(drones=3) as made:
        block = made.config.address.rsplit(".", 1)[0]
        network = parse_subnet(f"{block}.0/27")
        found = await scan(
            network, PATIENT, lambda *numbers: told.append(numbers), skip=(f"{block}.2",)
        )
    assert [drone.address for drone in found] == [f"{block}.1", f"{block}.3"]
    assert len({drone.serial for drone in found}) == 2
    assert all(drone.battery_pct == 100.0 for drone in found)
    assert told[-1] == (58, 58, 2)
    assert set(made.heard) <= HARMLESS
    serials = {drone.serial: drone.address for drone in found}
    named = DroneConfig(address="", serial=found[1].serial)
    fleet = FleetConfig((named,), station=StationConfig(subnet=str(network)))
    assert named_by_scan(fleet, serials).drones[0].address == f"{block}.3"


async def test_a_scan_understands_a_charge_with_its_unit(monkeypatch: pytest.MonkeyPatch) -> None:
    async with rig() as made:
        sdk = made.drones[0].sdk
        told = sdk._read

        def with_unit(name: str) -> str:
            return "87%\r\n" if name == "battery" else told(name)

        monkeypatch.setattr(sdk, "_read", with_unit)
        address = made.config.address.rsplit(".", 1)[0]
        found = await scan(parse_subnet(f"{address}.0/30"), PATIENT, lambda *numbers: None)
    assert [drone.battery_pct for drone in found] == [87.0]


async def test_an_empty_subnet() -> None:
    network = parse_subnet(f"{some_block()}.0/29")
    assert await scan(network, HURRIED, lambda *numbers: None) == []


async def test_the_command_prints_one_object_and_says_1_when_something_fails(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    async with rig(dynamics=DynamicsConfig(battery_pct=12.0)) as made:
        subject = Subject(made.fleet, tmp_path, tmp_path, replace(PATIENT, gpu_s=0.01))
        assert await run_doctor(subject, None, as_json=True) == 1
    report = json.loads(capsys.readouterr().out)
    assert report["ok"] is False
    failed = [item for item in report["findings"] if item["status"] == "fail"]
    assert {item["check"] for item in failed} == {"battery"}
    assert all(item["remedy"] for item in failed)
    assert "found" not in report


async def test_the_command_without_drones_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    subject = Subject(None, tmp_path, tmp_path, replace(HURRIED, gpu_s=0.01))
    assert await run_doctor(subject, None, as_json=False) == 0
    text = capsys.readouterr().out
    assert "none were asked" in text
    assert "--fleet FILE" in text


async def test_a_running_console_is_left_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    console = Holder(4711, "/x/bin/python /x/bin/dronerf serve --fleet f.toml")
    async with rig() as made:
        monkeypatch.setattr(network, "read_holders", lambda port, where: [console])
        subject = Subject(made.fleet, tmp_path, tmp_path, replace(HURRIED, gpu_s=0.01))
        findings = [finding async for finding in examine(subject)]
        refusal = may_scan(parse_subnet("192.168.1.0/24"))
    assert (findings[-1].check, findings[-1].status) == ("drones", "skip")
    assert "process 4711 (dronerf serve --fleet f.toml)" in findings[-1].detail
    assert made.heard == []
    assert refusal is not None
    assert refusal.status == "skip"


async def test_a_scan_leaves_the_fleet_to_its_own_checks(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    async with rig(drones=2) as made:
        block = made.config.address.rsplit(".", 1)[0]
        subject = Subject(made.with_drone(), tmp_path, tmp_path, replace(PATIENT, gpu_s=0.01))
        assert await run_doctor(subject, parse_subnet(f"{block}.0/29"), as_json=True) == 0
    report = json.loads(capsys.readouterr().out)
    assert [drone["address"] for drone in report["found"]] == [f"{block}.2"]
    state = [item for item in report["findings"] if item["check"] == "state"]
    assert [(item["drone_id"], item["status"]) for item in state] == [("drone-1", "ok")]
