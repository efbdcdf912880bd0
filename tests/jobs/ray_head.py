"""A real Ray head on this machine, where Ray is installed."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import httpx
import psutil
import pytest

_START_S = 120.0


def ray_program() -> str:
    """Return the ``ray`` command; skips the test where there is none."""
    beside = Path(sys.executable).with_name("ray")
    found = str(beside) if beside.exists() else shutil.which("ray")
    if found is None:
        pytest.skip("Ray is not installed (pip install '.[ray]')")
    return found


def free_ports(count: int) -> list[int]:
    sockets = [socket.create_server(("127.0.0.1", 0)) for _ in range(count)]
    ports = [sock.getsockname()[1] for sock in sockets]
    for sock in sockets:
        sock.close()
    return ports


class RayHead:
    """A head with ``cpus`` processors.

    Attributes:
        address: Where its Jobs API is.
    """

    def __init__(self, cpus: int, folder: Path) -> None:
        dashboard, gcs, client, agent = free_ports(4)
        self.address = f"http://127.0.0.1:{dashboard}"
        command = [ray_program(), "start", "--head", "--block", f"--num-cpus={cpus}"]
        command += ["--include-dashboard=true", "--dashboard-host=127.0.0.1"]
        command += [f"--dashboard-port={dashboard}", f"--port={gcs}"]
        command += [f"--ray-client-server-port={client}", f"--dashboard-agent-listen-port={agent}"]
        command += ["--object-store-memory=80000000", "--disable-usage-stats"]
        command += [f"--temp-dir={folder}"]
        # Workers import this checkout, whatever else is installed.
        path = os.pathsep.join([str(Path(__file__).parents[2]), os.environ.get("PYTHONPATH", "")])
        with (folder / "head.log").open("wb") as log:
            self._process = subprocess.Popen(
                command,
                stdout=log,
                stderr=log,
                start_new_session=True,
                env=os.environ | {"PYTHONPATH": path},
            )
        self._log = folder / "head.log"

    def wait(self) -> None:
        """Wait until it takes jobs."""
        deadline_s = time.monotonic() + _START_S
        while time.monotonic() < deadline_s:
            assert self._process.poll() is None, self._log.read_text()
            try:
                # The list of jobs is answered by the last part to come up.
                if httpx.get(f"{self.address}/api/jobs/", timeout=5.0).is_success:
                    return
            except httpx.HTTPError:
                pass
            time.sleep(0.3)
        pytest.fail(f"Ray did not start: {self._log.read_text()}")

    def kill(self) -> None:
        """Kill it with all its parts and jobs, as a machine that loses power; twice is harmless."""
        if self._process.poll() is not None:
            return
        head = psutil.Process(self._process.pid)
        for process in [*head.children(recursive=True), head]:
            with suppress(psutil.NoSuchProcess):
                process.kill()
        self._process.wait()


@contextmanager
def ray_head(cpus: int) -> Iterator[RayHead]:
    """Run a head and kill it at the end."""
    ray_program()
    # Ray's sockets need a short path.
    with tempfile.TemporaryDirectory(
        prefix="ray-", dir="/tmp", ignore_cleanup_errors=True
    ) as folder:
        head = RayHead(cpus, Path(folder))
        try:
            head.wait()
            yield head
        finally:
            head.kill()
