"""How the drones' ports are opened in the firewall of this machine."""

from __future__ import annotations

import platform
import shutil
from collections.abc import Collection, Sequence
from pathlib import Path

_TOOLS = ("ufw", "firewall-cmd", "nft", "iptables")


def read_platform() -> str:
    """Return ``linux``, ``wsl``, ``darwin`` or ``windows``."""
    system = platform.system().lower()
    try:
        version = Path("/proc/version").read_text(encoding="utf-8", errors="replace")
    except OSError:
        version = ""
    return "wsl" if system == "linux" and "microsoft" in version.lower() else system


def read_tools() -> set[str]:
    """Return which of the known firewall tools are installed."""
    return {tool for tool in _TOOLS if shutil.which(tool)}


def opening_advice(ports: Sequence[int], system: str, tools: Collection[str]) -> str:
    """Return what opens UDP ``ports`` for the drones.

    Args:
        ports: The ports drones send to.
        system: See ``read_platform``.
        tools: Installed firewall tools.
    """
    listed = ",".join(map(str, ports))
    if system == "windows":
        return (
            'as administrator: netsh advfirewall firewall add rule name="DroNeRF" dir=in'
            f" action=allow protocol=UDP localport={listed}"
        )
    if system == "wsl":
        return (
            f"WSL hides UDP {listed} behind Windows: set networkingMode=mirrored in .wslconfig and"
            f" open the ports there, or run the console on Windows or Linux itself"
        )
    if system == "darwin":
        return (
            "System Settings > Network > Firewall: allow incoming connections for Python;"
            " Privacy > Local Network: allow your terminal"
        )
    if "ufw" in tools:
        return "; ".join(f"sudo ufw allow {port}/udp" for port in ports)
    if "firewall-cmd" in tools:
        added = " ".join(f"--add-port={port}/udp" for port in ports)
        return f"sudo firewall-cmd {added} (and again with --permanent)"
    if "nft" in tools:
        return f"sudo nft insert rule inet filter input udp dport '{{ {listed} }}' accept"
    if "iptables" in tools:
        return f"sudo iptables -I INPUT -p udp -m multiport --dports {listed} -j ACCEPT"
    return f"let UDP {listed} in from the drones, in this machine's and its host's firewall"
