"""Settings that are lists, as people type them: `0.1, 0.2, 0.3` and `10:20:tolerance=0.05; 30:31:layer_height=0.1`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import Any

from printer_slicer.errors import ProfileError
from printer_slicer.profile import overrides

__all__ = ["list_as_text", "list_from_text"]

_RANGE_KEYS = ("tolerance", "layer_height")


def list_from_text(key: str, text: str) -> list[Any]:
    """The list that the text of a setting stands for; empty text is an empty list.

    Args:
        key: `layer_heights`, `overrides`, `pause_at`, `planner.ranges` or `thumbnails`.
        text: as in the heading of this module.

    Raises:
        ProfileError: it cannot be read so.
    """
    readers: Mapping[str, tuple[str, Callable[[str], Any], str]] = {
        "layer_heights": (",", float, "0.1, 0.2, 0.3"),
        "pause_at": (",", float, "4, 12.5"),
        "thumbnails": (",", str.strip, "32x32, 300x300/QOI"),
        "overrides": (";", overrides.from_text, "lid:infill_density=0.4; 5:10:perimeters=4"),
        "planner.ranges": (";", _range, "10:20:tolerance=0.05; 30:31:layer_height=0.1"),
    }
    separator, read, example = readers[key]
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
