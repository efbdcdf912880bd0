from __future__ import annotations

from collections.abc import AsyncIterator
from pathlib import Path

import pytest
from served_console import Console, serve


@pytest.fixture
async def console(tmp_path: Path) -> AsyncIterator[Console]:
    async with serve(tmp_path) as console:
        yield console
