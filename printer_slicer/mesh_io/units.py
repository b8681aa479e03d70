"""Units of length in model files, and guessing the unit that was meant."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Final

from printer_slicer.errors import MeshError, UsageError

if TYPE_CHECKING:
    from pathlib import Path

    from printer_slicer.arrays import Float

__all__ = ["SPOKEN", "UNITS", "check_unit", "likely_unit", "parse_unit", "unit_advice"]

UNITS: Final[Mapping[str, float]] = {
    "mm": 1.0,
    "cm": 10.0,
    "m": 1000.0,
    "inch": 25.4,
    "foot": 304.8,
    "micron": 0.001,
}
"""mm in every unit."""

SPOKEN: Final[Mapping[str, str]] = {
    "mm": "millimetres",
    "cm": "centimetres",
    "m": "metres",
    "inch": "inches",
    "foot": "feet",
    "micron": "micrometres",
}

OTHER_NAMES: Final[Mapping[str, str]] = {
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
"""What 3MF files call them."""

TINY: Final = 0.5
"""mm; no nozzle prints a part that is nowhere larger than one bead."""
SMALL: Final = 3.0
"""mm; a part that is nowhere larger than this is more often one of that many inches."""
SMALLEST_MEANT: Final = 1.0
"""mm; nobody means a part that is nowhere larger than this."""
THINNEST_MEANT: Final = 0.1
"""mm; nobody means a part of which an edge is shorter: no nozzle prints that."""
LARGEST_MEANT: Final = 2000.0
"""mm; larger than the bed of any but the rarest printers; the limit where the printer is not known."""

SMALL_ORDER: Final = ("m", "inch", "cm", "foot", "mm")
"""How files come to be too small, the most frequent first, for parts under TINY."""
INCH_ORDER: Final = ("inch", "cm", "m", "foot", "mm")
"""The same between TINY and SMALL."""
LARGE_ORDER: Final = ("mm", "inch", "cm", "micron")
"""How files come to be too large, the most frequent first."""


def check_unit(unit: str) -> str:
    """The unit, if there is one of that name.

    Raises:
        UsageError: there is not.
    """
    if unit not in UNITS:
        raise UsageError(f"unknown unit {unit!r}", remedy=f"Use one of: {', '.join(UNITS)}")
    return unit


def parse_unit(name: str, path: Path) -> str:
    """The key in UNITS of a unit as a file names it.

    Raises:
        MeshError: no such unit.
    """
    unit = OTHER_NAMES.get(name.strip().lower(), name.strip().lower())
    if unit not in UNITS:
        raise MeshError(
            f"{path}: unknown unit '{name[:40]}'",
            remedy=f"Give the unit with --units: {', '.join(UNITS)}",
        )
    return unit


def likely_unit(size: Float, unit: str, room: Float | None = None) -> str:
    """The unit that the numbers of a file were probably meant in.

    A part that extends at most 0.5 mm in x, y and z is doubted, as is one of at most 3 mm, which is taken for inches
    first, and one that does not fit the room. The guess is the first unit, in the order in which such files are seen,
    that makes the part larger than 1 mm, no edge of its envelope shorter than 0.1 mm, and all smaller than the room.

    Args:
        size: (3,) edges of the part's envelope, mm, as it was read.
        unit: the key in UNITS that it was read with.
        room: (3,) what the printer prints, mm; None: 2 m each way.

    Returns:
        A key in UNITS, or an empty text when the size is nothing to doubt, or no unit would make sense.
    """
    limits = [LARGEST_MEANT] * 3 if room is None else [float(length) for length in room]
    edges = [float(length) for length in size]
    too_small = _fits(edges, 1.0, limits)
    if too_small and max(edges) > SMALL:
        return ""
    small_order = SMALL_ORDER if max(edges) <= TINY else INCH_ORDER
    for other in small_order if too_small else LARGE_ORDER:
        factor = UNITS[other] / UNITS[unit]
        if factor == 1 or (factor > 1) != too_small:
            continue
        thick = max(edges) * factor >= SMALLEST_MEANT and min(edges) * factor >= THINNEST_MEANT
        if thick and _fits(edges, factor, limits):
            return other
    return ""


def _fits(edges: list[float], factor: float, room: list[float]) -> bool:
    return all(edge * factor <= limit + 1e-6 for edge, limit in zip(edges, room, strict=True))


def unit_advice(size: Float, unit: str, room: Float | None = None, *, certain: bool = False) -> str:
    """What to do about a part of doubtful size; empty when there is nothing to doubt, or nothing to advise.

    Args:
        size: (3,) edges of the part's envelope, mm, as it was read.
        unit: the key in UNITS that it was read with.
        room: (3,) what the printer prints, mm; None: 2 m each way.
        certain: whether the file says itself what its numbers mean and --units is refused for it.
    """
    other = likely_unit(size, unit, room)
    if not other:
        largest = max(float(length) for length in size)
        return "make it larger with --scale" if largest <= TINY else ""
    made = " x ".join(f"{float(length) * UNITS[other] / UNITS[unit]:.4g}" for length in size)
    flag = f"--scale {UNITS[other] / UNITS[unit]:g}" if certain else f"--units {other}"
    return f"were the numbers of the file meant in {SPOKEN[other]}? {flag} makes it {made} mm"
