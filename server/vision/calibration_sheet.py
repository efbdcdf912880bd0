"""A calibration board as a sheet to print: PNG with its resolution, or PDF at true size."""

from __future__ import annotations

import io
from typing import Literal

from PIL import Image as Picture

from server.vision.calibration_board import Board, draw_sheet, sheet_size_px

SheetForm = Literal["png", "pdf"]

_DPI = 300.0
_MM_PER_INCH = 25.4
# Portrait; a sheet that fits lying down is turned.
_PAPERS_MM = {"A4": (210.0, 297.0), "A3": (297.0, 420.0), "A2": (420.0, 594.0)}


def encode_sheet(board: Board, form: SheetForm) -> bytes:
    """Return the sheet as the bytes of a file; a PDF has the size of the paper it fits on."""
    dpi = _dpi(board)
    sheet = Picture.fromarray(draw_sheet(board, dpi / _MM_PER_INCH))
    file = io.BytesIO()
    if form == "pdf":
        page = _on_page(sheet, _paper(*_size_mm(sheet.size, dpi)), dpi)
        page.save(file, "PDF", resolution=dpi)
    else:
        sheet.save(file, "PNG", dpi=(dpi, dpi))
    return file.getvalue()


def paper_name(board: Board) -> str:
    """Return what to print the sheet on, for people."""
    dpi = _dpi(board)
    width_mm, height_mm = _size_mm(sheet_size_px(board, dpi / _MM_PER_INCH), dpi)
    paper = _paper(width_mm, height_mm)
    return paper[0] if paper else f"a sheet of {width_mm:.0f} x {height_mm:.0f} mm"


def _dpi(board: Board) -> float:
    """Return the nearest resolution with whole pixels per square, so that no two differ."""
    return round(board.square_mm * _DPI / _MM_PER_INCH) * _MM_PER_INCH / board.square_mm


def _size_mm(size_px: tuple[int, int], dpi: float) -> tuple[float, float]:
    return size_px[0] * _MM_PER_INCH / dpi, size_px[1] * _MM_PER_INCH / dpi


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
