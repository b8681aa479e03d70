"""What is wrong with one part of a profile that does not come from a file of ours."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import msgspec

from printer_slicer.profile.checks import conflicts
from printer_slicer.profile.profile import Profile
from printer_slicer.profile.reading import KINDS

__all__ = ["fault_in", "faults_together"]


def fault_in(kind: str, values: Mapping[str, Any]) -> tuple[str, str] | None:
    """The setting that is out of its bounds or of the wrong type, and what is wrong; None: all are good.

    Args:
        kind: `printer`, `material` or `quality`.
        values: the settings that are set, nested as in a file.
    """
    try:
        msgspec.convert(values, KINDS[kind], strict=True)
    except msgspec.ValidationError as error:
        problem, _, where = str(error).partition(" - at `$")
        return where.rstrip("`").lstrip(".").partition("[")[0], problem.replace("`", "")
    return None


def faults_together(
    printer: Mapping[str, Any], material: Mapping[str, Any], quality: Mapping[str, Any]
) -> list[tuple[str, str, str]]:
    """What three parts, each good for itself, contradict each other in: (key, problem, remedy).

    Args:
        printer: the settings that are set, nested as in a file.
        material: likewise.
        quality: likewise.
    """
    parts = {"printer": printer, "material": material, "quality": quality}
    made: dict[str, Any] = {kind: msgspec.convert(values, KINDS[kind]) for kind, values in parts.items()}
    profile = Profile(**made)
    return [(one.key, one.problem, one.remedy) for one in conflicts(profile)]
