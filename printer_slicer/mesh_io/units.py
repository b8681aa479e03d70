"""Units of length in model files, and a guess of the unit if the size of a part is implausible."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Final

from printer_slicer.errors import MeshError, UsageError

if TYPE_CHECKING:
    from pathlib import Path

    from printer_slicer.arrays import Float

__all__ = ["UNITS", "UNIT_NAMES", "check_unit", "likely_unit", "parse_unit", "unit_advice"]

UNITS: Final[Mapping[str, float]] = {
    "mm": 1.0,
    "cm": 10.0,
    "m": 1000.0,
    "inch": 25.4,
    "foot": 304.8,
    "micron": 0.001,
}
"""Length of each unit, mm."""

UNIT_NAMES: Final[Mapping[str, str]] = {
    "mm": "millimetres",
    "cm": "centimetres",
    "m": "metres",
    "inch": "inches",
    "foot": "nearest_on_segments",
    "micron": "micrometres",
}

UNIT_ALIASES: Final[Mapping[str, str]] = {
    "millimeter": "mm",
    "millimeters": "mm",
    "centimeter": "cm",
    "centimeters": "cm",
    "meter": "m",
    "meters": "m",
    "inches": "inch",
    "feet": "foot",
    "microns": "micron",
}
"""Names of units in 3MF files."""

TINY: Final = 0.5
"""mm; a part this small is no larger than one extrusion and cannot be printed."""
SMALL: Final = 3.0
"""mm; the coordinates of a part up to this size are more likely in inches."""
SMALLEST_MEANT: Final = 1.0
"""mm; a guessed unit must make the part larger than this."""
THINNEST_MEANT: Final = 0.1
"""mm; a guessed unit must make every edge of the bounding box at least this long, else it cannot be printed."""
LARGEST_MEANT: Final = 2000.0
"""mm; maximum size if the printer is unknown; few beds are larger."""

SMALL_ORDER: Final = ("m", "inch", "cm", "foot", "mm")
"""Units to try for parts under TINY, most frequent first."""
INCH_ORDER: Final = ("inch", "cm", "m", "foot", "mm")
"""Units to try for parts between TINY and SMALL."""
LARGE_ORDER: Final = ("mm", "inch", "cm", "micron")
"""Units to try for parts that are too large, most frequent first."""


def check_unit(unit: str) -> str:
    """Check that a unit exists, and return it.

    Raises:
        UsageError: the unit is unknown.
    """
    if unit not in UNITS:
        raise UsageError(f"unknown unit {unit!r}", remedy=f"Use one of: {', '.join(UNITS)}")
    return unit


def parse_unit(name: str, path: Path) -> str:
    """Return the key in UNITS for the name of a unit in a file.

    Raises:
        MeshError: the unit is unknown.
    """
    unit = UNIT_ALIASES.get(name.strip().lower(), name.strip().lower())
    if unit not in UNITS:
        raise MeshError(
            f"{path}: unknown unit '{name[:40]}'",
            remedy=f"Give the unit with `units`: {', '.join(UNITS)}",
        )
    return unit


def likely_unit(size: Float, unit: str, room: Float | None = None) -> str:
    """Guess the unit of a file with an implausible size.

    A size is implausible if it is at most 0.5 mm along all axes, at most 3 mm (probably inches), or larger than the
    build volume. The guess is the most frequent unit that makes the part larger than 1 mm and all edges of its bounding
    box at least 0.1 mm long and no larger than the build volume.

    Args:
        size: (3,) edges of the part's bounding box, mm, as it was read.
        unit: the unit it was read with, a key in UNITS.
        room: (3,) build volume of the printer, mm; None: 2 m along each axis.

    Returns:
        A key in UNITS; empty if the size is plausible or no unit fits.
    """
    limits = [LARGEST_MEANT] * 3 if room is None else [float(length) for length in room]
    edges = [float(length) for length in size]
    too_small = _fits_in(edges, 1.0, limits)
    if too_small and max(edges) > SMALL:
        return ""
    small_order = SMALL_ORDER if max(edges) <= TINY else INCH_ORDER
    for other in small_order if too_small else LARGE_ORDER:
        factor = UNITS[other] / UNITS[unit]
        if factor == 1 or (factor > 1) != too_small:
            continue
        thick = max(edges) * factor >= SMALLEST_MEANT and min(edges) * factor >= THINNEST_MEANT
        if thick and _fits_in(edges, factor, limits):
            return other
    return ""


def _fits_in(edges: list[float], factor: float, room: list[float]) -> bool:
    """Return whether a bounding box, scaled by a factor, is no larger than `room`."""
    return all(edge * factor <= limit + 1e-6 for edge, limit in zip(edges, room, strict=True))


def unit_advice(size: Float, unit: str, room: Float | None = None, *, certain: bool = False) -> str:
    """Return a remedy for an implausible size; empty if the size is plausible or there is no remedy.

    Args:
        size: (3,) edges of the part's bounding box, mm, as it was read.
        unit: the unit it was read with, a key in UNITS.
        room: (3,) build volume of the printer, mm; None: 2 m along each axis.
        certain: whether the format states its unit, so that `units` is not allowed and `scale` is suggested instead.
    """
    other = likely_unit(size, unit, room)
    if not other:
        largest = max(float(length) for length in size)
        return "make it larger with `scale`" if largest <= TINY else ""
    made = " x ".join(f"{float(length) * UNITS[other] / UNITS[unit]:.4g}" for length in size)
    argument = f"scale={UNITS[other] / UNITS[unit]:g}" if certain else f'units="{other}"'
    return f"if the file is in {UNIT_NAMES[other]}, `{argument}` makes the part {made} mm"
