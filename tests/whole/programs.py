"""Starts the real programs as child processes, as a user would."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import httpx
from playwright.sync_api import Page, expect, sync_playwright

from server.bench.dashboard import CHROMIUM_ARGUMENTS

# Installs a package into an environment of its own and returns that one's interpreter.
Peer = Callable[..., Path]
TOKEN = "a-token-for-tests"
COMMAND = [sys.executable, "-P", "-m", "server"]


def free_port() -> int:
    """Return a TCP port nobody listens on now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@contextmanager
def console(runs: Path, *arguments: str, port: int | None = None) -> Iterator[str]:
    """Run ``dronerf serve`` and yield its address once it answers."""
    port = port or free_port()
    environment = os.environ | {"DRONERF_TOKEN": TOKEN}
    process = subprocess.Popen(
        [*COMMAND, "serve", "--port", str(port), "--runs", str(runs), *arguments],
        env=environment,
    )
    address = f"http://127.0.0.1:{port}"
    try:
        deadline = time.monotonic() + 120.0
        while True:
            assert process.poll() is None, "the console ended"
            assert time.monotonic() < deadline, "the console does not answer"
            try:
                if httpx.get(f"{address}/readyz").status_code == 200:
                    break
            except httpx.TransportError:
                time.sleep(0.2)
        yield address
    finally:
        process.terminate()
        try:
            process.wait(30.0)
        finally:
            process.kill()


@contextmanager
def operator(address: str, width: int = 1440, height: int = 900) -> Iterator[Page]:
    """Open the console in a browser of its own, patient with a busy machine."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=shutil.which("chromium"), args=CHROMIUM_ARGUMENTS
        )
        page = browser.new_page(viewport={"width": width, "height": height})
        page.set_default_timeout(60_000)
        expect.set_options(timeout=60_000)
        page.goto(f"{address}/?token={TOKEN}")
        yield page
        browser.close()
