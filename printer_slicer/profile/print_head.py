"""The outline of the print head at several heights above the nozzle, read from the texts of `printer.head`."""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, pi, sin
from typing import Final, NamedTuple

__all__ = ["HeadShape", "parse_head_shape"]

_CIRCLE_CORNERS: Final = 36


class HeadShape(NamedTuple):
    """A piece of the print head, or the gantry.

    Attributes:
        height: of its lower side above the tip of the nozzle, mm; it extends upward without end.
        corners: of its convex outline seen from above, mm from the nozzle, counter-clockwise.
    """

    height: float
    corners: tuple[tuple[float, float], ...]


def parse_head_shape(text: str) -> HeadShape:
    """Parse `HEIGHT: RADIUS`, or `HEIGHT: XxY XxY ...` with all corners or two opposite ones of a rectangle.

    A circle becomes the regular polygon around it, and a polygon its convex hull.
    """
    height, _, outline = text.partition(":")
    if "x" not in outline:
        return HeadShape(float(height), _make_polygon_around_circle(float(outline)))
    points = [(float(x), float(y)) for x, y in (corner.split("x") for corner in outline.split())]
    if len(points) == 2:
        (left, front), (right, back) = points
        points = [(left, front), (right, front), (right, back), (left, back)]
    return HeadShape(float(height), _find_convex_hull(points))


def _find_convex_hull(points: Sequence[tuple[float, float]]) -> tuple[tuple[float, float], ...]:
    """Return the corners of the convex hull of points, from the leftmost on; two corners if they are on a line."""
    ordered = sorted(set(points))
    halves = []
    for way in (ordered, ordered[::-1]):
        corners = list[tuple[float, float]]()
        for x, y in way:
            while len(corners) > 1 and not _turns_left(corners[-2], corners[-1], (x, y)):
                corners.pop()
            corners.append((x, y))
        halves.append(corners[:-1])
    return (*halves[0], *halves[1])


def _turns_left(before: tuple[float, float], at: tuple[float, float], after: tuple[float, float]) -> bool:
    """Return whether the way through three points turns left."""
    (ax, ay), (bx, by), (cx, cy) = before, at, after
    return (bx - ax) * (cy - by) > (by - ay) * (cx - bx)


def _make_polygon_around_circle(radius: float) -> tuple[tuple[float, float], ...]:
    """Return the corners of a regular polygon whose sides touch a circle around 0, 0."""
    reach = radius / cos(pi / _CIRCLE_CORNERS)
    angles = (2 * pi * k / _CIRCLE_CORNERS for k in range(_CIRCLE_CORNERS))
    return tuple((reach * cos(angle), reach * sin(angle)) for angle in angles)
