"""What `slice` says about extrusion that nothing holds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from printer_slicer.deposition import Unsupported, describe
from printer_slicer.errors import PartError

__all__ = ["refuse_unsupported", "unsupported_facts", "unsupported_warnings"]

_REMEDY = "turn the part, or add supports; `print` refuses it without --allow unsupported"


def unsupported_warnings(found: Sequence[Unsupported]) -> list[str]:
    """For people: nothing where nothing was found."""
    return [f"{describe(found)}: it falls; {_REMEDY}"] if found else []


def unsupported_facts(found: Sequence[Unsupported]) -> list[dict[str, Any]]:
    """For JSON: one entry for each height, lengths in mm."""
    return [
        {
            "layer": one.layer,
            "z": round(one.z, 4),
            "x": round(one.x, 3),
            "y": round(one.y, 3),
            "length_mm": round(one.length, 3),
        }
        for one in found
    ]


def refuse_unsupported(name: str, found: Sequence[Unsupported]) -> None:
    """For --strict.

    Raises:
        PartError: something was found.
    """
    if found:
        raise PartError(
            f"{name}: {describe(found)}",
            remedy="turn the part, or add supports; without --strict it is only a warning",
        )
