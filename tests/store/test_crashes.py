"""What is found after the power went at any moment."""

from datetime import UTC, datetime
from pathlib import Path

import cv2
import numpy as np
import pytest
from forgetful_disk import ForgetfulDisk, PowerCutError

from server.nerf.flight import FlightPicture, append_picture, read_pictures
from server.store import atomic
from server.store.atomic import write_atomic
from server.store.runs import RunFolder

_PATH = Path("/run/capture.json")
# Longer, shorter, empty, as a state that changes over a capture.
_STATES = (b'{"state": 1}', b'{"state": "much longer"}', b"{}", b"", b'{"state": 5, "more": 1}')


def _write_states(disk, write) -> int:
    """Write all states until the power goes; returns how many writes came back."""
    done = 0
    try:
        for state in _STATES:
            write(disk, state)
            done += 1
    except PowerCutError:
        pass
    return done


def _atomic(disk, data):
    write_atomic(_PATH, data)


def _outcomes(monkeypatch, write, most_bytes):
    """Yield (writes that came back, what the file then holds) for every cut and every outcome."""
    whole = ForgetfulDisk(most_bytes=most_bytes)
    monkeypatch.setattr(atomic, "os", whole)
    assert _write_states(whole, write) == len(_STATES)
    for cut_after in range(whole.operations + 1):
        disk = ForgetfulDisk(cut_after, most_bytes)
        monkeypatch.setattr(atomic, "os", disk)
        done = _write_states(disk, write)
        for found in disk.after_power_cut():
            yield done, found.get(str(_PATH))


def _is_right(done, content) -> bool:
    """Whether a file is the last one that was written or, whole, the one being written."""
    last = _STATES[done - 1] if done else None
    return content == last or (done < len(_STATES) and content == _STATES[done])


@pytest.mark.parametrize("most_bytes", [1, 7, 1 << 20])
def test_at_every_power_cut_the_old_file_or_the_new_one_is_there(monkeypatch, most_bytes):
    outcomes = list(_outcomes(monkeypatch, _atomic, most_bytes))
    assert len(outcomes) >= 170
    assert [outcome for outcome in outcomes if not _is_right(*outcome)] == []


def _in_place(disk, data):
    file = disk.open(str(_PATH), disk.O_WRONLY | disk.O_CREAT | disk.O_TRUNC)
    left = memoryview(data)
    while left:
        left = left[disk.write(file, left) :]
    disk.fsync(file)
    disk.close(file)
    folder = disk.open("/run", disk.O_RDONLY)
    disk.fsync(folder)
    disk.close(folder)


def _unsynced(disk, data):
    file = disk.open("/run/part", disk.O_WRONLY | disk.O_CREAT | disk.O_TRUNC)
    disk.write(file, memoryview(data))
    disk.close(file)
    disk.replace("/run/part", str(_PATH))
    folder = disk.open("/run", disk.O_RDONLY)
    disk.fsync(folder)
    disk.close(folder)


def _folder_unsynced(disk, data):
    file = disk.open("/run/part", disk.O_WRONLY | disk.O_CREAT | disk.O_TRUNC)
    disk.write(file, memoryview(data))
    disk.fsync(file)
    disk.close(file)
    disk.replace("/run/part", str(_PATH))


@pytest.mark.parametrize("write", [_in_place, _unsynced, _folder_unsynced])
def test_the_disk_finds_out_careless_writers(monkeypatch, write):
    outcomes = _outcomes(monkeypatch, write, 1 << 20)
    assert any(not _is_right(*outcome) for outcome in outcomes)


@pytest.mark.parametrize("room", range(0, 24, 3))
def test_a_full_disk_keeps_the_old_file_and_nothing_else(monkeypatch, room):
    disk = ForgetfulDisk(capacity=len(_STATES[0]) + room)
    monkeypatch.setattr(atomic, "os", disk)
    write_atomic(_PATH, _STATES[0])
    with pytest.raises(OSError, match="No space"):
        write_atomic(_PATH, _STATES[1])
    assert disk.read(str(_PATH)) == _STATES[0]
    assert len(disk._names) == 1
    assert not disk.leaks()


@pytest.mark.slow
def test_a_list_of_pictures_torn_at_any_byte_keeps_all_whole_lines(tmp_path):
    for index in range(2):
        picture = FlightPicture(
            f"images/{index:04}.jpg", None, True, "drone-1", 1.0 + index, 0, np.eye(4), 0.1, 0.05
        )
        append_picture(tmp_path, picture)
    path = tmp_path / "pictures.jsonl"
    whole = path.read_bytes()
    for length in range(len(whole) + 1):
        path.write_bytes(whole[:length])
        kept = [picture.file for picture in read_pictures(tmp_path)]
        assert kept == [f"images/{n:04}.jpg" for n in range(whole[:length].count(b"\n"))]


def test_a_listed_picture_is_whole_wherever_adding_it_broke_off(tmp_path, monkeypatch):
    """The power goes at each of the store's writes in turn while pictures are added."""
    jpeg = cv2.imencode(".jpg", np.full((720, 960, 3), 90, np.uint8))[1].tobytes()
    for broken_at in range(12):
        run = RunFolder.create(tmp_path, f"{datetime.now(UTC):%f} {broken_at}")
        left = broken_at

        def step(act):
            def wrapped(*arguments):
                nonlocal left
                if left == 0:
                    raise PowerCutError
                left -= 1
                return act(*arguments)

            return wrapped

        with monkeypatch.context() as patch:
            patch.setattr("server.store.runs.write_atomic", step(write_atomic))
            patch.setattr("server.store.runs.append_picture", step(append_picture))
            added = 0
            try:
                for index in range(4):
                    picture = FlightPicture(
                        f"keyframes/{index:04}.jpg",
                        None,
                        False,
                        "drone-1",
                        1.0 + index,
                        0,
                        np.eye(4),
                        0.1,
                        0.05,
                    )
                    run.add_keyframe(picture, jpeg)
                    added += 1
                    run.write_state({"images": added})
            except PowerCutError:
                pass
        listed = read_pictures(run.path)
        assert len(listed) >= added
        assert all((run.path / picture.file).read_bytes() == jpeg for picture in listed)
        state = run.state()
        assert (state is None) == (broken_at < 3)
        assert state is None or state["images"] in (added, added - 1)
