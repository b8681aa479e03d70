"""What long work tells of its progress."""

from __future__ import annotations

from collections.abc import Callable

__all__ = ["Report", "quiet"]

Report = Callable[[str], None]
"""Called with the name of each stage as it begins."""


def quiet(stage: str) -> None:
    """A `Report` that says nothing."""
