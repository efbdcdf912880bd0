"""Drawing what the eyes see into the picture that people see; once per frame, then JPEG."""

from __future__ import annotations

import cv2
import numpy as np

from server.stages import Box, Frame, Region

_WHITE = (255, 255, 255)
_INK = (24, 24, 24)


def _bgr_from_hex(colour: str) -> tuple[int, int, int]:
    """Return B, G, R of ``#rrggbb``.

    Raises:
        ValueError: If ``colour`` is not of that form.
    """
    digits = colour.removeprefix("#")
    if len(digits) != 6 or not colour.startswith("#"):
        raise ValueError(f"a colour must look like #rrggbb, got {colour!r}")
    red, green, blue = (int(digits[i : i + 2], 16) for i in (0, 2, 4))
    return blue, green, red


def _label(canvas: np.ndarray, text: str, x: int, y: int, colour: tuple[int, int, int]) -> None:
    """Write ``text`` with its top left corner at (x, y) on a dark plate."""
    font, size = cv2.FONT_HERSHEY_SIMPLEX, 0.45
    (width, height), _ = cv2.getTextSize(text, font, size, 1)
    x = int(np.clip(x, 0, max(canvas.shape[1] - width - 8, 0)))
    y = int(np.clip(y, 0, max(canvas.shape[0] - height - 8, 0)))
    cv2.rectangle(canvas, (x, y), (x + width + 8, y + height + 8), _INK, -1)
    cv2.putText(canvas, text, (x + 4, y + height + 3), font, size, colour, 1, cv2.LINE_AA)


def outlines_px(region: Region, most_points: int = 120) -> tuple[np.ndarray, ...]:
    """Return the outlines of a region, each ``(k, 2)`` int, full-picture pixels.

    They are made coarser until they have no more than ``most_points`` points.
    """
    contours = _contours(region)
    tolerance = 0.5
    while sum(len(contour) for contour in contours) > most_points:
        coarse = (cv2.approxPolyDP(contour, tolerance, True) for contour in contours)
        # A speck that has become a line tells nothing.
        contours = [contour for contour in coarse if len(contour) > 2]
        tolerance *= 2.0
    scaled = ((contour[:, 0] + 0.5) * region.mask_scale - 0.5 for contour in contours)
    return tuple(np.rint(contour).astype(np.int64) for contour in scaled)


def _contours(region: Region) -> list[np.ndarray]:
    """Return the outlines ``(k, 1, 2)`` of a region, mask pixels."""
    mask = np.ascontiguousarray(region.mask).view(np.uint8)
    contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    return list(contours)


def _draw_region(
    canvas: np.ndarray, region: Region, frame_size: tuple[int, int], colour: tuple[int, int, int]
) -> None:
    factor = region.mask_scale * np.array(
        [canvas.shape[1] / frame_size[0], canvas.shape[0] / frame_size[1]]
    )
    outlines = [((contour + 0.5) * factor + 0.5).astype(np.int32) for contour in _contours(region)]
    cv2.polylines(canvas, outlines, True, _INK, 3)
    cv2.polylines(canvas, outlines, True, colour, 1)


def _turn_text(yaw_error_rad: float) -> str:
    """Return how far and which way to turn to face the object (equation 4), in whole degrees."""
    degrees = round(abs(float(np.rad2deg(yaw_error_rad))))
    if degrees == 0:
        return "facing"
    return f"{degrees} deg to the {'left' if yaw_error_rad > 0.0 else 'right'}"


def _draw_box(
    canvas: np.ndarray,
    box: Box,
    frame_size: tuple[int, int],
    colour: tuple[int, int, int],
    yaw_error_rad: float | None,
) -> None:
    """Draw box, centroid, the error vector from the picture's centre and what is known of it."""
    height, width = canvas.shape[:2]
    factor = np.array([width / frame_size[0], height / frame_size[1]])
    left, top, right, bottom = (
        np.rint((box.xyxy_px.reshape(2, 2) + 0.5) * factor).ravel().astype(int)
    )
    cv2.rectangle(canvas, (int(left), int(top)), (int(right), int(bottom)), colour, 2)
    cx, cy = (int(v) for v in np.rint((box.centroid_px + 0.5) * factor))
    cv2.arrowedLine(canvas, (width // 2, height // 2), (cx, cy), _WHITE, 1, cv2.LINE_AA, 0, 0.08)
    cv2.circle(canvas, (cx, cy), 4, colour, -1, cv2.LINE_AA)
    edge = ", cut off" if box.touches_edge else ""
    turn = "" if yaw_error_rad is None else f", {_turn_text(yaw_error_rad)}"
    text = f"object {100 * box.confidence:.0f} %{turn}{edge}"
    # Never over the drone's name in the corner.
    _label(canvas, text, int(left), max(int(top) - 22, 34), colour)


def annotate(
    frame: Frame,
    region: Region | None,
    box: Box | None,
    name: str,
    colour: str,
    *,
    yaw_error_rad: float | None = None,
    note: str = "",
    size: tuple[int, int] = (640, 480),
    quality: int = 70,
) -> bytes:
    """Return ``frame`` as JPEG with what was seen in it drawn in.

    Drawn are the region's outline, the box with its confidence, its centroid, the error vector from
    the picture's centre to it, the orientation and the drone's name.

    Args:
        frame: The picture.
        region: Its region, None when the object was not seen.
        box: Its box, None when the object was not seen.
        name: The drone's display name.
        colour: The drone's display colour, ``#rrggbb``.
        yaw_error_rad: How far the drone must turn to face the box, counter-clockwise positive,
            see ``orientation.yaw_error``; None leaves it out.
        note: What else there is to say of the picture.
        size: Width and height of the JPEG, pixels.
        quality: JPEG quality, 1 to 100.

    Raises:
        ValueError: If ``colour`` is malformed or the picture cannot be encoded.
    """
    bgr = _bgr_from_hex(colour)
    width, height = frame.size_px
    canvas = frame.reduced_bgr(*size)
    centre = (size[0] // 2, size[1] // 2)
    cv2.drawMarker(canvas, centre, _WHITE, cv2.MARKER_CROSS, 14, 1)
    if region is not None:
        _draw_region(canvas, region, (width, height), bgr)
    if box is not None:
        _draw_box(canvas, box, (width, height), bgr, yaw_error_rad)
    _label(canvas, name, 8, 8, bgr)
    if box is None:
        _label(canvas, "object not seen", 8, 34, _WHITE)
    if frame.damaged or note:
        _label(canvas, note or "picture damaged", 8, 60, _WHITE)
    done, jpeg = cv2.imencode(".jpg", canvas, [cv2.IMWRITE_JPEG_QUALITY, quality])
    if not done:
        raise ValueError("annotate: the picture could not be encoded as JPEG")
    return jpeg.tobytes()
