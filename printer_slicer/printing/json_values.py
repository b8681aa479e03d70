"""Rebuild dataclasses from JSON with type checks, because the file may be damaged or from another version."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from functools import cache
from math import isnan
from types import NoneType, UnionType
from typing import Any, Literal, TypeVar, Union, cast, get_args, get_origin, get_type_hints

__all__ = ["dataclass_from_json"]

_Value = TypeVar("_Value")


@cache
def _hints(kind: Any) -> dict[str, Any]:
    return get_type_hints(kind)


def dataclass_from_json(kind: type[_Value], kept: object) -> _Value:
    """Rebuild a dataclass from what `dataclasses.asdict` and JSON made of it; unknown names are ignored.

    Raises:
        TypeError: a value has the wrong type; names it.
    """
    if not isinstance(kept, Mapping):
        raise TypeError(f"{kind.__name__} is {_shown(kept)}")
    hints = _hints(cast("Any", kind))
    known = [field.name for field in fields(cast("Any", kind)) if field.init and field.name in kept]
    return kind(**{name: _of(hints[name], kept[name], name) for name in known})


def _of(wanted: Any, kept: object, name: str) -> Any:
    """Rebuild the value of one field."""
    if is_dataclass(wanted) and isinstance(wanted, type):
        return dataclass_from_json(wanted, kept)
    if get_origin(wanted) in {Union, UnionType}:
        kinds = [kind for kind in get_args(wanted) if kind is not NoneType]
        return None if kept is None and NoneType in get_args(wanted) else _of(kinds[0], kept, name)
    if get_origin(wanted) is tuple and isinstance(kept, list | tuple):
        kinds = list(get_args(wanted))
        kinds = kinds[:1] * len(kept) if kinds[1:] == [Ellipsis] else kinds
        if len(kinds) == len(kept):
            return tuple(_of(kind, one, name) for kind, one in zip(kinds, kept, strict=True))
    elif get_origin(wanted) is not tuple and _is(wanted, kept):
        return kept
    raise TypeError(f"{name} is {_shown(kept)}")


def _is(wanted: Any, kept: object) -> bool:
    """Whether a plain value has the wanted type."""
    if get_origin(wanted) is Literal:
        return kept in get_args(wanted)
    if wanted is float:
        return isinstance(kept, float | int) and not isinstance(kept, bool) and not isnan(kept)
    if wanted is int:
        return isinstance(kept, int) and not isinstance(kept, bool)
    return isinstance(kept, get_origin(wanted) or wanted)


def _shown(kept: object) -> str:
    """Abbreviate a value for a message."""
    text = repr(kept)
    return text if len(text) <= 30 else f"{text[:27]}..."
