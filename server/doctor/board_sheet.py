"""A calibration board as a file to print: PNG with its resolution, or PDF at true size."""

from __future__ import annotations

from pathlib import Path

from PIL import Image as Picture

from server.vision.calibration_board import Board, draw_sheet

_DPI = 300.0
_MM_PER_INCH = 25.4
# Portrait; a sheet that fits lying down is turned.
_PAPERS_MM = {"A4": (210.0, 297.0), "A3": (297.0, 420.0), "A2": (420.0, 594.0)}


class SheetError(ValueError):
    """A board cannot be written as wanted; the text is one line that says why."""


def write_board(board: Board, path: Path) -> str:
    """Write a board as ``.png`` or ``.pdf`` and return one line that says how to print it.

    Raises:
        SheetError: If the file's ending is neither, or it cannot be written.
    """
    kind = path.suffix.lower()
    if kind not in (".png", ".pdf"):
        raise SheetError(f"{path}: the board is written as .png or .pdf")
    # The nearest resolution with whole pixels per square, so that no two squares differ.
    dpi = round(board.square_mm * _DPI / _MM_PER_INCH) * _MM_PER_INCH / board.square_mm
    sheet = Picture.fromarray(draw_sheet(board, dpi / _MM_PER_INCH))
    size_mm = tuple(edge * _MM_PER_INCH / dpi for edge in sheet.size)
    paper = _paper(size_mm[0], size_mm[1])
    try:
        if kind == ".pdf":
            page = _on_page(sheet, paper, dpi)
            page.save(path, "PDF", resolution=dpi)
        else:
            sheet.save(path, dpi=(dpi, dpi))
    except OSError as error:
        raise SheetError(f"{path}: cannot be written: {error.strerror or error}") from error
    name = f"{paper[0]}" if paper else f"a sheet of {size_mm[0]:.0f} x {size_mm[1]:.0f} mm"
    return (
        f"print {path} on {name} at actual size (no scaling), check its ruler, and glue it on"
        " something flat and stiff"
    )


def _paper(width_mm: float, height_mm: float) -> tuple[str, float, float] | None:
    for name, (short, long) in _PAPERS_MM.items():
        for page in ((short, long), (long, short)):
            if width_mm <= page[0] and height_mm <= page[1]:
                return name, *page
    return None


def _on_page(
    sheet: Picture.Image, paper: tuple[str, float, float] | None, dpi: float
) -> Picture.Image:
    if paper is None:
        return sheet
    size = tuple(round(edge * dpi / _MM_PER_INCH) for edge in paper[1:])
    page = Picture.new("L", (size[0], size[1]), 255)
    page.paste(sheet, ((size[0] - sheet.size[0]) // 2, (size[1] - sheet.size[1]) // 2))
    return page
