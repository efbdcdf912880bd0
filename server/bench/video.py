"""``dronerf bench video``: four streams of 30 pictures a second through the whole console.

The console runs as its own process, started as people start it. This process flies four simulated
drones in front of it, sends their video, encoded beforehand, over UDP, and is the one client of its
event stream: it takes every tile over a websocket and acknowledges it, as the dashboard does. The
console is read at its ``/metrics``: processor time, pictures decoded and annotated, and the seconds
from the last datagram of each picture to its annotated JPEG. Those are of the newest 7200 pictures:
all of a whole run, and in a quick one those of the warm-up, too.
"""

from __future__ import annotations

import asyncio
import tempfile
import time
from collections.abc import Sequence
from contextlib import AsyncExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from server.app import free_loopback_block
from server.bench.console_process import ServedConsole, command, served_console, until_activity
from server.bench.options import Figures, Options, each_scene
from server.bench.video_streams import Stream, hovering_stream, next_key
from server.bench.viewer import Viewer
from server.sim.config import SimConfig
from server.sim.drone import SimulatedDrone
from server.sim.scenes.catalogue import SCENES

QUICK_SCENES = tuple(SCENES)

_DRONES = 4
_FPS = 30.0
_SECONDS, _QUICK_SECONDS = 60.0, 20.0
_WARM_UP_S = 3.0
_START_S = 120.0
# Long enough for the console to finish what it was sent, unless the machine is overloaded; too
# short for it to ask again for video.
_PAUSE_S = 0.6
_LATEST_S = 5.0
# The pictures show a hover that the simulated drones' own drift does not follow: neither must land
# or hold them.
_SETTINGS = """
[safety.failsafes]
object_age_s = {}
pose_sigma_m = {}
"""


def run(options: Options) -> Figures:
    """Measure once: one drone per scene, the scenes in turn when there are fewer."""
    seconds = _QUICK_SECONDS if options.quick else _SECONDS
    parts = each_scene("video", _whole(options), lambda _: measure(options, seconds))
    figures = parts["streams"]
    return Figures(scenes=figures.pop("scenes"), overall=figures)


def _whole(options: Options) -> Options:
    # All streams run at once, so there is one part; it is kept like that of a scene.
    return replace(options, scenes=("streams",))


def measure(options: Options, seconds: float) -> dict[str, Any]:
    """Return the figures of ``seconds`` of video."""
    scenes = [options.scenes[index % len(options.scenes)] for index in range(_DRONES)]
    streams = [hovering_stream(s, i, _FPS, options.seed) for i, s in enumerate(scenes)]
    with tempfile.TemporaryDirectory(prefix="dronerf-video-") as folder:
        figures, tiles = asyncio.run(_measure(streams, seconds, options.seed, Path(folder)))
    if options.out is not None:
        for drone_id, jpeg in tiles.items():
            (options.out / f"video-{drone_id}.jpg").write_bytes(jpeg)
    return figures | {"scenes": _described(scenes, streams)}


def _described(scenes: Sequence[str], streams: Sequence[Stream]) -> dict[str, dict[str, Any]]:
    """Return what each scene's streams weigh."""
    described: dict[str, dict[str, Any]] = {}
    for scene, stream in zip(scenes, streams, strict=True):
        sent_bytes = sum(len(datagram) for picture in stream for datagram in picture)
        rate = 8e-3 * sent_bytes * _FPS / len(stream)
        streams_before = described.get(scene, {"streams": 0})["streams"]
        described[scene] = {"streams": streams_before + 1, "kbit_s": round(rate)}
    return described


