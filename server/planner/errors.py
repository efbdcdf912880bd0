"""What planning can fail with."""

from __future__ import annotations


class PlanError(ValueError):
    """No plan satisfies the constraints; the text names the one that rules everything out."""
