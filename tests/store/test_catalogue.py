"""The catalogue, on every database, over real run folders."""

import json
import os
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime, timedelta

import alembic.autogenerate
import alembic.migration
import numpy as np
import pytest

from server.store.catalogue import Catalogue
from server.store.config import RetentionConfig
from server.store.database import CATALOGUE_FILE, catalogue_url, open_engine, runs_table
from server.store.runs import star_run

_NOON = datetime(2026, 5, 1, 12, tzinfo=UTC)


def _make_run(runs, run_id, *, state="succeeded", minutes=0.0, size=1000, name="a bin"):
    folder = runs / run_id
    (folder / "images").mkdir(parents=True)
    (folder / "images" / "0000.jpg").write_bytes(b"x" * size)
    begun = _NOON + timedelta(minutes=minutes)
    content = {
        "id": run_id,
        "request": {"name": name, "mode": "optimized"},
        "started_at": begun.isoformat(),
        "status": {"state": state, "at": (begun + timedelta(minutes=3)).isoformat()},
    }
    (folder / "capture.json").write_text(json.dumps(content))
    (folder / "metrics.json").write_text(json.dumps({"psnr_db": 20.5, "seconds": {"fly": 1}}))
    return folder


def _ids(page):
    return [row.id for row in page.rows]


@pytest.fixture
def catalogue(tmp_path, database_url):
    with Catalogue(tmp_path, database_url) as opened:
        yield opened


def starred(catalogue, folder):
    star_run(folder, True)
    catalogue.refresh(folder.name)


def test_a_row_says_what_the_folder_says(tmp_path, catalogue):
    folder = _make_run(tmp_path, "run-1")
    row = catalogue.refresh("run-1")
    assert row == catalogue.get("run-1")
    assert (row.kind, row.subject, row.mode, row.state) == (
        "capture",
        "a bin",
        "optimized",
        "succeeded",
    )
    assert row.begun_unix_s == _NOON.timestamp()
    assert row.ended_unix_s == _NOON.timestamp() + 180.0
    assert row.pictures == 1
    assert row.metrics == {"psnr_db": 20.5}
    assert row.thumbnail == "images/0000.jpg"
    assert row.size_bytes == sum(p.stat().st_size for p in folder.rglob("*") if p.is_file())


def test_a_training_is_listed_by_its_metrics(tmp_path, catalogue):
    (tmp_path / "train-1").mkdir()
    metrics = {"dataset": "somewhere/fox", "images": 50, "wall_s": 9.0, "ssim": 0.5}
    (tmp_path / "train-1" / "metrics.json").write_text(json.dumps(metrics))
    row = catalogue.refresh("train-1")
    assert (row.kind, row.subject, row.pictures, row.state) == ("training", "fox", 50, "succeeded")
    assert row.ended_unix_s - row.begun_unix_s == pytest.approx(9.0)


def test_a_lost_catalogue_is_built_again_from_the_folders(tmp_path, catalogue):
    for number in range(5):
        _make_run(tmp_path, f"run-{number}", minutes=number)
    (tmp_path / "notes").mkdir()
    (tmp_path / "broken").mkdir()
    (tmp_path / "broken" / "capture.json").write_text('{"id": "bro')
    assert catalogue.rescan().added == 5
    starred(catalogue, tmp_path / "run-3")
    before = catalogue.page()
    with catalogue._engine.begin() as connection:
        connection.execute(runs_table.delete())
    assert catalogue.page().rows == []
    assert catalogue.rescan().added == 5
    assert catalogue.page() == before
    assert catalogue.rescan().changed == 0


def test_a_rescan_follows_what_changed_behind_its_back(tmp_path, catalogue):
    _make_run(tmp_path, "run-1")
    gone = _make_run(tmp_path, "run-2")
    catalogue.rescan()
    gone.rename(tmp_path.parent / f"{tmp_path.name}-moved")
    (tmp_path / "run-1" / "metrics.json").write_text('{"psnr_db": 30.0}')
    found = catalogue.rescan()
    assert (found.runs, found.added, found.changed, found.removed) == (1, 0, 1, 1)
    assert catalogue.get("run-1").metrics == {"psnr_db": 30.0}


