"""What messages call values and functions that come from outside."""

from __future__ import annotations

__all__ = ["kind_of", "name_of"]


def kind_of(value: object) -> str:
    """What a value is."""
    return "nothing" if value is None else f"a value of type {type(value).__name__}"


def name_of(function: object) -> str:
    """What a function is called; of what is none, its type."""
    return str(getattr(function, "__name__", type(function).__name__))
