"""What the frozen config says about itself: each value, its meaning, and what it may be.

Meanings come from the ``Attributes`` of the config's docstring. Bounds are found by asking the
config's own validation, so that they cannot say anything else than it does: a value is moved up and
down, all others as they are, until the config refuses it.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from pydantic import BaseModel

from server.api.problems import json_safe

# Nothing that can be set is meant beyond this; further up there is no bound.
_FAR = 1e7
_STEPS = 40
# What is found as near as this to zero means "anything above it".
_NEXT_TO_ZERO = 1e-6


class SettingView(BaseModel):
    """One setting as it stands.

    ``variable`` is the environment variable that sets it; ``default`` its value without one.
    ``least``, or ``more_than`` where the bound itself is not allowed, and ``most`` are the bounds
    while all other settings stay as they are, null where there is none or the setting is no number.
    """

    group: str
    name: str
    value: object
    default: object
    meaning: str
    variable: str
    least: float | None
    more_than: float | None
    most: float | None


def settings_from_config(groups: Mapping[str, object]) -> list[SettingView]:
    """Return every setting of ``groups`` (frozen dataclasses by name), nested ones included."""
    return [
        view
        for group, config in groups.items()
        for view in _views(group, (), config, type(config)())
    ]


def _views(group: str, above: tuple[str, ...], config: Any, usual: Any) -> Iterator[SettingView]:
    meanings = meanings_of(type(config))
    for field in dataclasses.fields(config):
        if not field.init or field.name.startswith("_"):
            continue
        value, path = getattr(config, field.name), (*above, field.name)
        if dataclasses.is_dataclass(value) and not isinstance(value, type):
            yield from _views(group, path, value, getattr(usual, field.name))
            continue
        least, most = bounds(config, field.name)
        above_zero = least is not None and 0.0 < least < _NEXT_TO_ZERO
        yield SettingView(
            group=group,
            name=".".join(path),
            value=_plain(value),
            default=_plain(getattr(usual, field.name)),
            meaning=meanings.get(field.name, ""),
            variable="DRONERF_" + "__".join((group, *path)).upper(),
            least=None if above_zero else least,
            more_than=0.0 if above_zero else None,
            most=most,
        )


def meanings_of(kind: type) -> dict[str, str]:
    """Return by field what the ``Attributes`` of the docstring of ``kind`` say about it."""
    found: dict[str, list[str]] = {}
    name, within = None, False
    for line in (kind.__doc__ or "").splitlines():
        if re.fullmatch(r" {4}\w+:", line):
            within = line.strip() == "Attributes:"
        head = re.match(r" {8}(\w+): (.*)", line)
        if head and within:
            name = head[1]
            found[name] = [head[2].strip()]
        elif name is not None and line.startswith(" " * 12):
            found[name].append(line.strip())
        else:
            name = None
    return {name: " ".join(words) for name, words in found.items()}


def bounds(config: Any, name: str) -> tuple[float | None, float | None]:
    """Return the least and the most that field ``name`` of ``config`` may be, all others as is."""
    value = getattr(config, name)
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None, None
    whole = isinstance(value, int)

    def allowed(number: float) -> bool:
        try:
            dataclasses.replace(config, **{name: round(number) if whole else number})
        except (ValueError, TypeError, ArithmeticError):
            return False
        return True

    return _edge(value, -_FAR, allowed, whole), _edge(value, _FAR, allowed, whole)


def _edge(inside: float, far: float, allowed: Callable[[float], bool], whole: bool) -> float | None:
    """Return the allowed number nearest to ``far``; None when even ``far`` itself is allowed."""
    if allowed(far):
        return None
    good, bad = float(inside), far
    # Zero divides the range that people think in, and is the commonest bound by far.
    for middle in (0.0, *(inside + (1 if far > 0 else -1) * 2.0**k for k in range(-10, 24))):
        if min(good, bad) < middle < max(good, bad):
            good, bad = (middle, bad) if allowed(middle) else (good, middle)
    for _ in range(_STEPS):
        middle = (good + bad) / 2.0
        good, bad = (middle, bad) if allowed(middle) else (good, middle)
    return float(round(good)) if whole else float(f"{good:.6g}")


def _plain(value: object) -> object:
    if isinstance(value, Mapping):
        return {str(key): _plain(each) for key, each in value.items()}
    if isinstance(value, tuple | list | set | frozenset):
        return [_plain(each) for each in value]
    if isinstance(value, bool | int | float | str) or value is None:
        return json_safe(value)
    return str(value)
