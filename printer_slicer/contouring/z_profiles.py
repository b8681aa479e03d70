"""The z of the nozzle along paths: smoothed, without steep changes, and with few points."""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, previous_in_ring, run_starts
from printer_slicer.values import Struct

__all__ = [
    "MAX_CHANGE",
    "Z_TOLERANCE",
    "Positions",
    "fill_short_dips",
    "find_edges_of_dips",
    "find_needed_points",
    "limit_changes",
    "smooth",
]

_SMOOTHED_LENGTH: Final = 0.25  # mm of path over which z is averaged
MAX_CHANGE: Final = float(np.tan(np.deg2rad(20.0)))
"""Maximum change of z, mm per mm of path."""
_SHORTEST: Final = 1e-6  # mm
Z_TOLERANCE: Final = 0.01
"""mm by which z may differ from that of points that are left out."""
_GAP: Final = 100.0  # mm; apart enough that no path has an influence on the next one


class Positions(Struct, frozen=True, eq=False):
    """Positions of the points of paths along one common line, on which all paths follow each other with gaps.

    Attributes:
        along: (N,) mm, ascending.
        begin: (M,) position at which each path begins, mm.
        length: (M,) of each path, mm; of a closed one with the way back to its first point.
        closed: (M,) whether the path returns to its first point.
        start: (M + 1,) index of the first point of each path.
    """

    along: Float
    begin: Float
    length: Float
    closed: Bool
    start: Int

    @classmethod
    def from_steps(cls, step: Float, start: Int, closed: Bool) -> Positions:
        """Return the positions from the distance (N,) of each point to the next one, mm."""
        walked = np.append(0.0, np.cumsum(step))
        begin = walked[start[:-1]] + _GAP * np.arange(len(closed))
        along = walked[:-1] + np.repeat(_GAP * np.arange(len(closed)), np.diff(start))
        return cls(along, begin, np.diff(walked[start]), closed, start)

    @property
    def owner(self) -> Int:
        """Path (N,) of each point."""
        return np.repeat(np.arange(len(self.closed)), np.diff(self.start))

    def list_knots(self) -> tuple[Int, Float]:
        """Return the points of each path and then its end, as indices of points, and the positions of both (K,), mm.

        A closed path ends with its first point.
        """
        first, last = self.start[:-1], self.start[1:] - 1
        order = np.insert(np.arange(len(self.along)), self.start[1:], np.where(self.closed, first, last))
        return order, np.insert(self.along, self.start[1:], self.begin + self.length)


def smooth(z: Float, positions: Positions, point: Int) -> Float:
    """Average z over a length of path around some points; at the ends of open paths over less.

    Args:
        z: (N,) mm.
        positions: of all points.
        point: (n,) the points at which the average is asked for.

    Returns:
        (n,) mm.
    """
    owner = positions.owner[point]
    begin, length, closed = positions.begin[owner], positions.length[owner], positions.closed[owner]
    within = positions.along[point] - begin
    to_end = np.where(closed, length / 2, np.minimum(within, length - within))
    reach = np.clip(to_end, 0.0, _SMOOTHED_LENGTH / 2)
    order, knot = positions.list_knots()
    known, n_paths = z[order], len(positions.closed)
    areas = (known[1:] + known[:-1]) / 2 * np.diff(knot)
    areas[positions.start[1:-1] + np.arange(n_paths - 1)] = 0.0  # between paths
    total = np.append(0.0, np.cumsum(areas))
    first = positions.start + np.append(np.arange(n_paths), n_paths)
    whole = (total[first[1:] - 1] - total[first[:-1]])[owner]

    def integrate(along: Float) -> Float:
        """Return the integral of z up to positions (n,) on their paths; loops continue beyond their ends."""
        turns = np.where(closed & (length > 0), np.floor(along / np.maximum(length, 1e-12)), 0.0)
        place = np.clip(begin + along - turns * length, begin, begin + length)
        at = np.clip(np.searchsorted(knot, place, side="right") - 1, 0, len(knot) - 2)
        beyond = place - knot[at]
        change = (known[at + 1] - known[at]) / np.maximum(knot[at + 1] - knot[at], 1e-12)
        return np.asarray(total[at] + (known[at] + change * beyond / 2) * beyond + turns * whole)

    mean = (integrate(within + reach) - integrate(within - reach)) / np.maximum(2 * reach, 1e-12)
    return np.where(reach > _SHORTEST, mean, z[point])


