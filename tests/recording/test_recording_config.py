import dataclasses

import pytest

from server.recording.config import RecordingConfig


@pytest.mark.parametrize(
    "field", [f.name for f in dataclasses.fields(RecordingConfig) if f.name != "enabled"]
)
def test_a_bound_that_is_not_positive_is_refused_by_name(field):
    with pytest.raises(ValueError, match=f"recording.{field}"):
        dataclasses.replace(RecordingConfig(), **{field: 0})


def test_a_file_must_hold_more_than_one_chunk():
    with pytest.raises(ValueError, match="max_bytes"):
        RecordingConfig(max_bytes=1000, chunk_bytes=1000)
