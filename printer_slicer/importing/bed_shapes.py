"""Convert the outline of a bed to a rectangle."""

from __future__ import annotations

import re
from math import hypot
from typing import Final, NamedTuple

from printer_slicer.importing.conversion import Conversion

__all__ = ["BedRectangle", "find_rectangle"]

_NUMBER: Final = r"-?\d+(?:\.\d*)?(?:e-?\d+)?"
_POINT: Final = re.compile(rf"\s*({_NUMBER})\s*x\s*({_NUMBER})\s*", re.IGNORECASE)
_ROUND: Final = 0.02  # relative difference between the radii of a round bed's corners
_Point = tuple[float, float]


class BedRectangle(NamedTuple):
    """Front left and back right corner, mm, and how the outline was converted."""

    low: _Point
    high: _Point
    how: str = ""


def find_rectangle(made: Conversion) -> BedRectangle:
    """Return the rectangle for the outline of a bed.

    Raises:
        ProfileError: the outline is invalid or empty.
    """
    points = []
    for word in made.preset.raw("bed_shape").split(","):
        found = _POINT.fullmatch(word)
        if found is None:
            raise made.error(
                "bed_shape",
                f"{word.strip()[:30]!r} is not a corner",
                "Write corners as 0x0,220x0,220x220,0x220",
            )
        points.append((float(found[1]), float(found[2])))
    xs, ys = [x for x, _ in points], [y for _, y in points]
    low, high = (min(xs), min(ys)), (max(xs), max(ys))
    size = (high[0] - low[0], high[1] - low[1])
    if len(points) < 3 or min(size) <= 0:
        raise made.error("bed_shape", "the bed is empty", "Write its corners as 0x0,220x0,220x220,0x220")
    if _is_rectangle(points, low, high):
        return BedRectangle(low, high)
    middle = ((low[0] + high[0]) / 2, (low[1] + high[1]) / 2)
    radii = [hypot(x - middle[0], y - middle[1]) for x, y in points]
    if len(points) >= 8 and max(radii) - min(radii) <= _ROUND * max(radii):
        # Round beds are polygons: the square has to fit into the smallest radius.
        half = min(radii) * 0.5**0.5
        how = f"the square inside a round bed of {2 * max(radii):g} mm"
        return BedRectangle(_move(middle, -half), _move(middle, half), how)
    made.warn(
        "bed_shape",
        "the bed is not a rectangle: its bounding box is used; keep parts off the missing corners",
    )
    return BedRectangle(low, high, "bounding box of another shape")


def _is_rectangle(points: list[_Point], low: _Point, high: _Point) -> bool:
    """Return whether the outline fills its bounding box."""
    turned = zip(points, points[1:] + points[:1], strict=True)
    area = abs(sum(a[0] * b[1] - a[1] * b[0] for a, b in turned)) / 2
    whole = (high[0] - low[0]) * (high[1] - low[1])
    return area >= 0.98 * whole


def _move(middle: _Point, by: float) -> _Point:
    """Return a point moved by the same distance in x and y."""
    return round(middle[0] + by, 3), round(middle[1] + by, 3)
