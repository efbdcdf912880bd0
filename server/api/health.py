"""Health checks, open to all, and Prometheus metrics, behind the door."""

from __future__ import annotations

import os
import time
from collections import Counter
from collections.abc import Callable, Iterable
from pathlib import Path

from fastapi import APIRouter
from fastapi.responses import JSONResponse, PlainTextResponse, Response

from server.api.journal import Journal
from server.api.stream import StreamCounts
from server.api.video_counts import VideoCounts
from server.jobs.book import JobBook
from server.mission.commands import MissionControl

_QUANTILES = (0.5, 0.95, 0.99)
_RUNNING = ("queued", "running", "paused")


def make_health_router(
    mission: MissionControl, jobs: JobBook, journal: Journal, counts: StreamCounts, version: str
) -> APIRouter:
    """Return ``/livez``, ``/readyz`` and ``/metrics``."""
    router = APIRouter(tags=["health"])

    @router.get("/livez", operation_id="livez")
    async def livez() -> dict[str, str]:
        """Tell that the process answers."""
        return {"status": "live"}

    @router.get("/readyz", operation_id="readyz", responses={503: {"description": "Not ready"}})
    async def readyz() -> Response:
        """Tell whether the console follows its mission; drones need not be there for that."""
        if journal.healthy:
            return JSONResponse({"status": "ready"})
        return JSONResponse({"status": "not ready"}, status_code=503)

    @router.get("/metrics", operation_id="metrics", response_class=PlainTextResponse)
    async def metrics() -> PlainTextResponse:
        """Return the gauges in Prometheus' text form."""
        lines = [
            *_lines(mission, counts, version),
            *_job_lines(jobs),
            *_failsafe_lines(journal),
            *_video_lines(journal.video),
        ]
        text = "\n".join(lines) + "\n"
        return PlainTextResponse(text, media_type="text/plain; version=0.0.4")

    return router


def _lines(mission: MissionControl, counts: StreamCounts, version: str) -> Iterable[str]:
    yield from _family("dronerf_build_info", "gauge", "Version.", [({"version": version}, 1.0)])
    yield from _family(
        "process_cpu_seconds_total",
        "counter",
        "Processor time of this process, all its threads.",
        [({}, time.process_time())],
    )
    yield from _family(
        "process_resident_memory_bytes", "gauge", "Memory in use.", _of_process(_resident_bytes)
    )
    yield from _family(
        "process_open_fds", "gauge", "Open file descriptors.", _of_process(_open_descriptors)
    )
    drones = mission.drones()
    gauges = {
        "dronerf_drone_battery_ratio": (
            "Charge, 0 to 1.",
            [(d, d.battery_pct / 100) for d in drones if d.battery_pct is not None],
        ),
        "dronerf_drone_state_age_seconds": (
            "Seconds since the last state report.",
            [(d, d.state_age_s) for d in drones if d.state_age_s is not None],
        ),
        "dronerf_drone_video_frames_per_second": (
            "Pictures per second over the last seconds.",
            [(d, d.video_fps) for d in drones],
        ),
        "dronerf_drone_held": ("1 while HOLD is latched.", [(d, float(d.held)) for d in drones]),
    }
    for name, (text, samples) in gauges.items():
        yield from _family(name, "gauge", text, [({"drone": d.drone_id}, v) for d, v in samples])
    counted = mission.datagram_counts()
    yield from _family(
        "dronerf_drone_datagrams_dropped_total",
        "counter",
        "Datagrams of a drone that said nothing.",
        [
            ({"drone": drone_id, "reason": reason}, float(count))
            for drone_id, datagrams in counted.items()
            for reason, count in datagrams.dropped.items()
        ],
    )
    yield from _family(
        "dronerf_drone_datagrams_unsent_total",
        "counter",
        "Datagrams to a drone that could not be handed to the network.",
        [({"drone": drone_id}, float(each.unsent)) for drone_id, each in counted.items()],
    )
    yield from _family(
        "dronerf_video_overflows_total",
        "counter",
        "Times all video that waited to be decoded was dropped, because decoding was too late.",
        [({"drone": drone_id}, float(each.video_overflows)) for drone_id, each in counted.items()],
    )
    free_mb = mission.disk_free_mb()
    yield from _family(
        "dronerf_disk_free_bytes",
        "gauge",
        "Free room on the disk of the runs.",
        [] if free_mb is None else [({}, 1e6 * free_mb)],
    )
    running = [r.status for r in mission.captures() if r.status.state in _RUNNING]
    yield from _family(
        "dronerf_captures_running", "gauge", "Unfinished captures.", [({}, float(len(running)))]
    )
    if running:
        status = running[0]
        yield from _family(
            "dronerf_capture_progress_ratio",
            "gauge",
            "Progress of the running capture.",
            [({}, status.progress)],
        )
        yield from _family(
            "dronerf_capture_images",
            "gauge",
            "Pictures the running capture has taken.",
            [({}, float(status.images))],
        )
    for name, kind, text, value in (
        ("dronerf_stream_clients", "gauge", "Connected event streams.", counts.clients),
        ("dronerf_stream_messages_total", "counter", "Messages sent.", counts.messages),
        ("dronerf_stream_tiles_total", "counter", "Pictures sent.", counts.tiles),
        ("dronerf_stream_missed_total", "counter", "Events slow clients lost.", counts.missed),
    ):
        yield from _family(name, kind, text, [({}, float(value))])


