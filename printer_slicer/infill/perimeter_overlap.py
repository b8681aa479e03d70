"""Extend the ends of internal infill lines into the perimeters; connections run beside the perimeters."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Float, Int
from printer_slicer.geometry import Areas, Polylines
from printer_slicer.infill.connections import measure_extension_room
from printer_slicer.values import replace

__all__ = ["extend_ends"]


def extend_ends(
    joined: Polylines, lines: Polylines, area: Areas, overlap: float, return_distance: float
) -> Polylines:
    """Extend the ends of lines that remain after joining by `overlap` mm beyond the border of the area.

    A connection that starts at an extended end returns to the border within `return_distance` mm of it.

    Args:
        joined: lines joined along the border; some ends may be cut off.
        lines: the lines before joining, clipped to the area.
        area: the area for centre lines.
        overlap: length, mm.
        return_distance: distance along the border, mm.
    """
    places, tips, out = _find_line_ends(lines, area, overlap)
    point, of = _match_points(joined, places)
    if not len(point):
        return joined
    xy = joined.xy.copy()
    xy[point] = tips[of]
    first = np.isin(point, joined.start[:-1])
    last = np.isin(point, joined.start[1:] - 1)
    before, after = joined.xy[point - 1], joined.xy[np.minimum(point + 1, len(xy) - 1)]
    here, out = joined.xy[point], out[of]
    # The line comes from inside, against `out`; the other neighbour lies along the border.
    inward = [-((other - here) * out).sum(axis=1) / _lengths(other - here) for other in (before, after)]
    ahead = np.where(first | last, False, inward[0] > inward[1])
    way = np.where(ahead[:, None], after, before) - here
    far = ~(first | last) & (_lengths(way) > 2 * return_distance)
    at = (point + ahead)[far]
    between = (here + return_distance * way / _lengths(way)[:, None])[far]
    size = joined.size + np.bincount(
        np.searchsorted(joined.start, point[far], side="right") - 1, minlength=joined.n_lines
    )
    return replace(joined, xy=np.insert(xy, at, between, axis=0), start=np.append(0, np.cumsum(size)))


def _find_line_ends(lines: Polylines, area: Areas, overlap: float) -> tuple[tuple[Float, Int], Float, Float]:
    """Return positions and layers of the line ends (E,) on the border, their extended positions, and directions."""
    end = np.flatnonzero(lines.edge.ravel() >= 0)
    point = np.stack([lines.start[:-1], lines.start[1:] - 1], axis=1).ravel()[end]
    here = lines.xy[point]
    out = here - lines.xy[np.where(end % 2 == 1, point - 1, point + 1)]
    out /= _lengths(out)[:, None]
    room = measure_extension_room(here, out, area, lines.edge.ravel()[end], np.full(len(end), overlap))
    return (here, lines.layer[end // 2]), here + room[:, None] * out, out


def _match_points(joined: Polylines, places: tuple[Float, Int]) -> tuple[Int, Int]:
    """Find the points of joined lines at the positions of ends (E,); return the indices of points and ends."""
    layer = np.repeat(joined.layer, joined.size)
    rows = [np.column_stack([of, xy]) for of, xy in ((places[1], places[0]), (layer, joined.xy))]
    known = [np.ascontiguousarray(one).view(np.dtype((np.void, 24))).ravel() for one in rows]
    _, point, of = np.intersect1d(known[1], known[0], return_indices=True)
    order = np.argsort(point)
    return point[order], of[order]


def _lengths(vectors: Float) -> Float:
    """Return the lengths (n,) of vectors (n, 2), at least 1e-12."""
    return np.asarray(np.maximum(np.hypot(*vectors.T), 1e-12))
