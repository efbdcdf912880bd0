"""What the machine cannot run is skipped here, in one place, by name."""

import shutil

import pytest
from hypothesis import settings

# No test depends on how fast the machine is just now.
settings.register_profile("any machine", deadline=None)
settings.load_profile("any machine")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Skip browser tests without Chromium and GPU tests without CUDA."""
    chromium = shutil.which("chromium")
    for item in items:
        if item.get_closest_marker("browser") and chromium is None:
            item.add_marker(pytest.mark.skip(reason="no chromium on this machine"))
        if item.get_closest_marker("gpu") and shutil.which("nvidia-smi") is None:
            item.add_marker(pytest.mark.skip(reason="no CUDA device on this machine"))
