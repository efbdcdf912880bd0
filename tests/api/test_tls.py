"""HTTPS by certificate files, spoken by the real server."""

from __future__ import annotations

import asyncio
import shutil
import ssl
import subprocess
from pathlib import Path

import httpx
import pytest
from served_console import TOKEN, serve
from websockets.asyncio.client import connect

from server.settings import SettingsError, load_settings

pytestmark = [
    pytest.mark.loopback,
    pytest.mark.skipif(shutil.which("openssl") is None, reason="no openssl to make a certificate"),
]


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    folder = tmp_path_factory.mktemp("tls")
    certificate, key = folder / "certificate.pem", folder / "key.pem"
    command = ["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256"]
    command += ["-nodes", "-days", "2", "-subj", "/CN=console", "-keyout", str(key)]
    command += ["-addext", "subjectAltName=IP:127.0.0.1", "-out", str(certificate)]
    subprocess.run(command, check=True, capture_output=True, timeout=60)
    return certificate, key


async def test_everything_goes_over_https(tmp_path: Path, pair: tuple[Path, Path]) -> None:
    trusting = ssl.create_default_context(cafile=str(pair[0]))
    async with serve(tmp_path, tls=pair) as console:
        address = f"https://{console.address}"
        async with httpx.AsyncClient(base_url=address, verify=trusting, trust_env=False) as client:
            signed_in = await client.post("/login", data={"token": TOKEN})
            assert "secure" in signed_in.headers["set-cookie"].lower()
            answer = await client.get("/api/v1/me")
            assert answer.json()["role"] == "admin"
            assert answer.headers["strict-transport-security"].startswith("max-age=")
        socket = f"wss://{console.address}/api/v1/stream"
        async with connect(
            socket, ssl=trusting, additional_headers=console.headers, proxy=None
        ) as stream:
            async with asyncio.timeout(10):
                assert await stream.recv()
        async with httpx.AsyncClient(base_url=console.http, trust_env=False) as plain:
            with pytest.raises(httpx.TransportError):
                await plain.get("/livez")


def test_a_certificate_and_another_key_are_refused(tmp_path: Path, pair: tuple[Path, Path]) -> None:
    assert load_settings(tls_certificate=pair[0], tls_key=pair[1]).tls() == pair
    other = tmp_path / "other.pem"
    command = ["openssl", "genpkey", "-algorithm", "EC", "-pkeyopt", "ec_paramgen_curve:P-256"]
    command += ["-out", str(other)]
    subprocess.run(command, check=True, capture_output=True, timeout=60)
    with pytest.raises(SettingsError, match=r"other\.pem"):
        load_settings(tls_certificate=pair[0], tls_key=other).tls()
