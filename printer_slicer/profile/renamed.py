"""Former names of settings: they work for one release, and a warning names the present one."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from typing import Any, Final

__all__ = ["RENAMED", "current_name", "current_names", "overridden", "warn_of"]

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
"""Former name of a setting -> present name, both without their section."""

_SECTIONS: Final = ("printer.", "quality.")


def current_name(key: str) -> str:
    """Return the present name of a setting; a key with any other name is returned as it is."""
    section = next((one for one in _SECTIONS if key.startswith(one)), "")
    name = key.removeprefix(section)
    return section + RENAMED.get(name, name)


def current_names(values: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Return the same settings with present names; a present name wins over the former one.

    Args:
        values: settings of one section; tables are nested.
        prefix: the table that they are, with a dot.
    """
    result: dict[str, Any] = {}
    for key, value in values.items():
        new = current_name(prefix + key).removeprefix(prefix)
        if new != key and new in values:
            continue
        result[new] = _inside(prefix + key, value)
    return result


def _inside(key: str, value: Any) -> Any:
    """Return a value with present names in its tables and overrides."""
    if isinstance(value, dict):
        return current_names(value, f"{key}.")
    if key == "overrides" and isinstance(value, list):
        return [_override(one) for one in value]
    return value


def overridden(values: Mapping[str, Any]) -> list[str]:
    """Return the settings that the overrides of a section change, as they are written."""
    tables = values.get("overrides")
    changes = [one.get("set") for one in tables if isinstance(one, dict)] if isinstance(tables, list) else []
    return [key for one in changes if isinstance(one, dict) for key in one]


def _override(table: Any) -> Any:
    """Return an override with present names."""
    if isinstance(table, dict) and isinstance(changes := table.get("set"), dict):
        return {**table, "set": {current_name(key): value for key, value in changes.items()}}
    return table


def warn_of(key: str, place: str = "") -> str:
    """Return the present name of a setting, with a warning if the key is a former one.

    Args:
        key: as somebody wrote it.
        place: where, for the warning: a file with a line, or an override.
    """
    new = current_name(key)
    if new != key:
        warnings.warn(
            f"{place}{': ' if place else ''}{key} is now called {new}; the former name works in this release only",
            FutureWarning,
            stacklevel=2,
        )
    return new
