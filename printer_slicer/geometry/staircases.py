"""Compute the area covered by rows of a hatch, from one outline per column of rows instead of one per row."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Float, per_layer, run_starts
from printer_slicer.geometry.areas import Areas, Lines
from printer_slicer.geometry.engine import normalize
from printer_slicer.geometry.hatching import find_columns

__all__ = ["unite_row_rectangles"]

_BEYOND = 1e-3  # of the half width, so that adjacent columns overlap


def unite_row_rectangles(
    rows: Lines, u: Float, *, angle: float | Float, half: float | Float, n_layers: int
) -> Areas:
    """Return the union of rectangles along rows.

    Neighbouring rows form a column if each is the only one beside the other. The outline of a column goes up on one
    side in steps, and down on the other. That is far less work for the union than one rectangle per row.

    Args:
        rows: lines of a hatch.
        u: (S, 2) mm, positions along the row where its rectangle starts and ends.
        angle: radians, direction of the rows; one for all layers or one per layer.
        half: mm, half the width of a rectangle, between half the row spacing and the whole spacing; one for all layers
            or one per layer.
        n_layers: number of layers of the stack.
    """
    if not rows.n_lines:
        return Areas.empty(n_layers)
    foot, rank = find_columns(rows)
    order = np.lexsort((rank, foot))
    begin = np.flatnonzero(run_starts(foot[order]))
    size = np.diff(np.append(begin, len(order)))
    layer = rows.layer[order]
    turn, reach = (per_layer(value, n_layers)[layer] for value in (angle, half))
    along = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    aside = np.stack([-along[:, 1], along[:, 0]], axis=1)
    v = (rows.ends[order, 0] * aside).sum(axis=1)
    high = np.tile(v + reach * (1 + _BEYOND), (2, 1))  # of the left side, and of the right one
    low = np.tile(v - reach * (1 + _BEYOND), (2, 1))
    upper = np.delete(np.arange(len(order)), begin)
    lower = upper - 1
    # Between two rows the step lies at the edge of the longer one.
    longer = (u[order[lower]] - u[order[upper]]).T * [[-1], [1]] > 0
    low[:, upper] = high[:, lower] = np.where(longer, (v + reach)[lower], (v - reach)[upper])
    # Go up on the right side and down on the left side.
    xy = np.zeros((4 * len(order), 2))
    first, total = np.repeat(4 * begin, size), np.repeat(4 * size, size)
    rank = 2 * (np.arange(len(order)) - np.repeat(begin, size))
    for side, bound, up in ((1, low, rank), (1, high, rank + 1), (0, high, rank + 1), (0, low, rank)):
        at = first + (up if side else total - 1 - up)
        xy[at] = u[order, side, None] * along + bound[side, :, None] * aside
    by_layer = np.argsort(layer[begin], kind="stable")
    rings = Areas(xy, np.append(4 * begin, len(xy)), np.sort(layer[begin]), n_layers)
    return normalize(rings.restacked(by_layer, layer[begin][by_layer], n_layers))
