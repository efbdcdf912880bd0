"""The catalogue of runs: an index over the run folders that can always be built again from them.

SQLite in the runs folder by default, PostgreSQL by URL. Folders are written first and the row
follows; a row without a folder, or a folder without a row, is put right by ``rescan``.
"""

from __future__ import annotations

import base64
import json
import logging
import math
import re
import threading
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import sqlalchemy as sa
from sqlalchemy.dialects import postgresql, sqlite

from server.store.config import RetentionConfig
from server.store.database import catalogue_url, open_engine, runs_table
from server.store.row import UNFINISHED, RunRow, read_row
from server.store.runs import clear_deleted, delete_run

logger = logging.getLogger(__name__)

MOST_ROWS = 200
_ID = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,119}")
_DAY_S = 86_400.0


@dataclass(frozen=True, slots=True)
class Page:
    """Some rows, newest first.

    Attributes:
        rows: The runs.
        next_cursor: Where the next page begins, None on the last one.
    """

    rows: list[RunRow]
    next_cursor: str | None


@dataclass(frozen=True, slots=True)
class Rescan:
    """What a rescan found.

    Attributes:
        runs: Runs listed now.
        added: Folders that had no row.
        changed: Rows that said something else than their folder.
        removed: Rows whose folder is gone.
    """

    runs: int
    added: int
    changed: int
    removed: int


