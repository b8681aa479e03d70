"""The shape of a bed as the rectangle that is printed on."""

from __future__ import annotations

import re
from math import hypot
from typing import Final, NamedTuple

from printer_slicer.importing.conversion import Conversion

__all__ = ["Bed", "bed_of"]

_NUMBER: Final = r"-?\d+(?:\.\d*)?(?:e-?\d+)?"
_POINT: Final = re.compile(rf"\s*({_NUMBER})\s*x\s*({_NUMBER})\s*", re.IGNORECASE)
_ROUND: Final = 0.02  # of the radius, by which corners of a round bed may differ
_Point = tuple[float, float]


class Bed(NamedTuple):
    """Front left and back right corner, mm, and what was made of the shape."""

    low: _Point
    high: _Point
    how: str = ""


def bed_of(made: Conversion) -> Bed:
    """The rectangle in a bed's outline.

    Raises:
        ProfileError: it is empty, no outline, or no rectangle can be had from it.
    """
    points = []
    for word in made.preset.raw("bed_shape").split(","):
        found = _POINT.fullmatch(word)
        if found is None:
            raise made.refuse(
                "bed_shape", f"{word.strip()[:30]!r} is no corner of a bed", "write 0x0,220x0,220x220,0x220"
            )
        points.append((float(found[1]), float(found[2])))
    xs, ys = [x for x, _ in points], [y for _, y in points]
    low, high = (min(xs), min(ys)), (max(xs), max(ys))
    size = (high[0] - low[0], high[1] - low[1])
    if len(points) < 3 or min(size) <= 0:
        raise made.refuse("bed_shape", "the bed is empty", "write its corners: 0x0,220x0,220x220,0x220")
    if _full(points, low, high):
        return Bed(low, high)
    middle = ((low[0] + high[0]) / 2, (low[1] + high[1]) / 2)
    radii = [hypot(x - middle[0], y - middle[1]) for x, y in points]
    if len(points) >= 8 and max(radii) - min(radii) <= _ROUND * max(radii):
        # A circle of another slicer's bed is drawn with corners: the square in it keeps within the least of them.
        half = min(radii) * 0.5**0.5
        how = f"the square in a round bed of {2 * max(radii):g} mm"
        return Bed(_moved(middle, -half), _moved(middle, half), how)
    made.warn(
        "bed_shape", "the bed is no rectangle: its bounding box is taken, keep parts out of what it lacks"
    )
    return Bed(low, high, "bounding box of another shape")


def _full(points: list[_Point], low: _Point, high: _Point) -> bool:
    """Whether the outline is its own bounding box."""
    turned = zip(points, points[1:] + points[:1], strict=True)
    area = abs(sum(a[0] * b[1] - a[1] * b[0] for a, b in turned)) / 2
    whole = (high[0] - low[0]) * (high[1] - low[1])
    return area >= 0.98 * whole


def _moved(middle: _Point, by: float) -> _Point:
    """A point moved by the same in both directions."""
    return round(middle[0] + by, 3), round(middle[1] + by, 3)
