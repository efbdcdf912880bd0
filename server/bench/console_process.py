"""A console as people run it, as a process of its own, for benches that measure it from outside."""

from __future__ import annotations

import asyncio
import os
import secrets
import sys
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path

import httpx

from server.sim.config import SimConfig, fleet_config

_START_S = 60.0


@dataclass(frozen=True, slots=True)
class ServedConsole:
    """A console that runs.

    Attributes:
        address: Its ``http`` address, without a slash at the end.
        headers: What a request has to carry to be let in.
        client: A client with both.
    """

    address: str
    headers: dict[str, str]
    client: httpx.AsyncClient


@asynccontextmanager
async def served_console(
    drones: SimConfig, folder: Path, settings: str
) -> AsyncIterator[ServedConsole]:
    """Run ``dronerf serve`` for simulated drones that listen already.

    Args:
        drones: The drones.
        folder: Where its files go.
        settings: Its settings file, TOML.

    Raises:
        RuntimeError: If it does not start.
    """
    fleet = folder / "fleet.toml"
    fleet.write_text(
        "".join(
            f'[[drones]]\nid = "{d.id}"\naddress = "{d.address}"\nlocal_address = '
            f'"{d.local_address}"\nazimuth_deg = {d.azimuth_deg}\n'
            for d in fleet_config(drones).drones
        )
    )
    (folder / "settings.toml").write_text(settings)
    token = secrets.token_urlsafe(16)
    process = await asyncio.create_subprocess_exec(
        sys.executable,
        "-P",
        "-m",
        "server",
        "serve",
        "--fleet",
        str(fleet),
        "--port",
        "0",
        "--runs",
        str(folder / "runs"),
        env=os.environ | {"DRONERF_TOKEN": token, "DRONERF_CONFIG": str(folder / "settings.toml")},
        stderr=asyncio.subprocess.PIPE,
        start_new_session=True,
    )
    assert process.stderr is not None
    drain: asyncio.Task[bytes] | None = None
    failed, said = False, b""
    try:
        async with asyncio.timeout(_START_S):
            while b"The console is at" not in (line := await process.stderr.readline()):
                said += line
                if not line:
                    raise RuntimeError("the console did not start")
        address = line.decode().split("at ", 1)[1].split("/?")[0]
        drain = asyncio.create_task(process.stderr.read())
        headers = {"Authorization": f"Bearer {token}"}
        async with httpx.AsyncClient(base_url=address, headers=headers, timeout=30.0) as client:
            yield ServedConsole(address, headers, client)
    except BaseException:
        failed = True
        raise
    finally:
        if process.returncode is None:
            process.terminate()
        await process.wait()
        said += await (process.stderr.read() if drain is None else drain)
        if failed:
            # Whatever went wrong, the console may have said why.
            print(said.decode(errors="replace"), file=sys.stderr)


async def until_activity(client: httpx.AsyncClient, activity: str, count: int) -> None:
    """Wait until ``count`` drones report ``activity``.

    Raises:
        TimeoutError: If that takes too long.
    """
    async with asyncio.timeout(_START_S):
        while True:
            reports = (await client.get("/api/v1/drones")).json()
            if sum(report["activity"] == activity for report in reports) == count:
                return
            await asyncio.sleep(0.2)


async def command(client: httpx.AsyncClient, drone_id: str, word: str) -> None:
    """Give a drone a command.

    Raises:
        RuntimeError: If it is refused, with the console's reason.
    """
    answer = await client.post(f"/api/v1/drones/{drone_id}/commands", json={"command": word})
    if answer.is_error:
        raise RuntimeError(f"{drone_id}: {word} was refused: {answer.text}")
