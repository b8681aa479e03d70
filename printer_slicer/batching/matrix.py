"""Combinations of settings, and which rows of a table no other row beats."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from itertools import product
from typing import Any, Final, TypeVar

from printer_slicer.errors import UsageError

__all__ = ["COMPARED", "combine_choices", "find_unbeaten_rows", "name_choices", "parse_choices"]

COMPARED: Final = ("seconds", "max_error_mm", "volume_error_mm3")
"""Facts of which a plan should have little: print time, certified deviation and volume error."""

_Value = TypeVar("_Value")
_MAX_COMBINATIONS: Final = 10_000
_OUTER_COMMA: Final = re.compile(r",(?![^\[\]]*\])")
_UNSAFE: Final = re.compile(r"[^\w.+-]+")


def parse_choices(texts: Iterable[str]) -> dict[str, tuple[str, ...]]:
    """Parse texts such as `quality=draft,fine`; a list in brackets is one value.

    Raises:
        UsageError: a text is not KEY=VALUE,VALUE,..., or a key or a value occurs twice.
    """
    choices: dict[str, tuple[str, ...]] = {}
    for text in texts:
        key, equals, rest = text.partition("=")
        key, values = key.strip(), tuple(value.strip() for value in _OUTER_COMMA.split(rest))
        if not equals or not key or not all(values):
            raise UsageError(
                f"{text}: expected KEY=VALUE,VALUE", remedy="Write for example tolerance=0.02,0.05"
            )
        if key in choices or len(set(values)) < len(values):
            what = key if key in choices else next(one for one in values if values.count(one) > 1)
            raise UsageError(f"{text}: {what} is given twice", remedy="Remove one of them")
        choices[key] = values
    return choices


def combine_choices(choices: Mapping[str, Sequence[_Value]]) -> list[dict[str, _Value]]:
    """Return all combinations, one value of each key; a single empty one without choices.

    Raises:
        UsageError: there are too many.
    """
    count = 1
    for values in choices.values():
        count *= len(values)
    if count > _MAX_COMBINATIONS:
        raise UsageError(
            f"{count} combinations of settings; the most are {_MAX_COMBINATIONS}", remedy="Give fewer values"
        )
    return [dict(zip(choices, values, strict=True)) for values in product(*choices.values())]


def name_choices(choices: Mapping[str, str]) -> str:
    """Return a combination as a part of a file name, such as `quality-draft-tolerance-0.02`."""
    return "-".join(_UNSAFE.sub("_", f"{key.rpartition('.')[2]}-{value}") for key, value in choices.items())


def find_unbeaten_rows(rows: Sequence[Mapping[str, Any]]) -> list[bool]:
    """Return for each row whether no other row is at least as small in all of `COMPARED`, and smaller in one."""
    figures = [tuple(row[name] for name in COMPARED) for row in rows]
    return [
        not any(
            other != own and all(theirs <= mine for theirs, mine in zip(other, own, strict=True))
            for other in figures
        )
        for own in figures
    ]
