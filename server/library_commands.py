"""``dronerf library``: the catalogue of runs from a shell."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from sqlalchemy.exc import SQLAlchemyError

from server.app import StartError, catalogue_text, check_runs
from server.settings import Settings, load_settings
from server.store.catalogue import Catalogue
from server.store.runs import star_run
from server.terminal import AddCommand

_STARRING = ("star", "unstar")


def add_library_commands(commands: Any, add: AddCommand) -> None:
    """Add ``library`` to a parser's ``commands`` by its own ``add``."""
    part = add(commands, "library", run_library, "what was captured: find it again, tidy up")
    part.add_argument(
        "action",
        choices=("rescan", "list", "star", "unstar", "prune"),
        help="rescan: rebuild the catalogue from the run folders; list: all runs, newest first;"
        " star, unstar: keep the named runs, or no longer; prune: delete what the retention"
        " settings do not keep, never what has a star",
    )
    part.add_argument("names", nargs="*", metavar="RUN", help="star, unstar: names of run folders")
    part.add_argument("--runs", type=Path, help="folder of the run folders (runs)")
    part.add_argument("--json", action="store_true", help="print the result as one JSON object")


def run_library(arguments: argparse.Namespace) -> int:
    """Run one action on the catalogue and print its result."""
    if bool(arguments.names) != (arguments.action in _STARRING):
        wanted = "needs at least one RUN" if arguments.action in _STARRING else "takes no RUN"
        raise StartError(f"library {arguments.action} {wanted}")
    settings = load_settings(runs=arguments.runs)
    check_runs(settings.runs)
    try:
        with Catalogue(settings.runs, catalogue_text(settings)) as catalogue:
            result = _act(arguments.action, arguments.names, catalogue, settings)
    except ValueError as error:
        raise StartError(str(error)) from error
    except SQLAlchemyError as error:
        # The database's own words only: SQLAlchemy's text would go on with the statement.
        words = str(getattr(error, "orig", error)).strip().splitlines()
        raise StartError(f"catalogue: {words[0] if words else type(error).__name__}") from error
    print(json.dumps(result) if arguments.json else _table(result))
    return 0


def _act(
    action: str, names: Sequence[str], catalogue: Catalogue, settings: Settings
) -> dict[str, Any]:
    found = catalogue.rescan()  # Folders may have come and gone since anybody last looked.
    if action == "rescan":
        return asdict(found)
    if action == "prune":
        return {"deleted": catalogue.retain(settings.retention)}
    if action in _STARRING:
        return _star(names, catalogue, settings.runs, starred=action == "star")
    page = catalogue.page()
    rows = list(page.rows)
    while page.next_cursor is not None:
        page = catalogue.page(cursor=page.next_cursor)
        rows += page.rows
    return {"runs": [asdict(row) for row in rows]}


def _star(
    names: Sequence[str], catalogue: Catalogue, runs: Path, *, starred: bool
) -> dict[str, Any]:
    """Star all of ``names`` or, where one is unknown, none."""
    for name in names:
        if catalogue.get(name) is None:
            raise ValueError(f"{runs} has no run {name}; `dronerf library list` names them")
    for name in names:
        star_run(runs / name, starred)
        catalogue.refresh(name)
    return {"starred" if starred else "unstarred": list(names)}


def _table(result: dict[str, Any]) -> str:
    """Return a result for people."""
    if isinstance(rows := result.get("runs"), list):
        # A training's id holds that of the capture it trains on.
        wide = max((len(row["id"]) for row in rows), default=0) + 2
        return "\n".join(
            f"{row['id']:<{wide}}{row['state']:<12}{row['pictures']:>4} pictures"
            f"{row['size_bytes'] / 1e6:>10.1f} MB{'  starred' if row['starred'] else ''}"
            for row in rows
        )
    for done in ("deleted", "starred", "unstarred"):
        if done in result:
            return "\n".join(f"{done} {run_id}" for run_id in result[done])
    return "\n".join(f"{key:<10}{value}" for key, value in result.items())
