"""Check settings that do not come from a profile file, such as imported ones."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import msgspec

from printer_slicer.profile.checks import find_all_conflicts
from printer_slicer.profile.profile import Profile
from printer_slicer.profile.reading import KINDS

__all__ = ["find_value_conflicts", "find_value_fault"]


def find_value_fault(kind: str, values: Mapping[str, Any]) -> tuple[str, str] | None:
    """Return the key of the first invalid setting, and what is wrong with it; None if all settings are valid.

    Args:
        kind: `printer`, `material` or `quality`.
        values: the settings, nested as in a file.
    """
    try:
        msgspec.convert(values, KINDS[kind], strict=True)
    except msgspec.ValidationError as error:
        problem, _, where = str(error).partition(" - at `$")
        return where.rstrip("`").lstrip(".").partition("[")[0], problem.replace("`", "")
    return None


def find_value_conflicts(
    printer: Mapping[str, Any], material: Mapping[str, Any], quality: Mapping[str, Any]
) -> list[tuple[str, str, str]]:
    """Return the conflicts between settings of a printer, a material and a quality: (key, problem, remedy).

    Args:
        printer: valid settings, nested as in a file.
        material: likewise.
        quality: likewise.
    """
    parts = {"printer": printer, "material": material, "quality": quality}
    sections: dict[str, Any] = {kind: msgspec.convert(values, KINDS[kind]) for kind, values in parts.items()}
    profile = Profile(**sections)
    return [(one.key, one.problem, one.remedy) for one in find_all_conflicts(profile)]
