"""Findings for people (a table, in colour on a terminal) and for programs (one JSON object)."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from ipaddress import IPv4Network

from rich.console import Console
from rich.text import Text

from server.doctor.finding import Finding, Status, exit_code
from server.doctor.scan import FoundDrone

_STYLES: dict[Status, str] = {"ok": "green", "warn": "yellow", "fail": "bold red", "skip": "dim"}
_CHECK_WIDTH = 20
_INDENT = 6 + _CHECK_WIDTH


class ReportPrinter:
    """Prints findings as they come, headed by what they are about."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._about: str | None = None

    def show(self, finding: Finding) -> None:
        """Print one finding and, unless all is well, what to do about it."""
        about = finding.drone_id
        if about != self._about:
            self._console.print(Text(about or "this machine", "bold"))
            self._about = about
        style = _STYLES[finding.status]
        self._row(Text(f"{finding.status:<4}", style), finding.check, Text(finding.detail))
        if finding.remedy:
            self._row(Text("    "), "", Text(f"-> {finding.remedy}", style))

    def _row(self, status: Text, check: str, text: Text) -> None:
        # Wrapped by hand, so that a command to be copied never meets a table's frame.
        width = max(30, self._console.width - _INDENT - 2)
        for index, line in enumerate(text.wrap(self._console, width)):
            head = Text("  ") + status + Text(f"  {check:<{_CHECK_WIDTH}}")
            lead = head if index == 0 else Text(" " * len(head))
            line.rstrip()
            self._console.print(lead + line, soft_wrap=True)

    def found(self, drones: Sequence[FoundDrone], subnet: IPv4Network) -> None:
        """Print the result of a scan, from which drones of the fleet were left out."""
        self._console.print(Text(f"{subnet}, the fleet's own addresses left out", "bold"))
        if not drones:
            self._console.print("  no drone answered")
        for drone in drones:
            charge = "?" if drone.battery_pct is None else f"{drone.battery_pct:.0f} %"
            self._console.print(
                f"  {drone.address:<16}{drone.serial or '?':<16}SDK {drone.sdk or '1.3':<5}{charge}"
            )

    def summary(self, findings: Sequence[Finding]) -> None:
        """Print the last line."""
        failed = sum(finding.status == "fail" for finding in findings)
        warned = sum(finding.status == "warn" for finding in findings)
        style = _STYLES["fail" if failed else "warn" if warned else "ok"]
        good = len(findings) - failed - warned
        text = f"{failed} to mend, {warned} to look at, {good} others"
        self._console.print(Text(text, style))


def report_json(findings: Sequence[Finding], found: Sequence[FoundDrone] | None) -> str:
    """Return everything as one JSON object; ``found`` is None when nothing was scanned."""
    report: dict[str, object] = {
        "ok": not exit_code(findings),
        "findings": [asdict(finding) for finding in findings],
    }
    if found is not None:
        report["found"] = [asdict(drone) for drone in found]
    return json.dumps(report)
