"""Cut off corners that are so sharp that an extrusion would overlap itself."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Float, Int
from printer_slicer.geometry.areas import Areas
from printer_slicer.geometry.polylines import Polylines
from printer_slicer.geometry.ring_queries import crosses_rings, find_enclosing_rings
from printer_slicer.values import Struct

__all__ = ["cut_sharp_corners", "reach_of_corner"]

_SHARP = -0.1  # cosine of the angle between the legs; right angles count as sharp
_INSIDE = 1e-3  # fraction of a chord to leave out at both ends, which may lie on the outline


def reach_of_corner(cosine: Float, apart: float) -> Float:
    """Return the distance from a corner, mm, at which the two legs are `apart` mm from each other.

    Args:
        cosine: cosine of the angle between the legs.
        apart: distance between the legs, mm.
    """
    half_sine = np.sqrt(np.maximum(1 - cosine, 1e-6) / 2)
    return apart / (2 * half_sine)


def cut_sharp_corners(lines: Polylines, corners: Int, areas: Areas, apart: float) -> Polylines:
    """Cut off sharp corners of open lines where their legs are `apart` mm from each other.

    A cut reaches at most halfway to the next sharp corner, or up to the end of the line. A corner stays if the shortcut
    would leave the areas.

    Args:
        lines: lines without repeated points.
        corners: (C,) points of the lines that may be cut off, ascending.
        areas: the areas in which the lines lie.
        apart: distance between the legs at the cut, mm.
    """
    cuts = _find_cuts(lines, corners, apart)
    first, last = cuts.points_at(cuts.begin), cuts.points_at(cuts.end)
    inset, layer = _INSIDE * (last - first), lines.layer[cuts.line]
    # At a corner that points into the areas the shortcut crosses no outline, but lies outside from end to end.
    ring = find_enclosing_rings(areas, (first + last) / 2, layer)
    inside = np.append(areas.ring_area() > 0, False)[ring]
    free = np.flatnonzero(inside & ~crosses_rings(areas, first + inset, last - inset, layer))
    return cuts.take(free).apply() if len(free) else lines


class _Cuts(Struct, frozen=True, eq=False):
    """Parts to cut out of lines; positions are measured along all lines laid end to end with gaps of 1 mm.

    Attributes:
        lines: lines without repeated points.
        place: (N,) mm, position of each point.
        line: (C,) line of each cut.
        begin, end: (C,) mm, positions of each cut, ascending.
    """

    lines: Polylines
    place: Float
    line: Int
    begin: Float
    end: Float

    def take(self, chosen: Int) -> _Cuts:
        """Return the cuts with the given indices."""
        return _Cuts(self.lines, self.place, self.line[chosen], self.begin[chosen], self.end[chosen])

    def points_at(self, place: Float) -> Float:
        """Return the (C, 2) points at these positions, mm."""
        return np.stack([np.interp(place, self.place, axis) for axis in self.lines.xy.T], axis=1)

    def apply(self) -> Polylines:
        """Return the lines with the cuts applied."""
        lines = self.lines
        owner = np.repeat(np.arange(lines.n_lines), lines.size)
        cut = np.searchsorted(self.begin, self.place, side="right") - 1
        kept = np.flatnonzero((cut < 0) | (self.place > self.end[cut]))
        order = np.argsort(np.concatenate([self.place[kept], self.begin, self.end]), kind="stable")
        xy = np.concatenate([lines.xy[kept], self.points_at(self.begin), self.points_at(self.end)])
        size = np.bincount(np.concatenate([owner[kept], self.line, self.line]), minlength=lines.n_lines)
        return Polylines.of(xy[order], size, lines.layer).without_repeats()[0]


def _find_cuts(lines: Polylines, corners: Int, apart: float) -> _Cuts:
    """Find the cuts at all sharp corners."""
    xy, start = lines.xy, lines.start
    owner = np.repeat(np.arange(lines.n_lines), lines.size)
    corners = corners[(corners != start[owner[corners]]) & (corners != start[owner[corners] + 1] - 1)]
    step = np.diff(xy, axis=0, append=xy[-1:])
    step[start[1:] - 1] = 0.0
    long = np.hypot(*step.T)
    place = np.cumsum(long) - long + owner
    cosine = -(step[corners - 1] * step[corners]).sum(axis=1) / (long[corners - 1] * long[corners])
    sharp = cosine > _SHARP
    corners, reach = corners[sharp], reach_of_corner(cosine[sharp], apart)
    line, middle = owner[corners], (place[corners][1:] + place[corners][:-1]) / 2
    alone = np.diff(line, prepend=-1, append=-1) != 0
    low = np.where(alone[:-1], place[start[:-1]][line], np.append(0.0, middle)[: len(line)])
    high = np.where(alone[1:], place[start[1:] - 1][line], np.append(middle, 0.0)[: len(line)])
    begin, end = np.maximum(place[corners] - reach, low), np.minimum(place[corners] + reach, high)
    return _Cuts(lines, place, line, begin, end)
