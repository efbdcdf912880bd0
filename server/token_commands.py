"""``dronerf token``: who may come in beside the holder of the console's own token."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from server.api.access import ROLES, KeyFile
from server.app import StartError, check_runs
from server.settings import load_settings
from server.terminal import AddCommand


def add_token_commands(commands: Any, add: AddCommand) -> None:
    """Add ``token`` to a parser's ``commands`` by its own ``add``."""
    part = add(commands, "token", run_token, "hand out tokens with a role, and take them back")
    part.add_argument("action", choices=("add", "list", "revoke"))
    part.add_argument("name", nargs="?", default="", help="add: for whom; revoke: the token's id")
    part.add_argument("--role", choices=ROLES, default="viewer", help="what it allows (viewer)")
    part.add_argument("--runs", type=Path, help="folder of the run folders (runs)")
    part.add_argument("--json", action="store_true", help="print the result as one JSON object")


def run_token(arguments: argparse.Namespace) -> int:
    """Add, list or revoke; a running console follows at once."""
    settings = load_settings(runs=arguments.runs)
    check_runs(settings.runs)
    registry = KeyFile(settings.token_registry())
    if arguments.action != "list" and not arguments.name:
        raise StartError(f"token {arguments.action} needs a name")
    try:
        result = _act(arguments, registry)
    except (OSError, ValueError) as error:
        raise StartError(str(error)) from error
    print(json.dumps(result) if arguments.json else _words(result))
    return 0


def _act(arguments: argparse.Namespace, registry: KeyFile) -> dict[str, Any]:
    match arguments.action:
        case "add":
            key, token = registry.add(arguments.name, arguments.role)
            return {"id": key.id, "name": key.name, "role": key.role, "token": token}
        case "revoke":
            if not registry.remove(arguments.name):
                raise StartError(f"there is no token {arguments.name!r}")
            return {"revoked": arguments.name}
        case _:
            told = ("id", "name", "role", "made_at")
            return {"tokens": [{k: getattr(key, k) for k in told} for key in registry.all()]}


def _words(result: dict[str, Any]) -> str:
    if "tokens" in result:
        rows = [f"{t['id']}  {t['role']:<9} {t['made_at']}  {t['name']}" for t in result["tokens"]]
        return "\n".join(rows) or "no tokens beside the console's own"
    if "token" in result:
        return f"{result['token']}\nShow it now: only its digest is kept. Its id is {result['id']}."
    return f"revoked {result['revoked']}"