def limit_changes(z: Float, positions: Positions) -> Float:
    """Raise z (N,) as little as necessary, so that it changes by at most `MAX_CHANGE` per mm of path."""
    rising = MAX_CHANGE * positions.along
    first, last, closed = positions.start[:-1], positions.start[1:] - 1, positions.closed
    gap = MAX_CHANGE * (positions.begin + positions.length - positions.along[last])
    for around in (False, True):
        z = z.copy()
        if around:
            z[last] = np.where(closed, np.maximum(z[last], z[first] - gap), z[last])
            z = np.maximum.accumulate((z - rising)[::-1])[::-1] + rising
            z[last] = np.where(closed, np.maximum(z[last], z[first] - gap), z[last])
            z = np.maximum.accumulate((z - rising)[::-1])[::-1] + rising
        else:
            z = np.maximum.accumulate(z + rising) - rising
            z[first] = np.where(closed, np.maximum(z[first], z[last] - gap), z[first])
            z = np.maximum.accumulate(z + rising) - rising
    return z


def fill_short_dips(z: Float, positions: Positions, shortest: float) -> Float:
    """Raise z (N,) to 0 in dips between two places where it is 0, if their bottom is shorter than `shortest` mm.

    The nozzle does not reach into such a dip without touching both of its sides. Dips that end with an open path stay.
    """
    low, first, last = z < 0, positions.start[:-1], positions.start[1:] - 1
    previous, owner = previous_in_ring(positions.start), positions.owner
    step = np.append(np.diff(positions.along), 0.0)
    step[last] = positions.begin + positions.length - positions.along[last]
    before = low[previous]
    before[first] |= ~positions.closed
    begins = low & ~before
    number = np.cumsum(begins)
    none_yet: Bool = number == (number[first] - begins[first])[owner]
    # What is low at the start of a loop belongs to its last dip.
    number = np.where(none_yet, np.where(positions.closed, number[last], 0)[owner], number)
    whole: Bool = none_yet & (number == (np.cumsum(begins)[first] - begins[first])[owner])
    number[whole | ~low] = 0
    length = np.bincount(number, step, minlength=int(begins.sum()) + 1)
    length += np.bincount(number[begins], step[previous[begins]], minlength=len(length))
    deepest = np.zeros(len(length))
    np.minimum.at(deepest, number, z)
    short = length + 2 * deepest / MAX_CHANGE < shortest  # without the steepest possible sides
    short[0] = False
    short[number[last[low[last] & ~positions.closed]]] = False
    return np.where(short[number], 0.0, z)


def find_edges_of_dips(z: Float, start: Int) -> Bool:
    """Return at which points (N,) of paths z (N,) is 0, and lower at the next or the previous point."""
    low, previous = z < 0, previous_in_ring(start)
    beside = low[previous]
    beside[previous[low]] = True
    return np.asarray(beside & ~low)


def find_needed_points(z: Float, positions: Positions, is_corner: Bool) -> Bool:
    """Return which points (N,) are corners or needed for z.

    Points between two that are kept differ by at most a tolerance from the line through these.

    Args:
        z: (N,) mm.
        positions: of the points; all of a path that are no corners lie on the straight lines between its corners.
        is_corner: (N,) whether a point must be kept; the first points of all paths are.
    """
    point, knot = positions.list_knots()
    n_paths = len(positions.closed)
    kept = is_corner[point]
    kept[positions.start[1:] + np.arange(n_paths)] = True
    known = z[point]
    active = np.flatnonzero(~kept)
    while len(active):
        number = np.flatnonzero(kept)
        right = np.searchsorted(number, active)
        left, right = number[right - 1], number[right]
        share = (knot[active] - knot[left]) / np.maximum(knot[right] - knot[left], 1e-12)
        error = np.abs(known[active] - known[left] - share * (known[right] - known[left]))
        begins = np.flatnonzero(run_starts(left))
        size = np.diff(np.append(begins, len(active)))
        worst = np.repeat(np.maximum.reduceat(error, begins), size)
        hits = np.flatnonzero((error == worst) & (worst > Z_TOLERANCE))
        kept[active[hits[run_starts(left[hits])]]] = True
        active = active[(worst > Z_TOLERANCE) & ~kept[active]]
    result = np.zeros(len(z), np.bool_)
    result[point[kept]] = True
    return result
