"""A draft takes its place whole or not at all, and nobody is shown it."""

from __future__ import annotations

from pathlib import Path

import pytest

from server.api.files import files_below, inside
from server.drafts import draft_name, draft_of, drafted, is_draft, whole_file


def test_a_file_that_is_being_written_is_not_listed(tmp_path: Path) -> None:
    with whole_file(tmp_path / "checkpoint.npz") as stream:
        stream.write(b"half")
        stream.flush()
        (draft,) = tmp_path.iterdir()
        assert is_draft(draft.name)
        assert files_below(tmp_path, 10) == []
        assert inside(tmp_path, draft.name) is None
    assert [file.path for file in files_below(tmp_path, 10)] == ["checkpoint.npz"]


def test_nor_is_what_a_draft_of_a_folder_holds(tmp_path: Path) -> None:
    draft = draft_of(tmp_path / "replay")
    draft.mkdir()
    (draft / "film-0.mp4").write_bytes(b"half")
    assert files_below(tmp_path, 10) == []
    assert inside(tmp_path, f"{draft.name}/film-0.mp4") is None


def write_half(target: Path, error: BaseException) -> None:
    with drafted(target) as draft:
        draft.write_bytes(b"half")
        raise error


def stream_half(target: Path, error: BaseException) -> None:
    with whole_file(target) as stream:
        stream.write(b"half")
        raise error


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), KeyboardInterrupt()])
def test_what_fails_leaves_the_old_file_and_no_draft(tmp_path: Path, error: BaseException) -> None:
    target = tmp_path / "mesh.ply"
    target.write_bytes(b"old")
    with pytest.raises(type(error)):
        write_half(target, error)
    with pytest.raises(type(error)):
        stream_half(target, error)
    assert target.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [target]


def test_a_draft_that_was_never_written_replaces_nothing(tmp_path: Path) -> None:
    target = tmp_path / "mesh.ply"
    target.write_bytes(b"old")
    with pytest.raises(FileNotFoundError), drafted(target):
        pass
    assert target.read_bytes() == b"old"


def test_writers_of_one_file_may_have_drafts_of_their_own() -> None:
    names = {draft_name("a.json"), draft_name("a.json", "1"), draft_name("a.json", "2")}
    assert len(names) == 3
    assert all(name.startswith(".a.json.") and is_draft(name) for name in names)
