"""The TypeScript twin: complete, and in step with what is checked in."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import pytest
from pydantic import BaseModel

from server.api import messages, typescript

GENERATED = Path(__file__).parents[2] / "web/src/protocol/messages.gen.ts"


def test_every_message_has_its_interface_and_place_in_the_union() -> None:
    text = typescript.messages_text()
    for union in (messages.ServerMessage, messages.ClientMessage):
        for model in typescript.members(union):
            assert f"export interface {model.__name__} {{" in text
            assert f"  | {model.__name__}" in text
    assert "export interface TileHeader {" in text
    assert "export interface CodedTileHeader {" in text


def test_no_message_class_was_forgotten() -> None:
    known = {
        *typescript.members(messages.ServerMessage),
        *typescript.members(messages.ClientMessage),
        *typescript.PARTS,
        messages.TileHeader,
        messages.TileMarks,
        messages.CodedTileHeader,
    }
    public = {
        value
        for name, value in vars(messages).items()
        if isinstance(value, type) and value.__module__ == messages.__name__ and name[0] != "_"
    }
    assert public == known


def test_the_checked_in_file_is_up_to_date() -> None:
    assert GENERATED.read_text(encoding="utf-8") == typescript.messages_text()


@pytest.mark.parametrize(
    ("annotation", "text"),
    [
        (str, "string"),
        (int | None, "number | null"),
        (Literal["a", 'b"'], '"a" | "b\\""'),
        (list[float], "readonly number[]"),
        (list[int | str], "readonly (number | string)[]"),
        (dict[str, float], "Readonly<Record<string, number>>"),
        (messages.Note, "Note"),
    ],
)
def test_types(annotation: object, text: str) -> None:
    assert typescript.type_text(annotation) == text


@pytest.mark.parametrize("annotation", [bytes, dict[int, str], set[str], Literal[1]])
def test_types_without_a_twin_are_refused(annotation: object) -> None:
    with pytest.raises(ValueError, match=r"twin|literals"):
        typescript.type_text(annotation)


def test_the_file_named_is_written(tmp_path: Path) -> None:
    path = tmp_path / "messages.gen.ts"
    assert typescript.main([str(path)]) == 0
    assert path.read_text(encoding="utf-8") == typescript.messages_text()


def test_the_interface_follows_the_fields() -> None:
    class Sample(BaseModel):
        """A sample."""

        type: Literal["sample"] = "sample"
        size: float | None

    assert typescript.interface_text(Sample) == (
        "/** A sample. */\n"
        "export interface Sample {\n"
        '  readonly type: "sample";\n'
        "  readonly size: number | null;\n"
        "}"
    )
