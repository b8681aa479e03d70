"""Warnings, facts and errors of `slice` about unsupported extrusion."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from printer_slicer.errors import PartError
from printer_slicer.inspection.deposition.unsupported import Unsupported, describe

__all__ = ["refuse_unsupported", "unsupported_facts", "unsupported_warnings"]

_REMEDY = "turn the part or add supports; `print` needs --allow unsupported"


def unsupported_warnings(found: Sequence[Unsupported]) -> list[str]:
    """Return a warning if anything was found."""
    return [f"{describe(found)}; {_REMEDY}"] if found else []


def unsupported_facts(found: Sequence[Unsupported]) -> list[dict[str, Any]]:
    """Return facts for JSON: one entry per height, lengths in mm."""
    return [
        {
            "code": "unsupported",
            "severity": "warning",
            "layer": one.layer,
            "z": round(one.z, 4),
            "x": round(one.x, 3),
            "y": round(one.y, 3),
            "length_mm": round(one.length, 3),
        }
        for one in found
    ]


def refuse_unsupported(name: str, found: Sequence[Unsupported]) -> None:
    """Fail if anything was found, for --strict without --allow unsupported.

    Raises:
        PartError: there is unsupported extrusion.
    """
    if found:
        raise PartError(
            f"{name}: {describe(found)}",
            remedy="turn the part, add supports, or --allow unsupported; without --strict this is only a warning",
        )
