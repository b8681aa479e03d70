"""Split arcs (G2, G3) into chords as firmware does, so that simulated and modelled times agree."""

from __future__ import annotations

from collections.abc import Iterator
from math import atan2, ceil, cos, hypot, pi, sin, sqrt
from typing import Final

from printer_slicer.motion.blocks import Axes

__all__ = [
    "CHORDS_PER_TURN",
    "LONGEST_CHORD",
    "SHORTEST_CHORD",
    "find_centre_by_offset",
    "find_centre_by_radius",
    "split_arc",
]

LONGEST_CHORD: Final = 1.0
SHORTEST_CHORD: Final = 0.1
CHORDS_PER_TURN: Final = 72
"""Chords per turn; chords are limited to 0.1 to 1 mm. These are Marlin's defaults."""

Place = tuple[float, float]
"""Position in x and y, mm."""


def find_centre_by_offset(start: Place, i: float, j: float) -> Place | None:
    """Return the centre of an arc at (i, j) mm from its start; None if i and j are 0."""
    return (start[0] + i, start[1] + j) if i or j else None


def find_centre_by_radius(start: Place, goal: Place, radius: float, *, clockwise: bool) -> Place | None:
    """Return the centre of an arc of `radius` mm from start to goal; a negative radius selects the longer arc.

    None if start and goal are equal or the radius is 0.
    """
    dx, dy = goal[0] - start[0], goal[1] - start[1]
    chord = hypot(dx, dy)
    if chord == 0.0 or radius == 0.0:
        return None
    # The centre lies on the perpendicular of the chord.
    height = sqrt(max(radius * radius - chord * chord / 4.0, 0.0))
    side = height / chord * (1.0 if clockwise == (radius < 0.0) else -1.0)
    return start[0] + dx / 2.0 - dy * side, start[1] + dy / 2.0 + dx * side


def split_arc(start: Axes, goal: Axes, centre: Place, *, clockwise: bool) -> Iterator[Axes]:
    """Yield the end points of the chords of an arc; if start and goal are equal, the arc is a full circle."""
    ax, ay = start[0] - centre[0], start[1] - centre[1]
    radius = hypot(ax, ay)
    start_angle = atan2(ay, ax)
    sweep = (atan2(goal[1] - centre[1], goal[0] - centre[0]) - start_angle) % (2.0 * pi)
    if clockwise:
        sweep -= 2.0 * pi
    if sweep == 0.0:
        sweep = 2.0 * pi
    chord = min(max(radius * 2.0 * pi / CHORDS_PER_TURN, SHORTEST_CHORD), LONGEST_CHORD)
    pieces = max(1, ceil(radius * abs(sweep) / chord))
    for piece in range(1, pieces):
        share = piece / pieces
        angle = start_angle + share * sweep
        z, e = (start[k] + share * (goal[k] - start[k]) for k in (2, 3))
        yield centre[0] + radius * cos(angle), centre[1] + radius * sin(angle), z, e
    yield goal
