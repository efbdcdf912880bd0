"""The catalogue's database: its table, how it is opened and brought up to date."""

from __future__ import annotations

import logging
import sqlite3
import time
from pathlib import Path

import sqlalchemy as sa
from alembic import command
from alembic.config import Config
from sqlalchemy import event
from sqlalchemy.engine import URL, make_url
from sqlalchemy.exc import ArgumentError, DatabaseError, OperationalError

logger = logging.getLogger(__name__)

CATALOGUE_FILE = "catalogue.sqlite"
_MIGRATIONS = Path(__file__).parent / "migrations"
_BUSY_S = 10.0
_AGAIN_S = 0.02
# Any number, the same for all: consoles that open one database at once migrate it one by one.
_MIGRATION_LOCK = 0x64726F6E

runs_table = sa.Table(
    "runs",
    sa.MetaData(),
    sa.Column("id", sa.String(120), primary_key=True),
    sa.Column("kind", sa.String(16), nullable=False),
    sa.Column("subject", sa.String(200), nullable=False),
    sa.Column("mode", sa.String(32), nullable=False),
    sa.Column("state", sa.String(16), nullable=False),
    sa.Column("begun_unix_s", sa.Float, nullable=False),
    sa.Column("ended_unix_s", sa.Float),
    sa.Column("pictures", sa.Integer, nullable=False),
    sa.Column("metrics", sa.JSON, nullable=False),
    sa.Column("thumbnail", sa.String(200)),
    sa.Column("size_bytes", sa.BigInteger, nullable=False),
    sa.Column("starred", sa.Boolean, nullable=False),
    sa.Index("runs_newest", "begun_unix_s", "id"),
)


def catalogue_url(runs: Path, text: str | None) -> URL:
    """Return the database's URL: ``text``, or SQLite in ``runs`` when that is None.

    Raises:
        ValueError: If ``text`` names neither SQLite nor PostgreSQL.
    """
    if text is None:
        return URL.create("sqlite", database=str(runs / CATALOGUE_FILE))
    try:
        url = make_url(text)
    except ArgumentError as error:
        # The text may hold a password: it is not repeated.
        raise ValueError("the database URL cannot be read") from error
    kind = url.get_backend_name()
    if kind == "postgresql":
        return url.set(drivername="postgresql+psycopg")
    if kind == "sqlite" and url.database not in (None, "", ":memory:"):
        return url
    raise ValueError(f"the database must be postgresql://... or sqlite:///FILE, not {kind}")


def open_engine(url: URL) -> sa.Engine:
    """Open the database at ``url`` and bring it up to date.

    A SQLite file that is damaged is put aside: what it held is in the run folders.

    Raises:
        sqlalchemy.exc.SQLAlchemyError: If it cannot be opened or migrated.
    """
    engine = _engine(url)
    try:
        _migrate(engine)
    except DatabaseError as error:
        engine.dispose()
        # Operational errors (locked, disk full, no server) say nothing about the file.
        if url.get_backend_name() != "sqlite" or isinstance(error, OperationalError):
            raise
        _put_aside(Path(str(url.database)))
        engine = _engine(url)
        _migrate(engine)
    except BaseException:
        engine.dispose()
        raise
    return engine


def _engine(url: URL) -> sa.Engine:
    if url.get_backend_name() != "sqlite":
        return sa.create_engine(url, pool_pre_ping=True, pool_size=2)
    engine = sa.create_engine(url, connect_args={"timeout": _BUSY_S})

    def prepare(connection: sqlite3.Connection, _: object) -> None:
        # Readers go on while one writes; a row lost with the power is found again by a rescan.
        _write_ahead(connection)
        connection.execute("PRAGMA synchronous=NORMAL").close()

    event.listen(engine, "connect", prepare)
    return engine


def _write_ahead(connection: sqlite3.Connection) -> None:
    """Turn on SQLite's write-ahead log, which stays on in the file.

    SQLite does not wait for its turn here: of two that open a new file at once, one is told that it
    is locked.
    """
    until_s = time.monotonic() + _BUSY_S
    while True:
        try:
            connection.execute("PRAGMA journal_mode=WAL").close()
            return
        except sqlite3.OperationalError:
            if time.monotonic() > until_s:
                raise
        time.sleep(_AGAIN_S)


def _migrate(engine: sa.Engine) -> None:
    config = Config()
    config.set_main_option("script_location", str(_MIGRATIONS).replace("%", "%%"))
    config.set_main_option("path_separator", "os")
    with engine.begin() as connection:
        if engine.dialect.name == "postgresql":
            connection.execute(sa.select(sa.func.pg_advisory_xact_lock(_MIGRATION_LOCK)))
        else:
            connection.exec_driver_sql("BEGIN IMMEDIATE")
        config.attributes["connection"] = connection
        command.upgrade(config, "head")


def _put_aside(file: Path) -> None:
    logger.error("%s is damaged and put aside; run `dronerf library rescan`", file)
    file.replace(file.with_name(f"{file.name}.damaged"))
    for ending in ("-wal", "-shm"):
        file.with_name(f"{file.name}{ending}").unlink(missing_ok=True)