def test_pages_hold_every_run_once_also_when_runs_come_and_go(tmp_path, catalogue):
    for number in range(23):  # Several begin at the same time.
        _make_run(tmp_path, f"run-{number:02}", minutes=number // 4)
    catalogue.rescan()
    page = catalogue.page(5)
    seen = _ids(page)
    while page.next_cursor is not None:
        late = f"late-{len(seen)}"
        _make_run(tmp_path, late, minutes=1000)
        catalogue.refresh(late)
        catalogue.delete(seen[-1])
        page = catalogue.page(5, page.next_cursor)
        seen += _ids(page)
    assert seen == sorted((f"run-{n:02}" for n in range(23)), reverse=True)


@pytest.mark.parametrize(
    "cursor", ["", "x", "!!", "W10=", "WzEsMl0=", "WzFlOTk5LCJhIl0=", "bnVsbA==", "é"]
)
def test_a_strange_cursor_is_refused(catalogue, cursor):
    with pytest.raises(ValueError, match="cursor"):
        catalogue.page(5, cursor)


def test_filters_pick_rows(tmp_path, catalogue):
    _make_run(tmp_path, "good")
    _make_run(tmp_path, "bad", state="failed")
    catalogue.rescan()
    starred(catalogue, tmp_path / "good")
    assert _ids(catalogue.page(state="failed")) == ["bad"]
    assert _ids(catalogue.page(starred=True)) == ["good"]
    assert _ids(catalogue.page(kind="training")) == []


def test_a_run_nobody_works_on_any_more_is_interrupted(tmp_path, catalogue):
    folder = _make_run(tmp_path, "run-1", state="running")
    assert catalogue.refresh("run-1").state == "running"
    for path in folder.rglob("*"):
        os.utime(path, (time.time() - 3600.0, time.time() - 3600.0))
    assert catalogue.refresh("run-1").state == "interrupted"


def test_delete_takes_folder_and_row_and_never_a_running_one(tmp_path, catalogue):
    _make_run(tmp_path, "old")
    _make_run(tmp_path, "now", state="running")
    catalogue.rescan()
    catalogue.delete("old")
    assert not (tmp_path / "old").exists()
    assert catalogue.get("old") is None
    with pytest.raises(ValueError, match="running"):
        catalogue.delete("now")
    assert (tmp_path / "now" / "capture.json").exists()
    with pytest.raises(KeyError):
        catalogue.delete("old")


@pytest.mark.parametrize(
    "name", ["..", ".", "", "../outside", "/outside", "a/../../outside", "a\0"]
)
def test_delete_never_leaves_the_runs_folder(tmp_path, database_url, name):
    outside = _make_run(tmp_path, "outside")
    with (
        Catalogue(tmp_path / "runs", database_url) as catalogue,
        pytest.raises(ValueError, match="no run's id"),
    ):
        catalogue.delete(name)
    assert (outside / "capture.json").exists()


def test_a_link_out_of_the_runs_folder_is_no_run(tmp_path, database_url):
    outside = _make_run(tmp_path, "outside")
    with Catalogue(tmp_path / "runs", database_url) as catalogue:
        (tmp_path / "runs" / "link").symlink_to(outside)
        assert catalogue.rescan().runs == 0
        with pytest.raises(KeyError):
            catalogue.delete("link")
    assert (outside / "capture.json").exists()


def test_a_deletion_broken_off_is_ended_by_the_next_rescan(tmp_path, catalogue):
    _make_run(tmp_path, "run-1").rename(tmp_path / ".deleting-run-1")
    assert catalogue.rescan().runs == 0
    assert not (tmp_path / ".deleting-run-1").exists()


def test_the_quota_takes_the_oldest_that_nobody_needs(tmp_path, catalogue):
    for number in range(6):
        state = "running" if number == 1 else "succeeded"
        _make_run(tmp_path, f"run-{number}", minutes=number, size=100_000, state=state)
    catalogue.rescan()
    starred(catalogue, tmp_path / "run-0")
    quota = RetentionConfig(quota_bytes=410_000)
    assert catalogue.retain(quota, live=frozenset({"run-2"})) == ["run-3", "run-4"]
    assert catalogue.retain(quota) == []
    assert _ids(catalogue.page()) == ["run-5", "run-2", "run-1", "run-0"]
    assert catalogue.retain(RetentionConfig(quota_bytes=0)) == ["run-2", "run-5"]


def test_a_star_set_in_the_folder_alone_keeps_the_run(tmp_path, catalogue):
    folder = _make_run(tmp_path, "run-1")
    catalogue.rescan()
    (folder / "starred").touch()
    assert catalogue.retain(RetentionConfig(quota_bytes=0)) == []
    assert folder.exists()


def test_age_takes_what_ended_too_long_ago(tmp_path, catalogue):
    days = (datetime.now(UTC) - _NOON) / timedelta(days=1)
    _make_run(tmp_path, "old")
    _make_run(tmp_path, "young", minutes=(days - 1.0) * 1440.0)
    catalogue.rescan()
    assert catalogue.retain(RetentionConfig()) == []
    assert catalogue.retain(RetentionConfig(keep_days=2.0)) == ["old"]


def test_many_threads_may_write_and_read(tmp_path, catalogue):
    for number in range(12):
        _make_run(tmp_path, f"run-{number:02}")
    with ThreadPoolExecutor(4) as pool:
        rows = list(pool.map(catalogue.refresh, [f"run-{n % 12:02}" for n in range(48)]))
    assert all(row is not None for row in rows)
    assert len(catalogue.page().rows) == 12


def test_two_catalogues_open_one_database_and_see_each_other(tmp_path, database_url):
    _make_run(tmp_path, "run-1")
    with (
        Catalogue(tmp_path, database_url) as one,
        Catalogue(tmp_path, database_url) as other,
    ):
        one.rescan()
        assert _ids(other.page()) == ["run-1"]
        other.delete("run-1")
        assert one.get("run-1") is None


def test_many_may_open_a_new_database_at_once(tmp_path):
    with ThreadPoolExecutor(4) as pool:
        for turn in range(40):
            runs = tmp_path / str(turn)
            together = threading.Barrier(4)

            def opened(runs=runs, together=together):
                together.wait()
                with Catalogue(runs) as catalogue:
                    return catalogue.rescan().runs

            assert [one.result() for one in [pool.submit(opened) for _ in range(4)]] == [0] * 4


def test_odd_words_of_a_capture_are_listed_on_every_database(tmp_path, catalogue):
    _make_run(tmp_path, "run-1", name="nul \0, half \ud800, ü " + "x" * 400)
    (tmp_path / "run-1" / "metrics.json").write_text('{"psnr_db": Infinity, "ssim": NaN}')
    row = catalogue.refresh("run-1")
    assert row == catalogue.get("run-1")
    assert row.subject.startswith("nul , half , ü")
    assert row.metrics == {}


def test_migrations_make_the_table_that_the_code_means(tmp_path, database_url):
    engine = open_engine(catalogue_url(tmp_path, database_url))
    with engine.connect() as connection:
        made = alembic.migration.MigrationContext.configure(connection, opts={"compare_type": True})
        assert alembic.autogenerate.compare_metadata(made, runs_table.metadata) == []
    engine.dispose()


def test_a_damaged_sqlite_file_is_put_aside_and_built_again(tmp_path):
    _make_run(tmp_path, "run-1")
    (tmp_path / CATALOGUE_FILE).write_bytes(b"no database at all" * 500)
    with Catalogue(tmp_path) as catalogue:
        assert catalogue.rescan().added == 1
    assert (tmp_path / f"{CATALOGUE_FILE}.damaged").exists()


def test_sqlite_writes_ahead(tmp_path):
    with Catalogue(tmp_path) as catalogue, catalogue._engine.connect() as connection:
        assert connection.exec_driver_sql("PRAGMA journal_mode").scalar() == "wal"


@pytest.mark.parametrize("url", ["mysql://h/d", "sqlite://", "sqlite:///:memory:", "nonsense"])
def test_other_databases_are_refused(tmp_path, url):
    with pytest.raises(ValueError, match="database"):
        Catalogue(tmp_path, url)


@pytest.mark.slow
def test_a_thousand_runs_are_listed_at_once(tmp_path, catalogue):
    for number in range(1000):
        _make_run(tmp_path, f"run-{number:04}", minutes=number, size=10)
    assert catalogue.rescan().added == 1000
    spent_s: list[float] = []
    for _ in range(5):
        page = catalogue.page(50)
        while page.next_cursor is not None:
            begun_s = time.thread_time()  # Other work on the machine does not count.
            page = catalogue.page(50, page.next_cursor)
            spent_s.append(time.thread_time() - begun_s)
    assert len(spent_s) == 95
    assert np.percentile(spent_s, 95) <= 0.1
