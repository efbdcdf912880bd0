"""Print the OpenAPI document: ``python -m server.api.openapi``."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any, cast

from server.api.access import KeyRing
from server.api.door import Door
from server.api.openapi_document import describe
from server.api.web import make_web
from server.jobs.book import JobBook
from server.mission.busy_captures import BusyCaptures
from server.mission.commands import MissionControl
from server.stages import StopControl

# The version of the interface; the program's own version is not part of the contract.
_VERSION = "1"


def openapi_document() -> dict[str, Any]:
    """Return the OpenAPI document of all routes."""
    # Describing the routes calls none of them, so nothing stands behind them here.
    web = make_web(
        mission=cast(MissionControl, None),
        stops=cast(StopControl, None),
        jobs=cast(JobBook, None),
        busy=BusyCaptures(),
        door=Door(KeyRing("unused")),
        scene_port=None,
        dist=Path("web/dist"),
        version=_VERSION,
    )
    return describe(web)


def openapi_text() -> str:
    """Return the OpenAPI document as indented JSON."""
    return json.dumps(openapi_document(), indent=2, sort_keys=True) + "\n"


if __name__ == "__main__":
    sys.stdout.write(openapi_text())
