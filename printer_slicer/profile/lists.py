"""Parse and format settings that are lists, such as `0.1, 0.2, 0.3` and `10:20:tolerance=0.05`."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from typing import Any, Final, NamedTuple

from printer_slicer.errors import ProfileError
from printer_slicer.profile import overrides

__all__ = ["LISTS", "format_list", "merge_lists", "parse_list"]

_RANGE_KEYS = ("tolerance", "layer_height")


def parse_list(key: str, text: str) -> list[Any]:
    """Parse the text of a setting as a list; empty text is an empty list.

    Args:
        key: one of `LISTS`.
        text: such as `0.1, 0.2, 0.3`.

    Raises:
        ProfileError: the text is not a list of this kind.
    """
    separator, read, example = LISTS[key]
    items = [item for item in text.split(separator) if item.strip()]
    with suppress(ValueError):
        if items or not text.strip():
            return [read(item) for item in items]
    raise ProfileError(f"{key}: {text!r} is not a valid list", remedy=f"Write it like this: {example}")


def _parse_range(text: str) -> dict[str, float]:
    """Parse LOW:HIGH:KEY=VALUE[:KEY=VALUE] as a table."""
    low, high, *rules = (part.strip() for part in text.split(":"))
    table = {"low": float(low), "high": float(high)}
    for rule in rules:
        key, sign, value = rule.partition("=")
        if not sign or key.strip() not in _RANGE_KEYS:
            raise ValueError(rule)
        table[key.strip()] = float(value)
    if len(table) == 2:
        raise ValueError(text)
    return table


class _ListFormat(NamedTuple):
    """The text format of a list: separator, function that reads an item, example."""

    separator: str
    read: Callable[[str], Any]
    example: str


LISTS: Final[Mapping[str, _ListFormat]] = {
    "layer_heights": _ListFormat(",", float, "0.1, 0.2, 0.3"),
    "pause_at": _ListFormat(",", float, "4, 12.5"),
    "thumbnails": _ListFormat(",", str.strip, "32x32, 300x300/QOI"),
    "excluded_areas": _ListFormat(",", str.strip, "0x0 18x28, 200x0 220x0 220x30"),
    "head": _ListFormat(",", str.strip, "0: 45, 25: -9999x-30 9999x30"),
    "overrides": _ListFormat(";", overrides.parse_override, "lid:infill_density=0.4; 5:10:perimeters=4"),
    "planner.ranges": _ListFormat(";", _parse_range, "10:20:tolerance=0.05; 30:31:layer_height=0.1"),
}
"""Setting that is a list -> its text format."""


def merge_lists(key: str, old: Sequence[Any], new: Sequence[Any]) -> list[Any]:
    """Merge two lists: new rules for objects and height ranges override the old ones; other lists are replaced.

    Args:
        key: one of `LISTS`.
        old: the list with lower precedence.
        new: the list with higher precedence; if it is empty, it removes all rules.
    """
    if not new or key not in ("overrides", "planner.ranges"):
        return list(new)
    if key == "overrides":
        return [*old, *new]
    kept = [piece for one in old for piece in _find_remaining_ranges(one, new)]
    return [*kept, *new]


def _find_remaining_ranges(old: Any, new: Sequence[Any]) -> Iterator[Any]:
    """Yield the sections of a height range that later ranges do not override."""
    try:
        rules = {key: old[key] for key in _RANGE_KEYS if old.get(key)}
        later_ranges = {key: [(one["low"], one["high"]) for one in new if one.get(key)] for key in rules}
        is_unchanged = all(
            high <= old["low"] or low >= old["high"]
            for key in later_ranges
            for low, high in later_ranges[key]
        )
        pieces = {key: _subtract_ranges(old["low"], old["high"], later_ranges[key]) for key in rules}
    except (AttributeError, KeyError, TypeError):  # not a range; the conversion reports it
        is_unchanged = True
    if is_unchanged:
        yield old
        return
    for key, value in rules.items():
        yield from ({"low": low, "high": high, key: value} for low, high in pieces[key])


def _subtract_ranges(
    low: float, high: float, later_ranges: Sequence[tuple[float, float]]
) -> Iterator[tuple[float, float]]:
    """Yield the sections of a height range that lie outside all later ranges."""
    for start, end in sorted(later_ranges):
        if low < min(start, high):
            yield low, min(start, high)
        low = max(low, end)
    if low < high:
        yield low, high


def format_list(values: Sequence[Any]) -> str:
    """Format a list as text for `parse_list`."""
    if values and isinstance(values[0], Mapping) and "set" in values[0]:
        return overrides.format_overrides(values)
    if values and isinstance(values[0], Mapping):
        return "; ".join(_format_range(item) for item in values)
    return ", ".join(value if isinstance(value, str) else f"{value:.10g}" for value in values)


def _format_range(table: Mapping[str, float]) -> str:
    """Format a height range with its rules as text for `_parse_range`."""
    rules = "".join(f":{key}={table[key]:.10g}" for key in _RANGE_KEYS if table.get(key))
    return f"{table['low']:.10g}:{table['high']:.10g}{rules or ':tolerance=0'}"
