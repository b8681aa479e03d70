"""Progress callbacks."""

from __future__ import annotations

from collections.abc import Callable

__all__ = ["Report", "quiet"]

Report = Callable[[str], None]
"""Callback with the name of each stage when it starts."""


def quiet(stage: str) -> None:
    """Ignore the progress report; this is the default `Report`."""
