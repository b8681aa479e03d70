"""Format plain values for messages and files: numbers, durations, types, names of functions; find similar words."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from math import floor, log10

__all__ = [
    "describe_type",
    "find_similar_words",
    "format_count",
    "format_duration",
    "format_number",
    "format_significant",
    "get_callable_name",
    "list_with_counts",
]


def format_number(value: float) -> str:
    """Format a number for G-code: at most five decimals, no trailing zeros, no exponent."""
    return f"{value:z.5f}".rstrip("0").rstrip(".")


def format_significant(value: float) -> str:
    """Format a number with three significant digits, at most four decimals, and no exponent."""
    decimals = min(max(2 - floor(log10(abs(value))), 0), 4) if value else 0
    text = f"{value:.{decimals}f}"
    return text.rstrip("0").rstrip(".") if decimals else text


def format_count(count: int, noun: str) -> str:
    """Format a count with its noun: `1 layer`, `2 layers`."""
    return f"{count} {noun}{'' if count == 1 else 's'}"


def list_with_counts(names: Iterable[str]) -> list[str]:
    """Return each name once, in the order of the first ones; repeated ones with their number, such as `3 x lid`."""
    counts = Counter(names)
    return [name if count == 1 else f"{count} x {name}" for name, count in counts.items()]


def format_duration(seconds: float) -> str:
    """Format a duration as `1d 2h 3m 4s`, without leading zeros."""
    total = round(seconds)
    parts = [(total // 86400, "d"), (total // 3600 % 24, "h"), (total // 60 % 60, "m"), (total % 60, "s")]
    while len(parts) > 1 and parts[0][0] == 0:
        parts.pop(0)
    return " ".join(f"{count}{unit}" for count, unit in parts)


def describe_type(value: object) -> str:
    """Return the type of a value in words, for messages: `a value of type int`, or `nothing` for None."""
    return "nothing" if value is None else f"a value of type {type(value).__name__}"


def get_callable_name(function: object) -> str:
    """Return the name of a function, or of the type of an object without a name."""
    return str(getattr(function, "__name__", type(function).__name__))


def find_similar_words(word: str, known: Iterable[str], *, most: int = 3, cutoff: float = 0.6) -> list[str]:
    """Return the known words with a spelling similar to a word, the most similar first.

    Args:
        word: the word.
        known: words to compare with it.
        most: maximum number of words to return.
        cutoff: minimum similarity, from 0 to 1.
    """
    from difflib import get_close_matches  # noqa: PLC0415 - only messages need it

    return get_close_matches(word, list(known), most, cutoff)
