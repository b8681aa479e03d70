"""How messages and files show plain values: numbers, durations, kinds of values, names of functions."""

from __future__ import annotations

__all__ = ["kind_of", "name_of", "number", "spoken"]


def number(value: float) -> str:
    """A number as G-code has it: at most five decimals, no needless zeros, no exponent."""
    return f"{value:z.5f}".rstrip("0").rstrip(".")


def spoken(seconds: float) -> str:
    """A duration as `1d 2h 3m 4s`, without leading zeros."""
    total = round(seconds)
    parts = [(total // 86400, "d"), (total // 3600 % 24, "h"), (total // 60 % 60, "m"), (total % 60, "s")]
    while len(parts) > 1 and parts[0][0] == 0:
        parts.pop(0)
    return " ".join(f"{count}{unit}" for count, unit in parts)


def kind_of(value: object) -> str:
    """What a value is."""
    return "nothing" if value is None else f"a value of type {type(value).__name__}"


def name_of(function: object) -> str:
    """What a function is called; of what is none, its type."""
    return str(getattr(function, "__name__", type(function).__name__))
