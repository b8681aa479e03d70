"""Reject parts with an island that gets no support."""

from __future__ import annotations

from printer_slicer.arrays import Float
from printer_slicer.errors import PartError
from printer_slicer.geometry import split_connected
from printer_slicer.model import Overhangs, Supports, UnsupportedPlace
from printer_slicer.texts import format_count

__all__ = ["list_unsupported_islands", "require_supported_islands"]

_WITHOUT_SUPPORTS = "there are no supports"


def list_unsupported_islands(overhangs: Overhangs, supports: Supports | None) -> tuple[UnsupportedPlace, ...]:
    """List the islands that get no support: none reaches them, they are blocked, or there are no supports."""
    if supports is not None:
        return (*(place for place in supports.unsupported if place.is_island), *overhangs.blocked)
    pieces = split_connected(overhangs.islands)
    low, high = pieces.areas.boxes()
    middle, size = ((low + high) / 2).tolist(), pieces.areas.area().tolist()
    z = overhangs.plan.bottom[pieces.layer].tolist()
    islands = tuple(
        UnsupportedPlace(x, y, height, area, _WITHOUT_SUPPORTS, is_island=True)
        for (x, y), height, area in zip(middle, z, size, strict=True)
    )
    return *islands, *overhangs.blocked


def require_supported_islands(
    name: str, overhangs: Overhangs | None, supports: Supports | None, shift: Float
) -> None:
    """Check that each island has a support.

    Args:
        name: of the part.
        overhangs: areas that need supports; None if that was not searched for.
        supports: None if there are none.
        shift: (3,) vector to the coordinates of the given mesh, mm.

    Raises:
        PartError: an island has none.
    """
    islands = list_unsupported_islands(overhangs, supports) if overhangs else ()
    if islands:
        first = min(islands, key=lambda place: place.z)
        x, y, z = (value + by for value, by in zip((first.x, first.y, first.z), shift.tolist(), strict=True))
        count = format_count(len(islands), "island")
        raise PartError(
            f"{name}: {count} without support, the lowest at x {x:.1f} y {y:.1f} z {z:.2f}: {first.reason}",
            remedy="Set support to auto, rotate the part, or leave out `strict_supports`",
        )
