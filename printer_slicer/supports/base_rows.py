"""Rows of the lines of bases: the same for all layers of a column, so that each line lies on another one."""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.arrays import Float, Int, distinct
from printer_slicer.geometry import (
    Areas,
    ConnectedAreas,
    Lines,
    difference,
    find_enclosing_rings,
    hatch,
    offset,
    split_connected,
)
from printer_slicer.model import Supports
from printer_slicer.supports.pieces import unite_layers

__all__ = ["hatch_bases"]

_SEAM: Final = 0.01  # mm; columns nearer than twice this overlap
_FIRST_LAYER_ROWS: Final = 2.0  # rows of the first layer for each row above


def hatch_bases(supports: Supports, inner: Areas, spacing: float) -> tuple[Lines, ConnectedAreas, Float]:
    """Return the lines of bases, along x.

    Columns that overlap, seen from above, have the same rows in all layers. A whole number of rows fits, and the
    outermost ones lie half a spacing inside. The first layer has another row between each two.

    Args:
        supports: the columns.
        inner: areas by layer in which the lines lie.
        spacing: usual distance between rows, mm.

    Returns:
        Lines, whose layer is the piece of `inner`; these P pieces; and the distance between the rows of each (P,), mm.
    """
    pieces = split_connected(inner)
    group, low, high = _find_groups(supports, pieces)
    count = np.maximum(np.rint((high - low) / spacing), 1.0)
    step = np.maximum(high - low, 1e-3) / count
    place = low + step / 2  # of the lowest row
    rows, first = step[group], place[group]
    rows = np.where(pieces.layer == 0, rows / _FIRST_LAYER_ROWS, rows)
    return hatch(pieces.areas, angle=0.0, spacing=rows, phase=first / rows), pieces, rows


def _find_groups(supports: Supports, pieces: ConnectedAreas) -> tuple[Int, Float, Float]:
    """Return the group of columns (P,) of each piece, and the lowest and the highest y of each group (G,), mm."""
    if supports.hollow.n_rings:  # of trees, only feet have lines
        columns = difference(supports.base, supports.hollow)
    else:
        columns = supports.base.merge(supports.interface).merge(supports.floor)
    chosen = columns.of_layers(distinct(columns.find_first_equal_layers()))
    seen = offset(unite_layers(chosen), _SEAM)
    groups = split_connected(seen)
    owner = _find_owners(chosen, seen, groups)
    low, high = (np.full((2, groups.count), end) for end in (np.inf, -np.inf))
    # The first layer is wider because of the foot, so it counts only if there is no other.
    is_foot = (chosen.ring_layer == 0).astype(np.int64)
    y, start = chosen.xy[:, 1], chosen.ring_start[:-1]
    if len(start):
        np.minimum.at(low, (is_foot, owner), np.minimum.reduceat(y, start))
        np.maximum.at(high, (is_foot, owner), np.maximum.reduceat(y, start))
    has_more = np.isfinite(low[0])
    first = pieces.areas.take(np.searchsorted(pieces.areas.ring_layer, np.arange(pieces.count)))
    return (
        _find_owners(first, seen, groups),
        np.where(has_more, low[0], low[1]),
        np.where(has_more, high[0], high[1]),
    )


def _find_owners(areas: Areas, seen: Areas, groups: ConnectedAreas) -> Int:
    """Return the group (R,) in which each ring lies, seen from above."""
    ring = find_enclosing_rings(seen, areas.xy[areas.ring_start[:-1]], np.zeros(areas.n_rings, np.int64))
    return groups.of_ring[ring]
