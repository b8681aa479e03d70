"""All settings as rows of a table, for help, documents and messages."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from functools import cache
from typing import Any, Final, NamedTuple

import msgspec
from msgspec import inspect

from printer_slicer.profile.lists import format_list
from printer_slicer.profile.reading import KINDS

__all__ = [
    "RATIO_UNITS",
    "SettingRow",
    "accepts_form",
    "find_choices",
    "find_settings",
    "is_ratio",
    "list_setting_definitions",
    "list_setting_rows",
]

_SIGNS: Final[Mapping[str, str]] = {"ge": ">=", "gt": ">", "le": "<=", "lt": "<"}


RATIO_UNITS: Final = ("0-1", "ratio")
"""Units of settings whose values can be written as percentages."""


class SettingRow(NamedTuple):
    """The description of one setting.

    Attributes:
        key: dotted key with the section.
        type: name of the type.
        unit: unit; empty if there is none.
        bounds: bounds of a number, or the choices.
        default: text of the default.
        meaning: phrase that explains the setting.
        own: `OBJECT`, `HEIGHT` or both, if it can be overridden for objects or for height ranges.
    """

    key: str
    type: str
    unit: str
    bounds: str
    default: str
    meaning: str
    own: tuple[str, ...] = ()

    @property
    def choices(self) -> str:
        """The choices, separated by commas; empty for settings without choices."""
        return self.bounds.replace(" |", ",") if self.type == "literal" else ""


def find_settings(*words: str) -> list[SettingRow]:
    """Return the settings whose key or meaning contains all words; without words, all settings.

    Args:
        *words: words in any case, such as "infill".
    """
    lower = [word.lower() for word in words]
    return [
        row
        for row in list_setting_definitions()
        if all(word in f"{row.key} {row.meaning}".lower() for word in lower)
    ]


def list_setting_definitions() -> Iterator[SettingRow]:
    """Yield one row for each setting, in the order of definition.

    Keys are such as `quality.perimeters` and, for a planner, `quality.planner[optimal].ranges`.
    """
    for kind, struct in KINDS.items():
        yield from list_setting_rows(struct, kind)


def list_setting_rows(struct: type[msgspec.Struct], prefix: str) -> Iterator[SettingRow]:
    """Yield the rows of a group of settings and its subgroups."""
    info = inspect.type_info(struct)
    assert isinstance(info, inspect.StructType)
    for entry in info.fields:
        key = f"{prefix}.{entry.encode_name}".lstrip(".")
        nested = entry.type.types if isinstance(entry.type, inspect.UnionType) else (entry.type,)
        groups = [one for one in nested if isinstance(one, inspect.StructType)]
        if len(groups) < len(nested):
            yield _make_row(key, entry)
            continue
        if len(groups) > 1:
            kinds = " | ".join(str(one.tag) for one in groups)
            meaning = "layer-height algorithm; settings of the other algorithms are rejected"
            yield SettingRow(f"{key}.kind", "literal", "", kinds, "optimal", meaning)
        for one in groups:
            yield from list_setting_rows(one.cls, f"{key}[{one.tag}]" if one.tag else key)


def _make_row(key: str, entry: inspect.Field) -> SettingRow:
    """Make the row of a setting from its definition."""
    kind, unit, meaning, own = entry.type, "", "", ()
    if isinstance(kind, inspect.Metadata):
        unit, own = (kind.extra or {}).get("unit", ""), (kind.extra or {}).get("own", ())
        meaning = str((kind.extra_json_schema or {}).get("description", ""))
        kind = kind.type
    bounds = [
        f"{sign} {getattr(kind, name):g}"
        for name, sign in _SIGNS.items()
        if getattr(kind, name, None) is not None
    ]
    if isinstance(kind, inspect.LiteralType):
        bounds = [" | ".join(map(str, kind.values))]
    name = "list" if isinstance(kind, inspect.VarTupleType) else type(kind).__name__.removesuffix("Type")
    return SettingRow(key, name.lower(), unit, ", ".join(bounds), _format_default(entry), meaning, own)


def _format_default(entry: inspect.Field) -> str:
    """Format the default of a setting; `required` if there is none."""
    value: Any = entry.default
    if value is msgspec.NODEFAULT:
        return "required"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple):
        return format_list(value) or "empty"
    return str(value) or "empty"


def is_ratio(key: str) -> bool:
    """Return whether a setting, with or without its section, is a ratio, which can be written as a percentage."""
    row = _map_keys_to_rows().get(key)
    return row is not None and row.unit in RATIO_UNITS


def accepts_form(key: str, text: str) -> bool:
    """Return whether a setting accepts a value: percentages only for ratios, words only from the choices.

    Args:
        key: the setting, with or without its section.
        text: the value.
    """
    if text.endswith("%"):
        return is_ratio(key)
    row = _map_keys_to_rows().get(key) if text.isidentifier() else None
    return row is None or not row.choices or text in row.choices.split(", ")


@cache
def _map_keys_to_rows() -> Mapping[str, SettingRow]:
    """Map keys, with and without section, to their rows; keys without section refer to qualities first."""
    rows = {re.sub(r"\[\w+\]", "", row.key): row for row in list_setting_definitions()}
    return {key.partition(".")[2]: row for key, row in rows.items()} | rows


def find_choices(struct: type[msgspec.Struct], path: str) -> str:
    """Return the choices of a setting, separated by commas; empty for settings without choices."""
    return _map_paths_to_choices(struct).get(path, "")


@cache
def _map_paths_to_choices(struct: type[msgspec.Struct]) -> Mapping[str, str]:
    """Map the paths of settings in a section to their choices."""
    return {re.sub(r"\[\w+\]", "", row.key): row.choices for row in list_setting_rows(struct, "")}
