"""``dronerf library`` over real run folders."""

import argparse
import json

import pytest

from server.app import StartError
from server.library_commands import run_library


def _run(runs, action, *names, as_json=True):
    return run_library(
        argparse.Namespace(action=action, names=list(names), runs=runs, json=as_json)
    )


@pytest.fixture
def runs(tmp_path):
    for name in ("train-1", "train-2"):
        (tmp_path / name).mkdir()
        metrics = {"dataset": "fox", "images": 50, "wall_s": 9.0, "psnr_db": 21.5}
        (tmp_path / name / "metrics.json").write_text(json.dumps(metrics))
    return tmp_path


def test_rescan_counts_what_it_found(runs, capsys):
    assert _run(runs, "rescan") == 0
    first = json.loads(capsys.readouterr().out)
    assert first == {"runs": 2, "added": 2, "changed": 0, "removed": 0}
    (runs / "train-1" / "metrics.json").unlink()
    _run(runs, "rescan")
    again = json.loads(capsys.readouterr().out)
    assert again == {"runs": 1, "added": 0, "changed": 0, "removed": 1}


def test_list_shows_every_run(runs, capsys):
    assert _run(runs, "list") == 0
    rows = json.loads(capsys.readouterr().out)["runs"]
    assert {row["id"] for row in rows} == {"train-1", "train-2"}
    _run(runs, "list", as_json=False)
    assert capsys.readouterr().out.count("50 pictures") == 2


def test_prune_keeps_everything_unless_told_otherwise(runs, capsys, monkeypatch):
    assert _run(runs, "prune") == 0
    assert json.loads(capsys.readouterr().out) == {"deleted": []}
    assert _run(runs, "star", "train-2") == 0
    assert json.loads(capsys.readouterr().out) == {"starred": ["train-2"]}
    monkeypatch.setenv("DRONERF_RETENTION__QUOTA_BYTES", "0")
    _run(runs, "prune")
    assert json.loads(capsys.readouterr().out) == {"deleted": ["train-1"]}
    assert not (runs / "train-1").exists()


def test_a_star_can_be_taken_back(runs, capsys):
    _run(runs, "star", "train-1", "train-2", as_json=False)
    assert capsys.readouterr().out == "starred train-1\nstarred train-2\n"
    _run(runs, "list", as_json=False)
    assert capsys.readouterr().out.count("MB  starred") == 2
    _run(runs, "unstar", "train-1")
    assert json.loads(capsys.readouterr().out) == {"unstarred": ["train-1"]}
    assert [(runs / name / "starred").exists() for name in ("train-1", "train-2")] == [False, True]


def test_a_star_for_a_run_that_is_not_there_stars_nothing(runs):
    for wrong in ("train-9", "../" + runs.name):
        with pytest.raises(StartError, match=wrong):
            _run(runs, "star", "train-1", wrong)
    assert not (runs / "train-1" / "starred").exists()
    with pytest.raises(StartError, match="needs at least one RUN"):
        _run(runs, "star")
    with pytest.raises(StartError, match="takes no RUN"):
        _run(runs, "list", "train-1")


def test_a_bad_database_is_told_in_one_line_without_its_password(runs, monkeypatch):
    monkeypatch.setenv("DRONERF_DATABASE_URL", "mysql://me:hunter2@host/d")
    with pytest.raises(StartError, match="database") as caught:
        _run(runs, "rescan")
    assert "hunter2" not in str(caught.value)
    monkeypatch.setenv("DRONERF_DATABASE_URL", f"sqlite:///{runs}/no/such/folder/file")
    with pytest.raises(StartError, match="catalogue: unable to open database file"):
        _run(runs, "rescan")
