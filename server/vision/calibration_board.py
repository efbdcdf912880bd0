"""The boards a camera is calibrated with: what they are, how they are drawn, how they are found.

Symbols: board coordinates are metres in the board's plane, x along its columns, y along its rows,
z = 0; pixels are pixel centres, ``(n, 2)``. A ChArUco board is named by its squares, a chessboard
by its inner corners, as is the custom for each.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Image = NDArray[np.uint8]

DEFAULT_DICTIONARY = "5x5_100"
# Fits an A4 sheet.
DEFAULT_BOARD = "charuco:7x5:38:28"

# Fewer corners than this on a ChArUco board fix neither its pose nor much of the camera.
LEAST_CORNERS = 8
_MOST_CELLS = 60
_MARGIN_MM = 5.0
_CAPTION_MM = 8.0
_RULER_MM = 100.0


class BoardError(ValueError):
    """A board cannot be what was written; the text is one line that says why."""


@dataclass(frozen=True, slots=True)
class Board:
    """A flat calibration pattern.

    Attributes:
        kind: ``charuco`` or ``chessboard``.
        columns: Squares along x of a ChArUco board, inner corners along x of a chessboard.
        rows: The same along y.
        square_mm: Edge of a square, millimetres.
        marker_mm: Edge of a marker, millimetres; 0 for a chessboard.
        dictionary: ArUco dictionary of a ChArUco board, such as ``5x5_100``; else empty.
    """

    kind: str
    columns: int
    rows: int
    square_mm: float
    marker_mm: float = 0.0
    dictionary: str = ""

    def __post_init__(self) -> None:
        if self.kind not in ("charuco", "chessboard"):
            raise BoardError(f"kind must be charuco or chessboard, not {self.kind!r}")
        least = 3
        for name in ("columns", "rows"):
            value = getattr(self, name)
            if not least <= value <= _MOST_CELLS:
                raise BoardError(f"{name} must be {least} to {_MOST_CELLS}, not {value}")
        if not 1.0 <= self.square_mm <= 1000.0:
            raise BoardError(f"square_mm must be 1 to 1000, not {self.square_mm:g}")
        if self.kind == "chessboard":
            return
        if not 0.3 * self.square_mm <= self.marker_mm < self.square_mm:
            raise BoardError(
                f"marker_mm must be smaller than the square of {self.square_mm:g} and at least"
                f" 0.3 of it, not {self.marker_mm:g}"
            )
        if self.markers_needed > _dictionary_size(self.dictionary):
            raise BoardError(
                f"dictionary {self.dictionary} has too few markers, the board needs"
                f" {self.markers_needed}"
            )

    @property
    def name(self) -> str:
        """The board as it is written on the command line."""
        text = f"{self.kind}:{self.columns}x{self.rows}:{self.square_mm:g}"
        if self.kind == "charuco":
            text += f":{self.marker_mm:g}"
            if self.dictionary != DEFAULT_DICTIONARY:
                text += f":{self.dictionary}"
        return text

    @property
    def markers_needed(self) -> int:
        """How many markers are printed on a ChArUco board."""
        return self.columns * self.rows // 2

    @property
    def corners(self) -> int:
        """How many inner corners there are to find."""
        if self.kind == "charuco":
            return (self.columns - 1) * (self.rows - 1)
        return self.columns * self.rows

    @property
    def squares(self) -> tuple[int, int]:
        """Squares along x and y as printed."""
        if self.kind == "charuco":
            return self.columns, self.rows
        return self.columns + 1, self.rows + 1

    def corner_points(self) -> Array:
        """Return the inner corners ``(corners, 3)`` in board coordinates, metres, row by row."""
        across, down = self.squares
        x, y = np.meshgrid(np.arange(1, across), np.arange(1, down))
        points = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
        return np.asarray(points * (self.square_mm / 1000.0), np.float64)


@dataclass(frozen=True, slots=True, eq=False)
class BoardView:
    """A board as one picture shows it.

    Attributes:
        name: Which picture, for people.
        width: Picture width, pixels.
        height: Picture height, pixels.
        pixels: Found inner corners ``(n, 2)``, pixels.
        points_board: The same corners ``(n, 3)`` in board coordinates, metres.
        ids: Which corners they are ``(n,)``, row by row from 0.
        sharpness: Steepest edges' slope as a share of the contrast, per pixel: about 0.5 for a
            step within a pixel, a fifth of that when blurred over five.
    """

    name: str
    width: int
    height: int
    pixels: Array
    points_board: Array
    ids: NDArray[np.int64]
    sharpness: float


def parse_board(text: str) -> Board:
    """Read ``charuco:7x5:38:28[:DICTIONARY]`` or ``chessboard:9x6:25``.

    Lengths are millimetres: the square, the marker. For a ChArUco board squares are counted, for a
    chessboard inner corners.

    Raises:
        BoardError: If it is neither.
    """
    kind, *parts = text.strip().lower().split(":")
    forms = {"charuco": (3, 4), "chessboard": (2,)}
    wanted = "charuco:7x5:38:28 (squares, mm) or chessboard:9x6:25 (inner corners, mm)"
    if len(parts) not in forms.get(kind, ()):
        raise BoardError(f"a board is written like {wanted}, not {text!r}")
    try:
        columns, rows = (int(number) for number in parts[0].split("x"))
        lengths = [float(number) for number in parts[1:3]]
    except ValueError:
        raise BoardError(f"a board is written like {wanted}, not {text!r}") from None
    if kind == "chessboard":
        return Board(kind, columns, rows, lengths[0])
    dictionary = parts[3] if len(parts) == 4 else DEFAULT_DICTIONARY
    return Board(kind, columns, rows, lengths[0], lengths[1], dictionary)


def _dictionary(name: str) -> cv2.aruco.Dictionary:
    number = getattr(cv2.aruco, f"DICT_{name.upper()}", None)
    if not isinstance(number, int):
        raise BoardError(f"unknown marker dictionary {name!r}; try 4x4_50, 5x5_100 or 6x6_250")
    return cv2.aruco.getPredefinedDictionary(number)


def _dictionary_size(name: str) -> int:
    return len(_dictionary(name).bytesList)


def _charuco(board: Board) -> cv2.aruco.CharucoBoard:
    return cv2.aruco.CharucoBoard(
        (board.columns, board.rows),
        board.square_mm / 1000.0,
        board.marker_mm / 1000.0,
        _dictionary(board.dictionary),
    )


def draw_board(board: Board, px_per_mm: float) -> Image:
    """Return the grey picture of the bare pattern, a whole number of pixels per square."""
    square = _square_px(board, px_per_mm)
    across, down = board.squares
    if board.kind == "charuco":
        size = (across * square, down * square)
        return np.asarray(_charuco(board).generateImage(size, marginSize=0), np.uint8)
    odd = np.add.outer(np.arange(down), np.arange(across)) % 2
    return np.kron(np.where(odd, 255, 0), np.ones((square, square))).astype(np.uint8)


def sheet_size_px(board: Board, px_per_mm: float) -> tuple[int, int]:
    """Return width and height of what ``draw_sheet`` draws, in pixels."""
    square, margin = _square_px(board, px_per_mm), round(_MARGIN_MM * px_per_mm)
    across, down = board.squares
    caption = round(_CAPTION_MM * px_per_mm)
    return across * square + 2 * margin, down * square + 2 * margin + caption


def draw_sheet(board: Board, px_per_mm: float) -> Image:
    """Return the board with a white margin, its name and a ruler to check the print's scale by."""
    pattern = draw_board(board, px_per_mm)
    margin = round(_MARGIN_MM * px_per_mm)
    height, width = pattern.shape
    sheet = np.full(sheet_size_px(board, px_per_mm)[::-1], 255, np.uint8)
    sheet[margin : margin + height, margin : margin + width] = pattern
    ruler = min(_RULER_MM, 10.0 * (width / px_per_mm // 10.0))
    left, base = margin, height + 2 * margin
    right = left + round(ruler * px_per_mm)
    thick = max(1, round(0.3 * px_per_mm))
    tick = round(2.0 * px_per_mm)
    cv2.line(sheet, (left, base), (right, base), 0, thick)
    for x in (left, right):
        cv2.line(sheet, (x, base - tick), (x, base + tick), 0, thick)
    text = f"{board.name}   the line is {ruler:g} mm"
    scale = 3.0 * px_per_mm / 22.0  # The font is 22 pixels high at scale 1.
    at = (left, base + round(6.0 * px_per_mm))
    cv2.putText(sheet, text, at, cv2.FONT_HERSHEY_SIMPLEX, scale, 0, thick, cv2.LINE_AA)
    return sheet


def _square_px(board: Board, px_per_mm: float) -> int:
    return max(4, round(board.square_mm * px_per_mm))


class BoardFinder:
    """Finds one board in pictures; keeps what the search needs from picture to picture."""

    def __init__(self, board: Board) -> None:
        self.board = board
        self._points = board.corner_points()
        self._charuco = (
            cv2.aruco.CharucoDetector(_charuco(board)) if board.kind == "charuco" else None
        )

    def find(self, image: Image, name: str = "") -> BoardView | None:
        """Return the board in a BGR or grey picture, or None when too little of it is seen."""
        grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) if image.ndim == 3 else image
        grey = np.ascontiguousarray(grey, np.uint8)
        found = self._charuco_corners(grey) if self._charuco else self._chessboard_corners(grey)
        if found is None:
            return None
        pixels, ids = found
        points = self._points[ids]
        # Corners on one line say nothing about the board's attitude.
        if np.linalg.matrix_rank(points[:, :2] - points[0, :2], tol=1e-6) < 2:
            return None
        height, width = grey.shape
        sharpness = _sharpness(grey, pixels)
        return BoardView(name, width, height, pixels, points, ids, sharpness)

    def _charuco_corners(self, grey: Image) -> tuple[Array, NDArray[np.int64]] | None:
        assert self._charuco is not None
        pixels, ids, _, _ = self._charuco.detectBoard(grey)
        if ids is None or len(ids) < LEAST_CORNERS:
            return None
        return np.asarray(pixels, float).reshape(-1, 2), np.asarray(ids, np.int64).ravel()

    def _chessboard_corners(self, grey: Image) -> tuple[Array, NDArray[np.int64]] | None:
        size = (self.board.columns, self.board.rows)
        # The quick search tells most pictures without a board, which the exact one is slow at.
        if not cv2.checkChessboard(grey, size):
            return None
        found, pixels = cv2.findChessboardCornersSB(grey, size, flags=cv2.CALIB_CB_ACCURACY)
        if not found:
            return None
        return np.asarray(pixels, float).reshape(-1, 2), np.arange(self.board.corners)

    def explain(self, image: Image) -> str:
        """Return what a picture shows in place of the board, for the line that refuses it."""
        if self._charuco is None:
            size = f"{self.board.columns}x{self.board.rows}"
            return f"no chessboard with {size} inner corners; are corners counted, not squares?"
        seen = _markers(image, self.board.dictionary)
        if seen:
            ours = [number for number in seen if number < self.board.markers_needed]
            if len(ours) < len(seen):
                return (
                    f"markers of {self.board.dictionary} up to number {max(seen)} are seen, this"
                    f" board has only {self.board.markers_needed}: other columns or rows?"
                )
            return f"only {len(seen)} of the board's {self.board.markers_needed} markers are seen"
        for other in ("4x4_1000", "5x5_1000", "6x6_1000", "7x7_1000"):
            if other.split("_")[0] != self.board.dictionary.split("_")[0]:
                count = len(_markers(image, other))
                if count >= 4:
                    return f"markers of another dictionary are seen: try :{other.split('_')[0]}_100"
        return "no markers are seen"


def _markers(image: Image, dictionary: str) -> list[int]:
    _, ids, _ = cv2.aruco.ArucoDetector(_dictionary(dictionary)).detectMarkers(image)
    return [] if ids is None else [int(number) for number in np.ravel(ids)]


def _sharpness(grey: Image, pixels: Array) -> float:
    """Return the 95th percentile of the slope around the corners over the contrast there."""
    low = np.maximum(np.floor(pixels.min(axis=0)).astype(int) - 2, 0)
    high = np.ceil(pixels.max(axis=0)).astype(int) + 3
    part = grey[low[1] : high[1], low[0] : high[0]].astype(np.float32)
    dark, light = np.percentile(part, (5, 95))
    slope = np.hypot(cv2.Sobel(part, cv2.CV_32F, 1, 0), cv2.Sobel(part, cv2.CV_32F, 0, 1)) / 8.0
    return float(np.percentile(slope, 95) / max(1.0, light - dark))
