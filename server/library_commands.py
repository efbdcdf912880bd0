"""``dronerf library``: the catalogue of runs from a shell."""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

from sqlalchemy.exc import SQLAlchemyError

from server.app import StartError, catalogue_text, check_runs
from server.settings import Settings, load_settings
from server.store.catalogue import Catalogue
from server.terminal import AddCommand


def add_library_commands(commands: Any, add: AddCommand) -> None:
    """Add ``library`` to a parser's ``commands`` by its own ``add``."""
    part = add(commands, "library", run_library, "what was captured: find it again, tidy up")
    part.add_argument(
        "action",
        choices=("rescan", "list", "prune"),
        help="rescan: rebuild the catalogue from the run folders; list: all runs, newest first;"
        " prune: delete what the retention settings do not keep",
    )
    part.add_argument("--runs", type=Path, help="folder of the run folders (runs)")
    part.add_argument("--json", action="store_true", help="print the result as one JSON object")


def run_library(arguments: argparse.Namespace) -> int:
    """Run one action on the catalogue and print its result."""
    settings = load_settings(runs=arguments.runs)
    check_runs(settings.runs)
    try:
        with Catalogue(settings.runs, catalogue_text(settings)) as catalogue:
            result = _act(arguments.action, catalogue, settings)
    except ValueError as error:
        raise StartError(str(error)) from error
    except SQLAlchemyError as error:
        # The database's own words only: SQLAlchemy's text would go on with the statement.
        words = str(getattr(error, "orig", error)).strip().splitlines()
        raise StartError(f"catalogue: {words[0] if words else type(error).__name__}") from error
    print(json.dumps(result) if arguments.json else _table(result))
    return 0


def _act(action: str, catalogue: Catalogue, settings: Settings) -> dict[str, Any]:
    found = catalogue.rescan()  # Folders may have come and gone since anybody last looked.
    if action == "rescan":
        return asdict(found)
    if action == "prune":
        return {"deleted": catalogue.retain(settings.retention)}
    page = catalogue.page()
    rows = list(page.rows)
    while page.next_cursor is not None:
        page = catalogue.page(cursor=page.next_cursor)
        rows += page.rows
    return {"runs": [asdict(row) for row in rows]}


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
    if "deleted" in result:
        return "\n".join(f"deleted {run_id}" for run_id in result["deleted"])
    return "\n".join(f"{key:<10}{value}" for key, value in result.items())
