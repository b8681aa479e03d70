"""Bound the distance from the surface at the end of a vertical run by the integral of the steepest rise along it.

Start at height s on the surface and move straight up to height e. At every height z the distance to the surface grows
at most at the rise of its nearest point. That point lies below z and not below s, because the distance is at most
z - s. So the final distance is at most the integral over z from s to e of G(z), the steepest rise of all contacts that
reach from below z to above s. Rises are at most 1, so the bound is at most e - s.

The same number bounds the distance in the other direction, from the surface to the layers. Let p be a point of the
surface at height z between s and e. Follow the steepest path down the surface: 1 mm of height takes
κ = rise / √(1 - rise²) mm sideways. So the distance of p from the wall above the contour at height s is at most H(z),
the integral of κ(G) from s to z. The path ends early only in a pit, a flat or a level valley; from there on G is 1.
If the vertical line through p passes the surface once between this section and the next one, the layer differs from its
neighbour there, so p is within e - z of the plane between them. As z grows, H grows and e - z shrinks. At the height
where both equal some R, the integral of G is at least R G + R √(1 - G²) >= R, because G grows with z. If the vertical
line passes the surface more than once, a feature is thinner than the layers and may be lost; then there is no bound in
this direction.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

from printer_slicer.arrays import Float, Int
from printer_slicer.geometry.slab_projection import BESIDE
from printer_slicer.surface.contacts import Contacts
from printer_slicer.surface.range_maximum import compute_range_maxima

__all__ = ["bound_runs", "bound_runs_by_length", "find_main_contact"]

# mm; coordinates this near to the border of a cell count as on it, because 32-bit files round them.
_SAME = 5e-6


def bound_runs(contacts: Contacts, start: Float, end: Float) -> Float:
    """Return the exact bounds (n,) of the distance from the surface after runs from `start` up to `end`, mm.

    Args:
        contacts: contacts of the surface, seen from above.
        start: (n,) mm, ascending.
        end: (n,) mm; no run overlaps the next.
    """
    if len(start) == 0:
        return np.zeros(0)
    at_start = _find_steepest_across(contacts, start)
    first, last = np.searchsorted(contacts.low, start), np.searchsorted(contacts.low, end)
    count = np.maximum(last - first, 0)
    # One list for all runs: the start of each run, then the contacts that start within it.
    begin = np.cumsum(count + 1) - (count + 1)
    run = np.repeat(np.arange(len(start)), count + 1)
    inside = np.ones(len(run), np.bool_)
    inside[begin] = False
    place = (np.arange(len(run)) - begin[run] - 1 + first[run])[inside]
    z, rise = start[run], at_start[run]
    z[inside], rise[inside] = contacts.low[place], contacts.rise[place]
    # Offsets of 2 per run exceed any rise, so the running maximum restarts with every run.
    steepest_yet = np.maximum.accumulate(rise + 2.0 * run) - 2.0 * run
    until = np.append(z[1:], end[-1])
    until[np.append(begin[1:], len(run)) - 1] = end
    weighted = steepest_yet * np.maximum(until - z, 0)
    return np.bincount(run, weights=weighted, minlength=len(start)).astype(np.float64)


def _find_steepest_across(contacts: Contacts, planes: Float) -> Float:
    """Return the steepest rise (n,) of the contacts that start below each plane and reach above it."""
    first = np.searchsorted(planes, contacts.low, side="right")
    last = np.searchsorted(planes, contacts.high, side="left") - 1
    some = first <= last
    return compute_range_maxima(first[some], last[some], contacts.rise[some], len(planes))


def find_main_contact(contacts: Contacts, start: float, end: float) -> int:
    """Return the index of the contact that contributes most to the run from `start` to `end`, or -1."""
    within = np.flatnonzero((contacts.low < end) & ((contacts.high > start) | (contacts.low >= start)))
    if len(within) == 0:
        return -1
    share = contacts.rise[within] * (end - np.maximum(contacts.low[within], start))
    return int(within[np.argmax(share)])


def bound_runs_by_length(
    contacts: Contacts,
    cell: float,
    n_cells: int,
    length: Sequence[int],
    *,
    bottom: float = 0.0,
    contained: bool = False,
) -> Iterator[Float]:
    """Yield for each length the bounds (n_cells + 1,) of upward runs from each border between cells, mm.

    The contribution of a cell is a convex function of the steepest rise below it. It is known for the shallowest run
    through the cell, and for a run that is at least as steep as everything in the cell. In between, the chord of the
    function is used, so a bound may be too large, by far less than a cell. Runs end with the last cell.

    Args:
        contacts: contacts of the surface, seen from above.
        cell: mm, height of a cell.
        n_cells: number of cells.
        length: lengths of the runs in cells, ascending.
        bottom: z of the lowest border, mm.
        contained: whether runs leave out a margin at the borders of cells.
    """
    beside = (BESIDE if contained else _SAME) / cell
    low, high = (_snap_to_borders((z - bottom) / cell, beside) for z in (contacts.low, contacts.high))
    first, last = np.floor(low).astype(np.int64), np.ceil(high).astype(np.int64) - 1
    if not contained:  # a flat on a border belongs to the run that starts there
        last = np.maximum(last, first)
    some = (last >= 0) & (first < n_cells) & (first <= last)
    least, steepest_there, mean = _summarize_cells(low[some], last[some], contacts.rise[some], n_cells)
    slope = (steepest_there - mean) / np.maximum(steepest_there - least, 1e-12)
    base = mean - slope * least
    total, highest = np.zeros(n_cells + 1), least.copy()
    for begin, end in pairwise([0, *length]):
        for ahead in range(begin, min(end, n_cells)):
            left = n_cells - ahead
            total[:left] += np.maximum(highest[:left], base[ahead:] + slope[ahead:] * highest[:left])
            np.maximum(highest[:left], steepest_there[ahead:], out=highest[:left])
        yield total * cell


def _snap_to_borders(z: Float, beside: float) -> Float:
    """Round heights, in cells, to the nearest border between cells if they are close to it."""
    border = np.rint(z)
    return np.where(np.abs(z - border) <= beside, border, z)


def _summarize_cells(low: Float, last: Int, rise: Float, n_cells: int) -> tuple[Float, Float, Float]:
    """Compute the steepest and the mean rise in each cell.

    Args:
        low: (n,) lower end of each contact, in cells, ascending.
        last: (n,) the last cell into which it reaches.
        rise: (n,) rise of each contact.
        n_cells: number of cells.

    Returns:
        The steepest rise at the bottom of each cell, the steepest rise in it, and the mean of the running maximum of
        the rise from the bottom up, each (n_cells,).
    """
    from_bottom = np.ceil(low).astype(np.int64)
    some = (from_bottom <= last) & (from_bottom < n_cells) & (last >= 0)
    least = compute_range_maxima(
        np.maximum(from_bottom[some], 0), np.minimum(last[some], n_cells - 1), rise[some], n_cells
    )
    begins = np.flatnonzero((low > 0) & (from_bottom > low))
    begins = begins[rise[begins] > least[from_bottom[begins] - 1]]
    cell, rise = from_bottom[begins] - 1, rise[begins]
    # Offsets of 2 per cell exceed any rise, so the running maximum restarts with every cell.
    running = np.maximum.accumulate(rise + 2.0 * cell) - 2.0 * cell
    before = np.where(np.diff(cell, prepend=-1) > 0, least[cell], np.append(0.0, running)[:-1])
    gain = (running - before) * (from_bottom[begins] - low[begins])
    highest = least.copy()
    np.maximum.at(highest, cell, rise)
    return least, highest, least + np.bincount(cell, weights=gain, minlength=n_cells)
