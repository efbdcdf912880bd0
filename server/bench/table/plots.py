"""Plots as SVG text: grouped bars with their deviation, and lines over counts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape

COLOURS = {
    "standard_paper": "#b0b0b0",
    "standard_refined": "#6f8fb5",
    "optimized": "#d9822b",
    "optimized_true_poses": "#e8c9a0",
}
_HEIGHT, _LEFT, _TOP, _BOTTOM = 300, 50, 40, 40
_BAR, _GAP = 22, 30
_LINE_WIDTH = 420


def bars(
    title: str,
    groups: Mapping[str, Mapping[str, tuple[float, float | None]]],
    references: Mapping[str, float],
) -> str:
    """Return a plot of grouped bars.

    Args:
        title: What is plotted, with its unit.
        groups: By group, by series of ``COLOURS``: value and deviation.
        references: By group, a value to compare with, drawn as a dashed line.
    """
    top = _ceiling(
        [value + (sd or 0.0) for group in groups.values() for value, sd in group.values()]
        + list(references.values())
    )
    parts, x = [], _LEFT + _GAP / 2.0
    for name, group in groups.items():
        begun = x
        for series, (value, sd) in group.items():
            y = _y(value, top)
            parts.append(
                f'<rect x="{x:.1f}" y="{y:.1f}" width="{_BAR - 2}" '
                f'height="{_y(0.0, top) - y:.1f}" fill="{COLOURS[series]}"/>'
            )
            if sd is not None:
                parts.append(
                    _upright(x + _BAR / 2.0 - 1.0, _y(value - sd, top), _y(value + sd, top))
                )
            x += _BAR
        if name in references:
            y = _y(references[name], top)
            parts.append(
                f'<line x1="{begun:.1f}" y1="{y:.1f}" x2="{x - 2:.1f}" y2="{y:.1f}" '
                'stroke="#222" stroke-dasharray="4 3"/>'
            )
        parts.append(_text((begun + x) / 2.0, _HEIGHT - _BOTTOM + 18, name, "middle"))
        x += _GAP
    return _sheet(title, x, top, parts, list(COLOURS))


def lines(title: str, series: Mapping[str, Sequence[tuple[float, float]]]) -> str:
    """Return a plot of lines through points ``(count, value)``; the counts share their axis."""
    counts = sorted({count for points in series.values() for count, _ in points})
    top = _ceiling([value for points in series.values() for _, value in points])
    step = _LINE_WIDTH / max(len(counts), 1)
    at = {count: _LEFT + step * (k + 0.5) for k, count in enumerate(counts)}
    parts = [_text(x, _HEIGHT - _BOTTOM + 18, f"{count:g}", "middle") for count, x in at.items()]
    for name, points in series.items():
        places = [(at[count], _y(value, top)) for count, value in sorted(points)]
        path = " ".join(f"{x:.1f},{y:.1f}" for x, y in places)
        parts.append(
            f'<polyline points="{path}" fill="none" stroke="{COLOURS[name]}" stroke-width="2"/>'
        )
        parts += [
            f'<circle cx="{x:.1f}" cy="{y:.1f}" r="4" fill="{COLOURS[name]}"/>' for x, y in places
        ]
    return _sheet(title, _LEFT + _LINE_WIDTH, top, parts, list(series))


def _ceiling(values: Sequence[float]) -> float:
    return max([*values, 1e-9]) * 1.1


def _y(value: float, top: float) -> float:
    share = min(max(value / top, 0.0), 1.0)
    return _HEIGHT - _BOTTOM - share * (_HEIGHT - _BOTTOM - _TOP)


def _upright(x: float, y1: float, y2: float) -> str:
    return f'<line x1="{x:.1f}" y1="{y1:.1f}" x2="{x:.1f}" y2="{y2:.1f}" stroke="#222"/>'


def _text(x: float, y: float, text: str, anchor: str = "start") -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}">{escape(text)}</text>'


def _sheet(
    title: str, width: float, top: float, parts: Sequence[str], series: Sequence[str]
) -> str:
    """Return the whole picture: title, axis with five marks, ``parts``, and a legend."""
    marks = [top * k / 5.0 for k in range(6)]
    axis = [_text(_LEFT - 6, _y(mark, top) + 4, f"{mark:.1f}", "end") for mark in marks]
    axis += [
        f'<line x1="{_LEFT}" y1="{_y(mark, top):.1f}" x2="{width:.0f}" y2="{_y(mark, top):.1f}" '
        'stroke="#ddd"/>'
        for mark in marks
    ]
    legend = []
    for k, name in enumerate(series):
        y = _TOP + 20 * k
        legend.append(
            f'<rect x="{width + 15:.0f}" y="{y}" width="12" height="12" fill="{COLOURS[name]}"/>'
        )
        legend.append(_text(width + 33, y + 11, name))
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{width + 190:.0f}" '
            f'height="{_HEIGHT}" font-family="sans-serif" font-size="12">',
            '<rect width="100%" height="100%" fill="white"/>',
            _text(_LEFT, 22, title),
            *axis,
            *parts,
            *legend,
            "</svg>\n",
        ]
    )
