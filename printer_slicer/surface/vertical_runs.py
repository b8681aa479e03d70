"""How far from the surface a vertical run can lead: the integral of the steepest rise met so far.

Start at height s at a place of the surface and move straight up to height e. At every height z on the way the distance
to the surface grows at most at the rise of its nearest point, which lies below z and not below s (the distance is at
most z - s). Hence it ends at most at the integral, over z from s to e, of G(z): the steepest rise of all contacts that
reach from below z to above s. Rises are at most 1, so the bound is at most e - s.

The same number bounds the way back. Let p be a place of the surface at height z between s and e. Walk down the surface
the steepest way: a mm of height leads κ = rise / √(1 - rise²) mm sideways, so p lies within H(z), the integral of κ(G)
from s to z, of the wall that stands on the contour at height s. The walk ends early only in a pit, a flat or a level
valley; G is 1 from there on. And if the vertical line through p passes the surface once between this cut and the next
one, the layer differs from its neighbour there, so p lies within e - z of the plane between them. The larger z, the
larger H and the smaller e - z; where they meet both equal some R, and the integral of G is at least
R G + R √(1 - G²) >= R with G taken there, because G grows with z. Where the vertical line passes the surface more
often, a feature is thinner than the layers and may be lost; no bound can be given for the way back then.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

from printer_slicer.arrays import Float, Int
from printer_slicer.geometry.slab_projection import BESIDE
from printer_slicer.surface.contacts import Contacts
from printer_slicer.surface.range_maximum import paint_maxima

__all__ = ["run_bounds", "runs_by_length", "steepest"]

# Coordinates this near to the border of a cell, mm, lie on it but for the rounding of 32-bit files.
_SAME = 5e-6


def run_bounds(contacts: Contacts, start: Float, end: Float) -> Float:
    """(n,) mm, the bounds of the runs from `start` up to `end`, exactly.

    Args:
        contacts: of the surface, seen from above.
        start: (n,) mm, ascending.
        end: (n,) mm; no run overlaps the next.
    """
    if len(start) == 0:
        return np.zeros(0)
    at_start = _reaching(contacts, start)
    first, last = np.searchsorted(contacts.low, start), np.searchsorted(contacts.low, end)
    count = np.maximum(last - first, 0)
    # One list for all runs: of each run the start, then the contacts that begin within it.
    begin = np.cumsum(count + 1) - (count + 1)
    run = np.repeat(np.arange(len(start)), count + 1)
    inside = np.ones(len(run), np.bool_)
    inside[begin] = False
    place = (np.arange(len(run)) - begin[run] - 1 + first[run])[inside]
    z, rise = start[run], at_start[run]
    z[inside], rise[inside] = contacts.low[place], contacts.rise[place]
    # Runs are two apart and rises at most one, so the running maximum starts anew with every run.
    steepest_yet = np.maximum.accumulate(rise + 2.0 * run) - 2.0 * run
    until = np.append(z[1:], end[-1])
    until[np.append(begin[1:], len(run)) - 1] = end
    weighted = steepest_yet * np.maximum(until - z, 0)
    return np.bincount(run, weights=weighted, minlength=len(start)).astype(np.float64)


def _reaching(contacts: Contacts, planes: Float) -> Float:
    """(n,) the steepest rise of the contacts that begin below each plane and reach over it."""
    first = np.searchsorted(planes, contacts.low, side="right")
    last = np.searchsorted(planes, contacts.high, side="left") - 1
    some = first <= last
    return paint_maxima(first[some], last[some], contacts.rise[some], len(planes))


def steepest(contacts: Contacts, start: float, end: float) -> int:
    """Index of the contact that weighs most in the run from `start` to `end`; -1 where there is none."""
    within = np.flatnonzero((contacts.low < end) & ((contacts.high > start) | (contacts.low >= start)))
    if len(within) == 0:
        return -1
    share = contacts.rise[within] * (end - np.maximum(contacts.low[within], start))
    return int(within[np.argmax(share)])


def runs_by_length(
    contacts: Contacts,
    cell: float,
    n_cells: int,
    length: Sequence[int],
    *,
    bottom: float = 0.0,
    contained: bool = False,
) -> Iterator[Float]:
    """For each length in turn (n_cells + 1,) mm, the bounds of runs of so many cells up from each border between cells.

    What a cell adds depends on how steep it was before: convex, and known for the shallowest run through the cell and
    for one as steep as all that is in it. In between the chord counts, so a bound errs upward, by much less than a
    cell. Runs that leave the cells end with the last one.

    Args:
        contacts: of the surface, seen from above.
        cell: mm.
        n_cells: how many.
        length: in cells, ascending.
        bottom: z of the lowest border, mm.
        contained: whether runs leave out what lies beside the borders of cells.
    """
    beside = (BESIDE if contained else _SAME) / cell
    low, high = (_on_borders((z - bottom) / cell, beside) for z in (contacts.low, contacts.high))
    first, last = np.floor(low).astype(np.int64), np.ceil(high).astype(np.int64) - 1
    if not contained:  # a flat in a border belongs to the run that begins there
        last = np.maximum(last, first)
    some = (last >= 0) & (first < n_cells) & (first <= last)
    least, steepest_there, mean = _in_cells(low[some], last[some], contacts.rise[some], n_cells)
    slope = (steepest_there - mean) / np.maximum(steepest_there - least, 1e-12)
    base = mean - slope * least
    total, highest = np.zeros(n_cells + 1), least.copy()
    for begin, end in pairwise([0, *length]):
        for ahead in range(begin, min(end, n_cells)):
            left = n_cells - ahead
            total[:left] += np.maximum(highest[:left], base[ahead:] + slope[ahead:] * highest[:left])
            np.maximum(highest[:left], steepest_there[ahead:], out=highest[:left])
        yield total * cell


def _on_borders(z: Float, beside: float) -> Float:
    """Heights in cells; those near to a border lie on it."""
    border = np.rint(z)
    return np.where(np.abs(z - border) <= beside, border, z)


def _in_cells(low: Float, last: Int, rise: Float, n_cells: int) -> tuple[Float, Float, Float]:
    """(n_cells,) each: the steepest rise at the bottom of a cell, the steepest in it, and the mean of the running one.

    Args:
        low: (n,) where contacts begin, in cells, ascending.
        last: (n,) the last cell that each reaches into.
        rise: (n,)
        n_cells: how many.
    """
    from_bottom = np.ceil(low).astype(np.int64)
    some = (from_bottom <= last) & (from_bottom < n_cells) & (last >= 0)
    least = paint_maxima(
        np.maximum(from_bottom[some], 0), np.minimum(last[some], n_cells - 1), rise[some], n_cells
    )
    begins = np.flatnonzero((low > 0) & (from_bottom > low))
    begins = begins[rise[begins] > least[from_bottom[begins] - 1]]
    cell, rise = from_bottom[begins] - 1, rise[begins]
    # Cells are two apart and rises at most one, so the running maximum starts anew with every cell.
    running = np.maximum.accumulate(rise + 2.0 * cell) - 2.0 * cell
    before = np.where(np.diff(cell, prepend=-1) > 0, least[cell], np.append(0.0, running)[:-1])
    gain = (running - before) * (from_bottom[begins] - low[begins])
    highest = least.copy()
    np.maximum.at(highest, cell, rise)
    return least, highest, least + np.bincount(cell, weights=gain, minlength=n_cells)