class Catalogue:
    """The list of runs; safe to call from several threads.

    Use as a context manager or call ``close``.

    Args:
        runs: The folder of the run folders; made if needed.
        url: Database URL, None for SQLite in ``runs``.

    Raises:
        ValueError: If the URL is none.
        sqlalchemy.exc.SQLAlchemyError: If the database cannot be opened.
    """

    def __init__(self, runs: Path, url: str | None = None) -> None:
        runs.mkdir(parents=True, exist_ok=True)
        self._runs = runs.resolve()
        self._engine = open_engine(catalogue_url(self._runs, url))
        # Reading a folder and writing its row is one step: an older reading never comes last.
        self._writing = threading.RLock()

    def __enter__(self) -> Catalogue:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the database's connections."""
        self._engine.dispose()

    def get(self, run_id: str) -> RunRow | None:
        """Return the row of ``run_id``, None when there is none."""
        with self._engine.connect() as connection:
            found = connection.execute(
                sa.select(runs_table).where(runs_table.c.id == run_id)
            ).one_or_none()
        return None if found is None else _row(found)

    def page(
        self,
        limit: int = 50,
        cursor: str | None = None,
        *,
        kind: str | None = None,
        state: str | None = None,
        starred: bool | None = None,
    ) -> Page:
        """Return up to ``limit`` (1 to 200) rows, newest first, that fit the given filters.

        Pages by place in the order, not by number: runs that come or go meanwhile are neither
        shown twice nor make others be left out.

        Raises:
            ValueError: If the limit is out of range or the cursor is none of ours.
        """
        if not 1 <= limit <= MOST_ROWS:
            raise ValueError(f"limit must be 1 to {MOST_ROWS}, not {limit}")
        table = runs_table.c
        query = sa.select(runs_table).order_by(table.begun_unix_s.desc(), table.id.desc())
        filters = {"kind": kind, "state": state, "starred": starred}
        for name, wanted in filters.items():
            if wanted is not None:
                query = query.where(table[name] == wanted)
        if cursor is not None:
            begun, last_id = _read_cursor(cursor)
            earlier = sa.and_(table.begun_unix_s == begun, table.id < last_id)
            query = query.where(sa.or_(table.begun_unix_s < begun, earlier))
        with self._engine.connect() as connection:
            rows = [_row(found) for found in connection.execute(query.limit(limit + 1))]
        more = len(rows) > limit
        return Page(rows[:limit], _cursor(rows[limit - 1]) if more else None)

    def refresh(self, run_id: str) -> RunRow | None:
        """Read a run's folder again; returns its row, None when the folder is gone."""
        folder = self._folder(run_id)
        with self._writing, self._engine.begin() as connection:
            row = None if folder.is_symlink() or not folder.is_dir() else read_row(folder)
            if row is None:
                connection.execute(sa.delete(runs_table).where(runs_table.c.id == run_id))
            else:
                self._put(connection, [row])
        return row

    def rescan(self) -> Rescan:
        """Build the catalogue again from the run folders; also ends broken-off deletions."""
        with self._writing:
            clear_deleted(self._runs)
            found = {row.id: row for folder in self._folders() if (row := read_row(folder))}
            with self._engine.begin() as connection:
                known = {row.id: row for row in map(_row, connection.execute(runs_table.select()))}
                added = [row for run_id, row in found.items() if run_id not in known]
                changed = [
                    row for run_id, row in found.items() if run_id in known and known[run_id] != row
                ]
                self._put(connection, added + changed)
                gone = known.keys() - found.keys()
                for run_id in gone:
                    connection.execute(sa.delete(runs_table).where(runs_table.c.id == run_id))
        return Rescan(len(found), len(added), len(changed), len(gone))

    def delete(self, run_id: str) -> None:
        """Delete a run's folder and row.

        Raises:
            KeyError: If there is no such run.
            OSError: If not all of it could be deleted; the row is gone, ``rescan`` tries again.
            ValueError: If the id is no run's id, or the run is not over.
        """
        folder = self._folder(run_id)
        with self._writing:
            row = self.refresh(run_id)
            if row is None:
                raise KeyError(run_id)
            if row.state in UNFINISHED:
                raise ValueError(f"{run_id} is {row.state}; abort it first")
            try:
                delete_run(folder)
            finally:
                self.refresh(run_id)

    def retain(self, config: RetentionConfig, live: frozenset[str] = frozenset()) -> list[str]:
        """Delete what is too old, then the oldest until the quota holds; returns their ids.

        Starred runs, runs that are not over and those named in ``live``, with the fields
        trained anew on them, are never deleted, though they count against the quota. Nor is a
        capture while such a field is kept, which would be nothing without its pictures: it is as
        old as the youngest of them.
        """
        with self._engine.connect() as connection:
            rows = [_row(found) for found in connection.execute(sa.select(runs_table))]
        trained: dict[str, list[RunRow]] = {}
        for row in rows:
            if row.kind == "training":
                trained.setdefault(row.subject, []).append(row)

        def place(row: RunRow) -> tuple[float, bool, str]:
            # Captures come after the trainings on them.
            begun = [each.begun_unix_s for each in (row, *trained.get(row.id, []))]
            return max(begun), row.kind == "capture", row.id

        rows.sort(key=place)
        total_bytes = sum(row.size_bytes for row in rows)
        now_unix_s = time.time()
        deleted: list[str] = []
        for row in rows:
            if row.starred or row.state in UNFINISHED or row.id in live:
                continue
            if row.kind == "training" and row.subject in live:
                continue
            if any(training.id not in deleted for training in trained.get(row.id, [])):
                continue
            ended_unix_s = row.begun_unix_s if row.ended_unix_s is None else row.ended_unix_s
            age_days = (now_unix_s - ended_unix_s) / _DAY_S
            too_old = config.keep_days is not None and age_days > config.keep_days
            too_much = config.quota_bytes is not None and total_bytes > config.quota_bytes
            if (too_old or too_much) and self._let_go(row.id):
                deleted.append(row.id)
                total_bytes -= row.size_bytes
        return deleted

    def _let_go(self, run_id: str) -> bool:
        """Delete a run that retention picked, unless its folder says by now that it must stay."""
        try:
            row = self.refresh(run_id)
            if row is not None and row.starred:
                return False
            self.delete(run_id)
        except (KeyError, OSError, ValueError) as error:
            logger.warning("run %s is kept: %s", run_id, error)
            return False
        logger.info("run %s deleted to keep within quota and age", run_id)
        return True

    def _folder(self, run_id: str) -> Path:
        """Return a run's folder; raises ValueError for an id that could lead elsewhere."""
        if not _ID.fullmatch(run_id):
            raise ValueError(f"{run_id!r} is no run's id")
        return self._runs / run_id

    def _folders(self) -> list[Path]:
        return [
            folder
            for folder in self._runs.iterdir()
            if folder.is_dir() and not folder.is_symlink() and _ID.fullmatch(folder.name)
        ]

    def _put(self, connection: sa.Connection, rows: list[RunRow]) -> None:
        if not rows:
            return
        dialect = postgresql if connection.dialect.name == "postgresql" else sqlite
        insert = dialect.insert(runs_table)
        taken = {c.name: insert.excluded[c.name] for c in runs_table.c if c.name != "id"}
        connection.execute(
            insert.on_conflict_do_update(index_elements=["id"], set_=taken),
            [asdict(row) for row in rows],
        )


def _row(found: Any) -> RunRow:
    return RunRow(**found._mapping)


def _cursor(row: RunRow) -> str:
    return base64.urlsafe_b64encode(json.dumps([row.begun_unix_s, row.id]).encode()).decode()


def _read_cursor(cursor: str) -> tuple[float, str]:
    try:
        begun, run_id = json.loads(base64.b64decode(cursor, altchars=b"-_", validate=True))
        if not isinstance(run_id, str) or not _ID.fullmatch(run_id):
            raise ValueError("no id")
        if not isinstance(begun, float) or not math.isfinite(begun):
            raise ValueError("no time")
    except (ValueError, TypeError) as error:
        raise ValueError("the cursor is none of this catalogue's") from error
    return begun, run_id
