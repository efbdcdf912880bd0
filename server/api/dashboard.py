"""The dashboard's files, as the web build left them."""

from __future__ import annotations

import asyncio
from pathlib import Path

from fastapi import APIRouter
from fastapi.responses import FileResponse, HTMLResponse, Response
from starlette.exceptions import HTTPException

from server.api.files import inside
from server.api.pages import unbuilt_page


def make_dashboard_router(dist: Path) -> APIRouter:
    """Return ``/``, ``/assets/...`` and the files beside ``index.html`` in ``dist``."""
    router = APIRouter(include_in_schema=False)

    async def file(relative: str, cache: str) -> Response:
        path = await asyncio.to_thread(inside, dist, relative)
        if path is None:
            raise HTTPException(404)
        return FileResponse(path, headers={"Cache-Control": cache})

    @router.get("/")
    async def index() -> Response:
        if not (dist / "index.html").is_file():
            return HTMLResponse(unbuilt_page(), status_code=503)
        return await file("index.html", "no-cache")

    @router.get("/assets/{path:path}")
    async def asset(path: str) -> Response:
        # The build puts a digest of the content into these names, so they never change.
        return await file(f"assets/{path}", "private, max-age=31536000, immutable")

    # One segment only: a wider net would answer 404 where a path under /api deserves a 405.
    @router.get("/{name}")
    async def beside(name: str) -> Response:
        return await file(name, "no-cache")

    return router
