"""Put the console's outer wall together."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

from fastapi import FastAPI

from server.api.bodies import BoundedBodies
from server.api.calibration import make_calibration_router
from server.api.captures import make_captures_router
from server.api.command import CommandDesk
from server.api.config import ApiConfig
from server.api.dashboard import make_dashboard_router
from server.api.door import Door, DoorKeeper
from server.api.drones import make_drones_router
from server.api.health import make_health_router
from server.api.idempotency import Idempotency
from server.api.jobs import make_jobs_router
from server.api.journal import Journal
from server.api.methods import HeadAsGet, make_allowed
from server.api.no_go import make_no_go_router
from server.api.objects import make_objects_router
from server.api.openapi_document import describe
from server.api.pages import SecurityHeaders
from server.api.prefix import BehindPrefix
from server.api.problems import install_problems
from server.api.replays import make_replays_router
from server.api.request_ids import RequestIds
from server.api.results import make_results_router
from server.api.safety import make_safety_router
from server.api.scale import make_scale_router
from server.api.scene_bridge import make_scene_router
from server.api.setup import make_setup_router
from server.api.stream import StreamCounts, make_stream_router
from server.api.tokens import make_tokens_router
from server.api.trainings import make_trainings_router
from server.api.webhook import Webhook
from server.jobs.book import JobBook
from server.mission.busy_captures import BusyCaptures
from server.mission.commands import MissionControl
from server.stages import StopControl


def make_web(
    mission: MissionControl,
    stops: StopControl,
    jobs: JobBook,
    busy: BusyCaptures,
    door: Door,
    scene_port: int | None,
    dist: Path,
    version: str,
    config: ApiConfig | None = None,
) -> FastAPI:
    """Return the application; run it on the event loop the mission lives on.

    Args:
        mission: Everything that may be asked of the mission.
        stops: The three stops; requests for them go there and nowhere else.
        jobs: The background jobs.
        busy: The captures that are being changed.
        door: Decides who comes in.
        scene_port: Loopback port of the 3D scene's server, None without one.
        dist: Folder of the built dashboard; it may be missing.
        version: Version of the program.
        config: Bounds.
    """
    config = config or ApiConfig()
    journal, counts = Journal(config.notes), StreamCounts()
    desk = CommandDesk(mission, config.lapse_s)
    webhook = Webhook(config.webhook, mission) if config.webhook.url else None

    @asynccontextmanager
    async def lifespan(_: FastAPI) -> AsyncIterator[None]:
        for event in mission.standing():
            journal.record(event)
        jobs.on_end = None if webhook is None else webhook.job_ended
        tasks = [
            asyncio.create_task(journal.follow(mission.events), name="event log"),
            asyncio.create_task(desk.watch(), name="command"),
        ]
        if webhook is not None:
            tasks.append(asyncio.create_task(webhook.run(), name="webhook"))
        try:
            yield
        finally:
            await jobs.close()
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    # FastAPI's documentation pages load scripts from elsewhere, so they are off.
    web = FastAPI(
        title="DroNeRF operator console",
        version=version,
        lifespan=lifespan,
        openapi_url=None,
        docs_url=None,
        redoc_url=None,
        redirect_slashes=False,
    )

    @web.get("/api/v1/openapi.json", include_in_schema=False)
    async def openapi() -> dict[str, Any]:
        return document

    web.include_router(make_drones_router(mission, stops, desk, journal, config.command_wait_s))
    web.include_router(make_calibration_router(mission, desk))
    web.include_router(make_safety_router(mission))
    web.include_router(make_objects_router(mission, desk))
    web.include_router(make_no_go_router(mission, desk))
    web.include_router(make_setup_router(mission))
    web.include_router(make_captures_router(mission, desk, jobs, busy))
    web.include_router(make_results_router(mission, journal, door.prefix))
    web.include_router(make_replays_router(mission))
    web.include_router(make_trainings_router(mission, jobs, busy, door.prefix))
    web.include_router(make_jobs_router(mission, jobs, busy))
    web.include_router(make_scale_router(mission, jobs, busy))
    web.include_router(make_tokens_router(door.ring))
    web.include_router(make_stream_router(mission, journal, desk, config.stream, counts))
    web.include_router(make_health_router(mission, jobs, journal, counts, version))
    web.include_router(make_scene_router(scene_port))
    web.include_router(make_dashboard_router(dist))
    document = describe(web)
    install_problems(web, make_allowed(document["paths"]))
    # The one added last stands outermost.
    web.add_middleware(HeadAsGet)
    web.add_middleware(Idempotency)
    web.add_middleware(BoundedBodies, limit=config.body_bytes)
    web.add_middleware(DoorKeeper, door=door)
    web.add_middleware(SecurityHeaders)
    web.add_middleware(BehindPrefix, prefix=door.prefix)
    web.add_middleware(RequestIds)
    return web
