from __future__ import annotations

import pytest

from server.api.config import ApiConfig, DoorConfig, StreamConfig


@pytest.mark.parametrize(
    ("kind", "name", "value"),
    [
        (DoorConfig, "session_s", 0.0),
        (DoorConfig, "session_s", float("nan")),
        (DoorConfig, "sessions", 0),
        (StreamConfig, "pending", 0),
        (StreamConfig, "queue", 0),
        (StreamConfig, "history", -1),
        (StreamConfig, "captures", -1),
        (ApiConfig, "notes", 0),
        (ApiConfig, "body_bytes", 0),
        (ApiConfig, "command_wait_s", float("inf")),
    ],
)
def test_bounds_are_checked_and_named(kind: type, name: str, value: float) -> None:
    with pytest.raises(ValueError, match=name):
        kind(**{name: value})
