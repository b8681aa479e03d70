"""Settings that are lists, as people type them: `0.1, 0.2, 0.3` and `10:20:tolerance=0.05; 30:31:layer_height=0.1`."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from typing import Any, Final, NamedTuple

from printer_slicer.errors import ProfileError
from printer_slicer.profile import overrides

__all__ = ["LISTS", "added", "list_as_text", "list_from_text"]

_RANGE_KEYS = ("tolerance", "layer_height")


def list_from_text(key: str, text: str) -> list[Any]:
    """The list that the text of a setting stands for; empty text is an empty list.

    Args:
        key: one of `LISTS`.
        text: as in the heading of this module.

    Raises:
        ProfileError: it cannot be read so.
    """
    separator, read, example = LISTS[key]
    items = [item for item in text.split(separator) if item.strip()]
    with suppress(ValueError):
        if items or not text.strip():
            return [read(item) for item in items]
    raise ProfileError(f"{key}: {text!r} cannot be read as a list", remedy=f"write it like this: {example}")


def _range(text: str) -> dict[str, float]:
    """LOW:HIGH:KEY=VALUE[:KEY=VALUE] as a table."""
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


class _List(NamedTuple):
    """How the text of a list is read: what stands between items, what reads one, and an example."""

    separator: str
    read: Callable[[str], Any]
    example: str


LISTS: Final[Mapping[str, _List]] = {
    "layer_heights": _List(",", float, "0.1, 0.2, 0.3"),
    "pause_at": _List(",", float, "4, 12.5"),
    "thumbnails": _List(",", str.strip, "32x32, 300x300/QOI"),
    "overrides": _List(";", overrides.from_text, "lid:infill_density=0.4; 5:10:perimeters=4"),
    "planner.ranges": _List(";", _range, "10:20:tolerance=0.05; 30:31:layer_height=0.1"),
}
"""The settings that are lists."""


def added(key: str, old: Sequence[Any], new: Sequence[Any]) -> list[Any]:
    """A list over another: rules of places add up, and later ones win; other lists stand for themselves.

    Args:
        key: one of `LISTS`.
        old: what is there.
        new: what comes over it; where that is empty, nothing is left.
    """
    if not new or key not in ("overrides", "planner.ranges"):
        return list(new)
    if key == "overrides":
        return [*old, *new]
    left = [piece for one in old for piece in _left_of(one, new)]
    return [*left, *new]


def _left_of(old: Any, new: Sequence[Any]) -> Iterator[Any]:
    """What a range still rules where later ones rule the same: itself, where they do not reach into it."""
    try:
        rules = {key: old[key] for key in _RANGE_KEYS if old.get(key)}
        holes = {key: [(one["low"], one["high"]) for one in new if one.get(key)] for key in rules}
        whole = all(high <= old["low"] or low >= old["high"] for key in holes for low, high in holes[key])
        pieces = {key: _without(old["low"], old["high"], holes[key]) for key in rules}
    except (AttributeError, KeyError, TypeError):  # no range, which will be refused by name
        whole = True
    if whole:
        yield old
        return
    for key, value in rules.items():
        yield from ({"low": low, "high": high, key: value} for low, high in pieces[key])


def _without(low: float, high: float, holes: Sequence[tuple[float, float]]) -> Iterator[tuple[float, float]]:
    """What is left of a stretch."""
    for begin, end in sorted(holes):
        if low < min(begin, high):
            yield low, min(begin, high)
        low = max(low, end)
    if low < high:
        yield low, high


def list_as_text(values: Sequence[Any]) -> str:
    """The text that `list_from_text` reads back."""
    if values and isinstance(values[0], Mapping) and "set" in values[0]:
        return overrides.as_text(values)
    if values and isinstance(values[0], Mapping):
        return "; ".join(_range_text(item) for item in values)
    return ", ".join(value if isinstance(value, str) else f"{value:.10g}" for value in values)


def _range_text(table: Mapping[str, float]) -> str:
    rules = "".join(f":{key}={table[key]:.10g}" for key in _RANGE_KEYS if table.get(key))
    return f"{table['low']:.10g}:{table['high']:.10g}{rules or ':tolerance=0'}"
