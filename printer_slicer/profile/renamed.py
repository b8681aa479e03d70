"""Former names of settings: they work for one release, with a warning that gives the current name."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import Any, Final

__all__ = [
    "RENAMED",
    "find_current_name",
    "list_override_keys",
    "replace_former_name",
    "replace_former_names",
]

_ROLES: Final[Mapping[str, str]] = {
    "outer_perimeter": "external_perimeter",
    "inner_perimeter": "perimeter",
    "sparse": "internal_infill",
    "solid": "solid_infill",
    "top_skin": "top_solid_infill",
}

RENAMED: Final[Mapping[str, str]] = {
    **{f"speeds.{old}": f"speeds.{new}" for old, new in (*_ROLES.items(), ("gap", "gap_fill"))},
    **{f"accelerations.{old}": f"accelerations.{new}" for old, new in _ROLES.items()},
    "outer_perimeter_first": "external_perimeter_first",
    "inner_perimeters_every": "perimeters_every",
    "sparse_every": "internal_infill_every",
    "sparse_overlap": "internal_infill_overlap",
    "min_sparse_area": "solid_infill_below_area",
}
"""Former name of a setting -> current name, both without their section."""

_SECTIONS: Final = ("printer.", "quality.")


def find_current_name(key: str) -> str:
    """Return the current name of a setting; keys that are not former names are returned unchanged."""
    section = next((one for one in _SECTIONS if key.startswith(one)), "")
    name = key.removeprefix(section)
    return section + RENAMED.get(name, name)


def replace_former_names(values: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Rename settings from former to current names; if both names of a setting occur, the current name counts.

    Args:
        values: settings of one section; tables are nested.
        prefix: the dotted key of the table that contains the values, with a trailing dot; empty for a section.
    """
    result: dict[str, Any] = {}
    for key, value in values.items():
        new = find_current_name(prefix + key).removeprefix(prefix)
        if new != key and new in values:
            continue
        result[new] = _replace_nested_names(prefix + key, value)
    return result


def _replace_nested_names(key: str, value: Any) -> Any:
    """Replace former names of settings by current ones, in the tables and overrides inside a value."""
    if isinstance(value, dict):
        return replace_former_names(value, f"{key}.")
    if key == "overrides" and isinstance(value, list):
        return [_replace_names_in_override(one) for one in value]
    return value


def list_override_keys(values: Mapping[str, Any]) -> list[str]:
    """Return the keys of the settings in the overrides of a section, as written."""
    tables = values.get("overrides")
    changes = [one.get("set") for one in tables if isinstance(one, dict)] if isinstance(tables, list) else []
    return [key for one in changes if isinstance(one, dict) for key in one]


def _replace_names_in_override(table: Any) -> Any:
    """Replace former names of settings in an override by current ones; return the new override."""
    if isinstance(table, dict) and isinstance(changes := table.get("set"), dict):
        return {**table, "set": {find_current_name(key): value for key, value in changes.items()}}
    return table


def replace_former_name(key: str, place: str = "") -> str:
    """Return the current name of a setting, and warn if the key is a former name.

    Args:
        key: the key as written.
        place: where it is written, for the warning: a file with a line, or an override.
    """
    new = find_current_name(key)
    if new != key:
        warnings.warn(
            f"{place}{': ' if place else ''}{key} is now called {new}; the former name works in this release only",
            FutureWarning,
            stacklevel=2,
        )
    return new
