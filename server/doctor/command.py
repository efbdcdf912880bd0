"""``dronerf doctor``: examines, prints, and returns the exit code."""

from __future__ import annotations

import sys
from ipaddress import IPv4Address, IPv4Network

from rich.console import Console

from server.doctor.examination import Subject, examine, may_scan, named_by_scan
from server.doctor.finding import Finding, exit_code
from server.doctor.network import read_interfaces
from server.doctor.report import ReportPrinter, report_json
from server.doctor.scan import FoundDrone, scan


async def run_doctor(subject: Subject, subnet: IPv4Network | None, as_json: bool) -> int:
    """Examine the machine and the drones, scanning ``subnet`` first when there is one.

    Returns:
        0 when nothing failed, 1 otherwise.
    """
    printer = ReportPrinter(Console(highlight=False, quiet=as_json))
    findings: list[Finding] = []
    found: list[FoundDrone] | None = None
    if subnet is not None:
        refusal = may_scan(subnet)
        if refusal is not None:
            findings.append(refusal)
            printer.show(refusal)
        else:
            found = await _scan(subnet, subject)
            printer.found(found, subnet)
            if subject.fleet is not None:
                serials = {drone.serial: drone.address for drone in found if drone.serial}
                fleet = named_by_scan(subject.fleet, serials)
                subject = Subject(fleet, subject.runs, subject.web, subject.config)
    async for finding in examine(subject):
        findings.append(finding)
        printer.show(finding)
    printer.summary(findings)
    if as_json:
        sys.stdout.write(report_json(findings, found) + "\n")
    return exit_code(findings)


async def _scan(subnet: IPv4Network, subject: Subject) -> list[FoundDrone]:
    live = sys.stderr.isatty()

    def progress(asked: int, total: int, answered: int) -> None:
        if live or asked == total:
            start, end = ("\r", "") if live else ("", "\n")
            line = f"{start}scanning {subnet}: {asked} of {total}, {answered} answered{end}"
            sys.stderr.write(line)
            sys.stderr.flush()

    # A drone reports to whoever speaks to it first, so those of the fleet are left to their own
    # checks, which speak from the address and the interface that the fleet file names.
    known = {drone.address for drone in subject.fleet.drones} if subject.fleet else set()
    own = {str(address.ip) for item in read_interfaces() for address in item.addresses}
    own |= {str(subnet.network_address), str(IPv4Address(int(subnet.broadcast_address)))}
    try:
        return await scan(subnet, subject.config, progress, own | known)
    finally:
        if live:
            sys.stderr.write("\n")
