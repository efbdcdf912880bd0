"""Write the TypeScript twin of the wire schema: ``python -m server.api.typescript FILE``.

One exported interface per message, the two unions, and the tile header. The types come from the
messages' annotations, so the browser cannot disagree with the server unnoticed.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Literal, Union, get_args, get_origin

from pydantic import BaseModel

from server.api import messages

# Models that are no message but part of one.
PARTS: tuple[type[BaseModel], ...] = (messages.PriorityPart, messages.NoGoVolume)

_HEADER = """\
// Generated from server/api/messages.py by `make messages`. Do not edit.
// Units are SI, times are seconds, `at` is ISO 8601 UTC.
"""

_PLAIN: dict[object, str] = {
    str: "string",
    int: "number",
    float: "number",
    bool: "boolean",
    object: "unknown",
    NoneType: "null",
    None: "null",
}


def type_text(annotation: object) -> str:
    """Return the TypeScript type of a Python annotation.

    Raises:
        ValueError: The annotation has no twin here.
    """
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation.__name__
    if annotation in _PLAIN:
        return _PLAIN[annotation]
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        return type_text(arguments[0])
    if origin is Literal:
        return " | ".join(_literal_text(value) for value in arguments)
    if origin in (Union, UnionType):
        return " | ".join(type_text(argument) for argument in arguments)
    if origin is list:
        item = type_text(arguments[0])
        return f"readonly ({item})[]" if " " in item else f"readonly {item}[]"
    if origin is dict and arguments[0] is str:
        return f"Readonly<Record<string, {type_text(arguments[1])}>>"
    raise ValueError(f"no TypeScript twin for {annotation!r}")


def _literal_text(value: object) -> str:
    if isinstance(value, str):
        return '"' + value.replace("\\", "\\\\").replace('"', '\\"') + '"'
    raise ValueError(f"only string literals are on the wire, not {value!r}")


def interface_text(model: type[BaseModel]) -> str:
    """Return one exported interface, with the model's docstring as its comment."""
    lines = [
        f"  readonly {name}: {type_text(f.annotation)};" for name, f in model.model_fields.items()
    ]
    doc = " ".join((model.__doc__ or "").split())
    return "\n".join([f"/** {doc} */", f"export interface {model.__name__} {{", *lines, "}"])


def members(union: object) -> tuple[type[BaseModel], ...]:
    """Return the message classes of an annotated union, in order."""
    return get_args(get_args(union)[0])


def _union_text(name: str, models: Iterable[type[BaseModel]]) -> str:
    return f"export type {name} =\n" + "\n".join(f"  | {model.__name__}" for model in models) + ";"


def messages_text() -> str:
    """Return the whole TypeScript file."""
    server, client = members(messages.ServerMessage), members(messages.ClientMessage)
    parts = [
        _HEADER.rstrip(),
        *(interface_text(model) for model in PARTS),
        *(interface_text(model) for model in server),
        _union_text("ServerMessage", server),
        *(interface_text(model) for model in client),
        _union_text("ClientMessage", client),
        interface_text(messages.TileHeader),
        interface_text(messages.TileMarks),
        interface_text(messages.CodedTileHeader),
    ]
    return "\n\n".join(parts) + "\n"


def main(arguments: list[str]) -> int:
    """Write the file that the only argument names."""
    if len(arguments) != 1:
        sys.stderr.write("usage: python -m server.api.typescript FILE\n")
        return 2
    Path(arguments[0]).write_text(messages_text(), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
