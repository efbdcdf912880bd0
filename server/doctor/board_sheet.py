"""Writes a calibration board as a file to print."""

from __future__ import annotations

from pathlib import Path

from server.vision.calibration_board import Board
from server.vision.calibration_sheet import encode_sheet, paper_name


class SheetError(ValueError):
    """A board cannot be written as wanted; the text is one line that says why."""


def write_board(board: Board, path: Path) -> str:
    """Write a board as ``.png`` or ``.pdf`` and return one line that says how to print it.

    Raises:
        SheetError: If the file's ending is neither, or it cannot be written.
    """
    match path.suffix.lower():
        case ".png":
            data = encode_sheet(board, "png")
        case ".pdf":
            data = encode_sheet(board, "pdf")
        case _:
            raise SheetError(f"{path}: the board is written as .png or .pdf")
    try:
        path.write_bytes(data)
    except OSError as error:
        raise SheetError(f"{path}: cannot be written: {error.strerror or error}") from error
    return (
        f"print {path} on {paper_name(board)} at actual size (no scaling), check its ruler, and"
        " glue it on something flat and stiff"
    )
