"""How many examples a property tries that takes longer than others."""

from __future__ import annotations

from hypothesis import settings

__all__ = ["examples"]

_USUAL = 25
"""Examples of a property in `just check`, as `conftest.py` sets them."""


def examples(few: int) -> int:
    """So many in `just check`, and in `just thorough` more by the same ratio as for all others."""
    return max(few * settings.default.max_examples // _USUAL, few) if settings.default else few