async def _measure(
    streams: Sequence[Stream], seconds: float, seed: int, folder: Path
) -> tuple[dict[str, Any], dict[str, bytes]]:
    """Return the figures, and the newest tile of each drone."""
    config = SimConfig(base_address=free_loopback_block(_DRONES), drones=_DRONES, seed=seed)
    async with AsyncExitStack() as stack:
        drones = [SimulatedDrone(config, index) for index in range(_DRONES)]
        for drone in drones:
            await stack.enter_async_context(drone)
        console = await stack.enter_async_context(served_console(config, folder, _SETTINGS))
        client = await stack.enter_async_context(Viewer(console.address, console.headers))
        await until_activity(console.client, "ground", _DRONES)
        sender = _Sender(drones, streams)
        warm_up = asyncio.create_task(sender.send(_START_S))
        for drone in drones:
            await command(console.client, drone.drone_id, "takeoff")
        await until_activity(console.client, "flying", _DRONES)
        await asyncio.sleep(_WARM_UP_S)
        warm_up.cancel()
        await asyncio.gather(warm_up, return_exceptions=True)
        before = await _settled(console)
        tiles = client.tiles
        sent = await sender.send(seconds)
        rate = await _readings(console)
        after = await _settled(console)
        shown = client.tiles - tiles
        await console.client.post("/api/v1/fleet/land")
    elapsed_s = sent.seconds
    figures = {
        "streams": _DRONES,
        "fps_in": round(sent.pictures / elapsed_s / _DRONES, 2),
        "seconds": round(elapsed_s, 2),
        "frames_sent": sent.pictures,
        "frames_decoded": after.decoded - before.decoded,
        "frames_annotated": after.annotated - before.annotated,
        "frames_shown": shown,
        "cpu_cores": round((rate.cpu_s - before.cpu_s) / elapsed_s, 3),
        "cpu_ms_per_frame": round(1e3 * (rate.cpu_s - before.cpu_s) / max(sent.pictures, 1), 2),
        "latency_ms_p50": round(1e3 * after.latency_s["0.5"], 1),
        "latency_ms_p95": round(1e3 * after.latency_s["0.95"], 1),
        "latency_ms_p99": round(1e3 * after.latency_s["0.99"], 1),
        "sent_late_ms_max": round(1e3 * sent.latest_s, 1),
        "tile_kbyte": round(client.tile_bytes / max(client.tiles, 1) / 1e3, 1),
    }
    return figures, client.newest


@dataclass(frozen=True, slots=True)
class _Sent:
    """What was sent.

    Attributes:
        pictures: Of all drones.
        seconds: From the first picture to the end of the last one's turn.
        latest_s: How late the latest picture was sent.
    """

    pictures: int
    seconds: float
    latest_s: float


class _Sender:
    """Sends each drone's stream in real time, the drones evenly apart."""

    def __init__(self, drones: Sequence[SimulatedDrone], streams: Sequence[Stream]) -> None:
        self._drones = drones
        self._streams = streams
        self._at = [0] * len(drones)

    async def send(self, seconds: float) -> _Sent:
        """Send for so long; every stream goes on at its next key picture.

        Pictures are not sent twice in a row: the console would take them for echoes.
        """
        self._at = [
            next_key(stream, at) for stream, at in zip(self._streams, self._at, strict=True)
        ]
        count = round(seconds * _FPS) * len(self._drones)
        begun_s = time.monotonic()
        latest_s = 0.0
        for number in range(count):
            due_s = begun_s + number / (_FPS * len(self._drones))
            await asyncio.sleep(max(0.0, due_s - time.monotonic()))
            latest_s = max(latest_s, time.monotonic() - due_s)
            index = number % len(self._drones)
            stream = self._streams[index]
            self._drones[index].send_video(stream[self._at[index]])
            self._at[index] = (self._at[index] + 1) % len(stream)
        await asyncio.sleep(max(0.0, begun_s + seconds - time.monotonic()))
        return _Sent(count, time.monotonic() - begun_s, latest_s)


@dataclass(frozen=True, slots=True)
class _Readings:
    """What the console tells of itself.

    Attributes:
        cpu_s: Processor time of its process.
        decoded: Pictures decoded, all drones.
        annotated: Pictures annotated, all drones.
        latency_s: Seconds by quantile.
    """

    cpu_s: float
    decoded: int
    annotated: int
    latency_s: dict[str, float]

    @property
    def counts(self) -> tuple[int, int]:
        """Pictures decoded and annotated."""
        return self.decoded, self.annotated


async def _readings(console: ServedConsole) -> _Readings:
    answer = await console.client.get("/metrics")
    answer.raise_for_status()
    return readings_from_metrics(answer.text)


async def _settled(console: ServedConsole) -> _Readings:
    """Return the readings once the console has finished what it was sent."""
    before, after = None, await _readings(console)
    give_up_s = time.monotonic() + _LATEST_S
    while (before is None or after.counts != before.counts) and time.monotonic() < give_up_s:
        await asyncio.sleep(_PAUSE_S)
        before, after = after, await _readings(console)
    return after


def readings_from_metrics(text: str) -> _Readings:
    """Return what a page of ``/metrics`` says about the video."""
    totals: dict[str, float] = {}
    latency_s: dict[str, float] = {}
    for line in text.splitlines():
        if line.startswith("#"):
            continue
        series, value = line.rsplit(" ", 1)
        name, _, labels = series.partition("{")
        totals[name] = totals.get(name, 0.0) + float(value)
        if name == "dronerf_video_latency_seconds":
            latency_s[labels.removeprefix('quantile="').removesuffix('"}')] = float(value)
    return _Readings(
        cpu_s=totals["process_cpu_seconds_total"],
        decoded=round(totals.get("dronerf_video_pictures_decoded_total", 0.0)),
        annotated=round(totals.get("dronerf_video_pictures_annotated_total", 0.0)),
        latency_s=latency_s,
    )