def _job_lines(jobs: JobBook) -> Iterable[str]:
    found = Counter((record.kind, record.state) for record in jobs.jobs())
    yield from _family(
        "dronerf_jobs",
        "gauge",
        "Background jobs of this program's life, by how they stand.",
        [({"kind": kind, "state": state}, float(n)) for (kind, state), n in sorted(found.items())],
    )


def _failsafe_lines(journal: Journal) -> Iterable[str]:
    yield from _family(
        "dronerf_failsafes_fired_total",
        "counter",
        "How often a row of the failsafe table fired.",
        [
            ({"event": row, "action": action}, float(times))
            for (row, action), times in sorted(journal.failsafes.items())
        ],
    )


def _video_lines(video: VideoCounts) -> Iterable[str]:
    drones = video.drones.items()
    for name, text, samples in (
        ("decoded", "Pictures decoded.", [(d, v.decoded) for d, v in drones]),
        ("annotated", "Pictures searched and annotated.", [(d, v.annotated) for d, v in drones]),
    ):
        yield from _family(
            f"dronerf_video_pictures_{name}_total",
            "counter",
            text,
            [({"drone": drone_id}, float(count)) for drone_id, count in samples],
        )
    name = "dronerf_video_latency_seconds"
    text = "From a picture's last datagram to its annotated JPEG; quantiles of the newest 7200."
    quantiles = video.latency_quantiles(_QUANTILES)
    yield from _family(name, "summary", text, [({"quantile": f"{q:g}"}, s) for q, s in quantiles])
    yield f"{name}_sum {video.latency_sum_s:.12g}"
    yield f"{name}_count {video.latencies}"


def _of_process(read: Callable[[], float]) -> list[tuple[dict[str, str], float]]:
    """Return one sample, or none where the system does not tell."""
    try:
        return [({}, read())]
    except (OSError, ValueError):
        return []


def _resident_bytes() -> float:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return float(pages * os.sysconf("SC_PAGE_SIZE"))


def _open_descriptors() -> float:
    return float(len(os.listdir("/proc/self/fd")))


def _family(
    name: str, kind: str, text: str, samples: Iterable[tuple[dict[str, str], float]]
) -> Iterable[str]:
    yield f"# HELP {name} {text}"
    yield f"# TYPE {name} {kind}"
    for labels, value in samples:
        inner = ",".join(f'{key}="{_escaped(label)}"' for key, label in labels.items())
        yield f"{name}{{{inner}}} {value:.12g}" if inner else f"{name} {value:.12g}"


def _escaped(label: str) -> str:
    return label.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
