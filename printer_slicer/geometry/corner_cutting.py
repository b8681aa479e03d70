"""Cut off corners so sharp that an extrusion would overlap itself."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from printer_slicer.arrays import Float, Int
from printer_slicer.geometry.areas import Areas
from printer_slicer.geometry.polylines import Polylines
from printer_slicer.geometry.ring_queries import crossed, find_enclosing_rings

__all__ = ["cut_sharp_corners", "reach_of_corner"]

_SHARP = -0.1  # cosine of the angle inside: right ones are sharp
_INSIDE = 1e-3  # of a chord: its ends may lie on the outline


def reach_of_corner(cosine: Float, apart: float) -> Float:
    """Mm from a corner to where its legs are `apart` mm from each other; `cosine` of the angle between them."""
    half_sine = np.sqrt(np.maximum(1 - cosine, 1e-6) / 2)
    return apart / (2 * half_sine)


def cut_sharp_corners(lines: Polylines, corners: Int, areas: Areas, apart: float) -> Polylines:
    """Open lines with sharp corners cut off where their legs are `apart` mm from each other.

    Between two sharp corners at most half of the way is left out at either, at the ends of a line all of it. Corners
    stay where the way past them would leave the areas.

    Args:
        lines: without points that repeat the one before.
        corners: (C,) ascending, points of theirs that may be cut off.
        areas: that the lines lie in.
        apart: mm.
    """
    cuts = _cuts(lines, corners, apart)
    first, last = cuts.ends(cuts.begin), cuts.ends(cuts.end)
    inset, layer = _INSIDE * (last - first), lines.layer[cuts.line]
    # Around a corner that points into the areas the way past crosses no outline, and lies outside all along.
    ring = find_enclosing_rings(areas, (first + last) / 2, layer)
    inside = np.append(areas.ring_area() > 0, False)[ring]
    free = np.flatnonzero(inside & ~crossed(areas, first + inset, last - inset, layer))
    return cuts.take(free).applied() if len(free) else lines


@dataclass(frozen=True, slots=True, eq=False)
class _Cuts:
    """What is left out of lines, with all of them as one, 1 mm apart.

    Attributes:
        lines: without repeats.
        place: (N,) mm of each point.
        line: (C,) of each cut.
        begin, end: (C,) mm, ascending.
    """

    lines: Polylines
    place: Float
    line: Int
    begin: Float
    end: Float

    def take(self, chosen: Int) -> _Cuts:
        """Some of them."""
        return _Cuts(self.lines, self.place, self.line[chosen], self.begin[chosen], self.end[chosen])

    def ends(self, place: Float) -> Float:
        """(C, 2) mm, the points at these places."""
        return np.stack([np.interp(place, self.place, axis) for axis in self.lines.xy.T], axis=1)

    def applied(self) -> Polylines:
        """The lines without them."""
        lines = self.lines
        owner = np.repeat(np.arange(lines.n_lines), lines.size)
        cut = np.searchsorted(self.begin, self.place, side="right") - 1
        kept = np.flatnonzero((cut < 0) | (self.place > self.end[cut]))
        order = np.argsort(np.concatenate([self.place[kept], self.begin, self.end]), kind="stable")
        xy = np.concatenate([lines.xy[kept], self.ends(self.begin), self.ends(self.end)])
        size = np.bincount(np.concatenate([owner[kept], self.line, self.line]), minlength=lines.n_lines)
        return Polylines.of(xy[order], size, lines.layer).without_repeats()[0]


def _cuts(lines: Polylines, corners: Int, apart: float) -> _Cuts:
    """What there would be to leave out."""
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
