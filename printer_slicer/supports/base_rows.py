"""Choose the rows of lines of columns: the same in all layers, so that each line lies on the one below."""

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
from printer_slicer.geometry.layer_union import unite_layers
from printer_slicer.model import Supports

__all__ = ["hatch_bases"]

_SEAM: Final = 0.01  # mm; columns nearer than twice this overlap
_EDGE: Final = 0.9  # mm from the edge of columns to their outermost rows
_MAX_STRETCH: Final = 1.25  # times the usual distance, which rows may have so that there is one less
_FIRST_LAYER_ROWS: Final = 2.0  # rows of the first layer for each row above


def hatch_bases(supports: Supports, inner: Areas, spacing: float) -> tuple[Lines, ConnectedAreas, Float]:
    """Return the lines of bases, along x.

    Columns that overlap, seen from above, have the same rows in all layers. The outermost rows lie near the edges,
    because interfaces end there. The first layer has another row between each two.

    Args:
        supports: the columns.
        inner: areas by layer in which the lines lie.
        spacing: usual distance between rows, mm.

    Returns:
        Lines, whose layer is the piece of `inner`; these P pieces; and the distance between the rows of each (P,), mm.
    """
    pieces = split_connected(inner)
    group, low, high = _find_groups(supports, pieces)
    first, step = _place_rows(low, high, spacing)
    rows, first = step[group], first[group]
    rows = np.where(pieces.layer == 0, rows / _FIRST_LAYER_ROWS, rows)
    return hatch(pieces.areas, angle=0.0, spacing=rows, phase=first / rows), pieces, rows


def _place_rows(low: Float, high: Float, spacing: float) -> tuple[Float, Float]:
    """Return the lowest row (G,) of columns from `low` to `high` (G,), and the distance (G,) between their rows, mm."""
    between = np.maximum(high - low - 2 * _EDGE, 0.0) / spacing
    fewer = np.floor(between)
    count = np.where(between <= _MAX_STRETCH * fewer, fewer, np.ceil(between))
    step = np.where(count > 0, between * spacing / np.maximum(count, 1), np.maximum(high - low, 1e-3))
    return np.where(count > 0, low + _EDGE, (low + high) / 2), step


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
