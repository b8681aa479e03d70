"""Find slim columns, which need loops to stand upright."""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.arrays import Float, Int
from printer_slicer.geometry import (
    Areas,
    close_gaps,
    depths,
    find_enclosing_rings,
    fits_circle,
    intersection,
    normalize,
    offset,
    simplify,
    split_connected,
    union,
)
from printer_slicer.geometry.vectors import norm
from printer_slicer.model import Supports

__all__ = ["find_slim_columns"]

_SLIM_RATIO: Final = 2.0  # row spacings; wider columns have enough lines
_SMOOTHING: Final = 0.5  # mm; narrower bays than twice this are closed
_RESOLUTION: Final = 0.05  # mm of outlines
_MAX_UNSUPPORTED: Final = 1.5  # mm of a loop without another one below
_MAX_UNSUPPORTED_SHARE: Final = 0.2  # of the loops of a piece; more may hang than of a short loop
_SLIM_HEIGHT: Final = 2.0  # mm; a strip at the top of a wider column is not a slim column


def find_slim_columns(supports: Supports, spacing: float, width: Float) -> Areas:
    """Return the areas of slim columns, by support layer, without branches.

    A piece begins a slim column if it is narrow, and still narrow some mm below. From there the column goes down
    with the same outline, so that each loop around it lies on another one, also where it becomes part of a wider one.
    Below a slope that is not possible where the column recedes from layer to layer, so it has no loops there.

    Args:
        supports: the columns.
        spacing: distance between the lines of columns, mm.
        width: (S,) extrusion width, mm.
    """
    layers, n_layers = supports.plan.layers, supports.plan.layers.n_layers
    if supports.hollow.n_rings:
        return Areas.empty(n_layers)
    columns = normalize(supports.base.merge(supports.interface).merge(supports.floor))
    first = columns.find_first_equal_layers()
    pieces = split_connected(columns)
    slim = np.flatnonzero(~fits_circle(pieces.areas, _SLIM_RATIO * spacing / 2))
    narrow = pieces.on_layers(n_layers, slim)
    # The first layer is wider because of the foot.
    low = np.maximum(np.searchsorted(layers.top, layers.top - _SLIM_HEIGHT), min(1, n_layers - 1))
    begins = intersection(narrow, narrow.copy_layers(low))
    return _drop_unsupported(_follow_down(begins, columns, first), supports.base, width)


def _drop_unsupported(slim: Areas, base: Areas, width: Float) -> Areas:
    """Return the slim columns, by layer, without pieces whose loops the lines of the base do not support."""
    pieces = split_connected(slim)
    loops = offset(pieces.areas, -width[pieces.layer] / 2)
    point, layer = (loops.xy + loops.xy[loops.following]) / 2, pieces.layer[loops.point_layer]
    length = norm(loops.xy[loops.following] - loops.xy)
    whole = np.bincount(loops.point_layer, length, pieces.count)
    over = np.full(len(point), -1)
    over[layer > 0] = find_enclosing_rings(base, point[layer > 0], layer[layer > 0] - 1)
    reach = float(width[1:].max(initial=0.1)) / 2
    kept, tested = np.ones(pieces.count, np.bool_), np.ones(slim.n_layers + 1, np.bool_)
    while True:
        below = loops.select(kept[loops.ring_layer]).on_layers(pieces.layer + 1, slim.n_layers + 1)
        own = np.flatnonzero((over >= 0) & tested[layer])
        away = np.abs(depths(below, point[own], layer[own], reach))
        far = ~(away <= width[layer[own]] / 2)
        hanging = np.bincount(loops.point_layer[own], length[own] * far, pieces.count)
        lost = kept & (hanging > np.maximum(_MAX_UNSUPPORTED, _MAX_UNSUPPORTED_SHARE * whole))
        if not lost.any():
            break
        # What lay on these pieces hangs, too.
        kept &= ~lost
        tested = np.isin(np.arange(slim.n_layers + 1), pieces.layer[lost] + 1)
    return pieces.on_layers(slim.n_layers, np.flatnonzero(kept))


def _follow_down(begins: Areas, columns: Areas, first: Int) -> Areas:
    """Return areas that begin in some layers and continue below, within the columns.

    `first` (S,) is the first layer that has the same columns.
    """
    n_layers, used, same = columns.n_layers, begins.used, begins.find_first_equal_layers()
    area, result = Areas.empty(1), list[Areas]()
    for layer in range(n_layers - 1, -1, -1):
        at, above = np.array([layer]), min(layer + 1, n_layers - 1)
        if used[layer] and (layer == above or same[layer] != same[above]):
            both = union(area, begins.copy_layers(at))
            area = simplify(close_gaps(both, _SMOOTHING), _RESOLUTION)
            area = intersection(area, columns.copy_layers(at))
        if area.n_rings and first[layer] != first[above]:
            area = intersection(area, columns.copy_layers(at))
        result.append(area.on_layers(at, n_layers))
    return Areas.concatenate(result[::-1], n_layers)
