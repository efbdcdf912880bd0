"""Numbers as JSON knows them: 24.0 is a whole number, true is none, and text is no number."""

from __future__ import annotations

from typing import Annotated

from pydantic import BeforeValidator, Field


def _whole(value: object) -> object:
    return int(value) if isinstance(value, float) and value.is_integer() else value


# Stands last, behind the bounds: only so does the OpenAPI document tell them.
WHOLE = BeforeValidator(_whole)
Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
