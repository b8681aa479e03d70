"""Find contoured extrusions, which follow the surface of the part inside their layer, and the tops of their layers.

A file is contoured if its extrusions of the part also descend: spirals and scarf seams only rise. It is also contoured
if a layer has level extrusions below its top, where they meet a flat inside the layer. Layer comments say
which extrusions are of one layer, and what its top is. Without them, a path starts a layer if it lies on extrusions of
the layer so far, or above its level ones.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Final

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, consecutive
from printer_slicer.inspection.coverage.extrusions import Extrusions
from printer_slicer.inspection.deposition.marks import NOT_PART
from printer_slicer.values import replace

__all__ = ["mark_contoured"]

_LEVEL_TOLERANCE: Final = 0.004  # mm; files round z to 0.001 or 0.01
_MIN_STEP: Final = 1e-4  # mm, change of z along an extrusion
_MIN_DESCENT: Final = 0.05  # mm, total descent of the extrusions of a contoured file
_MAX_DEPTH: Final = 2.0  # layer heights below the top of its layer; lower extrusions are not of the layer
_MAX_RAISE: Final = 0.2  # mm above the top of the layer
_MAX_JOINT_GAP: Final = 1e-3  # mm between the extrusions of a path
_MAX_SCARF_GAP: Final = 1.0  # mm from the end of a loop to the ramp at its start
_MIN_TOP_SHARE: Final = 0.25  # of the longest level; a higher level with this length is the top of its layer
_MAX_SHIFT: Final = 0.5  # mm, largest offset of all heights from those in the comments
_CELL: Final = 0.1  # mm
_HALF_WIDTH: Final = 0.15  # mm on each side of a path that the next layer lies on
_MIN_OVERLAP: Final = (
    0.35  # of the length of a path on the layer so far; more means that it starts the next layer
)
_MIN_LAYER_STEP: Final = (
    0.06  # mm; walls may be raised by less, so a higher path alone does not show a new layer
)
_MIN_LEVEL_STEP: Final = 0.01  # mm between the levels of a layer; files round z to 0.001 or 0.01
_MIN_LEVEL_LENGTH: Final = 5.0  # mm of level extrusion that shows the top of a layer


def mark_contoured(beads: Extrusions, layer_comments: Int, z_comment: Float) -> Extrusions:
    """Return extrusions with the top of the layer of each contoured one.

    Args:
        beads: the extrusions, in printing order.
        layer_comments: (B,) number of layer comments before each; 0 without such comments.
        z_comment: (B,) mm, height of the layer in the last comment before each; nan without one.
    """
    of_part = ~np.isin(beads.purpose, NOT_PART) & (beads.z_top > _LEVEL_TOLERANCE)
    own = np.flatnonzero(of_part)
    some = beads.take(own)
    descends = -np.minimum(some.rise, 0.0).sum() > _MIN_DESCENT
    if not (descends or _has_lowered_level(some, layer_comments[own], z_comment[own])):
        return beads
    has_comments = bool(layer_comments[own].any())
    number = layer_comments[own] if has_comments else _number_layers(some)
    number = np.unique(number, return_inverse=True)[1]
    top = _find_tops(some, number, z_comment[own] if has_comments else np.full(len(own), np.nan))
    contoured = _is_off_top(some, number, top) & ~_is_scarf(some, number, top)
    layer_top = np.full(beads.n_beads, np.nan)
    layer_top[own[contoured]] = top[number[contoured]]
    return replace(beads, layer_top=layer_top)


def _has_lowered_level(beads: Extrusions, layer_comments: Int, z_comment: Float) -> bool:
    """Return whether a layer has a long level at the height in its comment, and one below it.

    Args:
        beads: extrusions of the part.
        layer_comments: (B,) number of layer comments before each.
        z_comment: (B,) mm, see `mark_contoured`.
    """
    flat = np.flatnonzero((np.abs(beads.rise) < _MIN_STEP) & (layer_comments > 0))
    if not len(flat):
        return False
    order = flat[np.lexsort((beads.z_top[flat], layer_comments[flat]))]
    layer, z = layer_comments[order], beads.z_top[order]
    begins = np.append(True, (np.diff(layer) != 0) | (np.diff(z) > _MIN_LEVEL_STEP))
    length = np.bincount(np.cumsum(begins) - 1, beads.length[order])
    level = np.flatnonzero(begins)[length > _MIN_LEVEL_LENGTH]
    is_highest = np.abs(z - z_comment[order])[level] < _MIN_LEVEL_STEP
    return bool((is_highest[1:] & (np.diff(layer[level]) == 0)).any())


def _find_tops(beads: Extrusions, number: Int, z_comment: Float) -> Float:
    """Return the top (L,) of each layer, mm, by its comment or the highest of its long levels.

    Args:
        beads: extrusions of the part.
        number: (B,) layer of each, from 0.
        z_comment: (B,) mm, see `mark_contoured`.
    """
    n = int(number.max()) + 1
    found = _find_longest_levels(beads, number, n)
    said = np.full(n, np.nan)
    said[number] = z_comment
    shift = found - said
    known = ~np.isnan(shift)
    offset = float(np.median(shift[known])) if known.any() else 0.0
    if np.isnan(said).any() or not abs(offset) < _MAX_SHIFT:
        highest = np.full(n, -np.inf)
        np.maximum.at(highest, number, beads.z_top)
        return np.where(np.isnan(found), highest, found)
    # Comments and moves may round differently: the level itself is the top if it is as near as rounding.
    near = known & (np.abs(shift - offset) <= _LEVEL_TOLERANCE)
    return np.where(near, found, said + offset)


def _find_longest_levels(beads: Extrusions, number: Int, n: int) -> Float:
    """Return for each of n layers the highest z (n,) at which much of it is level, mm; nan without level extrusion."""
    flat = np.flatnonzero(np.abs(beads.rise) < _MIN_STEP)
    keys, which = np.unique(
        np.stack([number[flat], np.round(beads.z_top[flat], 3)]), axis=1, return_inverse=True
    )
    length = np.bincount(which.reshape(-1), beads.length[flat], keys.shape[1])
    layer = keys[0].astype(np.int64)
    longest = np.zeros(n)
    np.maximum.at(longest, layer, length)
    chosen = length >= _MIN_TOP_SHARE * longest[layer]
    result = np.full(n, np.nan)
    result[layer[chosen]] = keys[1][chosen]  # ascending, so the highest remains
    return result


def _is_off_top(beads: Extrusions, number: Int, top: Float) -> Bool:
    """Return a mask (B,) of extrusions that are not at the top (L,) of their layer, but near it."""
    order = np.argsort(top, kind="stable")
    height = np.zeros(len(top))
    height[order] = np.diff(top[order], prepend=0.0)
    # Objects may have layers with almost the same top.
    deepest = top - _MAX_DEPTH * np.maximum(height, float(np.median(height)))
    own = top[number]
    off = np.maximum(np.abs(beads.z_top - own), np.abs(beads.z_top - beads.rise - own)) > _LEVEL_TOLERANCE
    return np.asarray(off & (beads.middle_z > deepest[number]) & (beads.middle_z < own + _MAX_RAISE))


def _is_scarf(beads: Extrusions, number: Int, top: Float) -> Bool:
    """Return a mask (B,) of extrusions in loops with a scarf seam.

    Such a loop only rises, to the top (L,) of its layer, and ends at the ramp at its start.
    """
    path = _number_paths(beads, number)
    first = np.searchsorted(path, np.arange(path[-1] + 1))
    last = np.append(first[1:], len(path)) - 1
    rising = np.bincount(path, beads.rise > _MIN_STEP) > 0
    falling = np.bincount(path, beads.rise < -_MIN_STEP) > 0
    rise = np.where(beads.rise > _MIN_STEP, np.arange(len(path)), -1)
    ramp_end = np.maximum.reduceat(rise, first)
    end = beads.end[last]
    distance = np.full(len(first), np.inf)
    for place in (beads.begin[first], beads.end[np.maximum(ramp_end, 0)]):
        distance = np.minimum(distance, np.hypot(*(end - place).T))
    ends_at_top = np.abs(beads.z_top[last] - top[number[last]]) <= _LEVEL_TOLERANCE
    return np.asarray((rising & ~falling & ends_at_top & (distance < _MAX_SCARF_GAP))[path])


def _number_paths(beads: Extrusions, number: Int) -> Int:
    """Return the path (B,) of each extrusion; connected extrusions of a layer are one path."""
    new = np.diff(number) != 0
    new |= (np.abs(beads.begin[1:] - beads.end[:-1]) > _MAX_JOINT_GAP).any(axis=1)
    return np.append(0, np.cumsum(new))


def _number_layers(beads: Extrusions) -> Int:
    """Return the layer (B,) of each extrusion of a file without layer comments, from 0, in printing order."""
    path = _number_paths(beads, np.zeros(beads.n_beads, np.int64))
    bounds = np.searchsorted(path, np.arange(path[-1] + 2)).tolist()
    low = np.minimum(beads.begin, beads.end).min(axis=0) - 1
    size = np.maximum(beads.begin, beads.end).max(axis=0) + 1 - low
    columns, rows = np.ceil(size / _CELL).astype(int).tolist()
    latest = np.full(rows * columns, -1)  # the last layer that covers each cell
    flat = np.abs(beads.rise) < _MIN_STEP
    layer, level, highest = 0, -np.inf, -np.inf
    result = np.zeros(beads.n_beads, np.int64)
    for first, last in pairwise(bounds):
        some = beads.take(np.arange(first, last))
        center, beside = _find_cells(some, low, columns)
        top = float(some.z_top.max())
        above = top > highest + _MIN_LAYER_STEP and level > highest - _LEVEL_TOLERANCE
        if above or (latest[center] == layer).mean() > _MIN_OVERLAP:
            layer, level, highest = layer + 1, -np.inf, -np.inf
        highest = max(highest, top)
        own_flat = flat[first:last] & (some.z_top > highest - _LEVEL_TOLERANCE)
        if some.length[own_flat].sum() > _MIN_LEVEL_LENGTH:
            level = top
        latest[beside] = layer
        result[first:last] = layer
    return result


def _find_cells(beads: Extrusions, low: Float, columns: int) -> tuple[Int, Int]:
    """Return the cells along the middle of extrusions, and those within 0.15 mm of it."""
    count = np.maximum(np.ceil(beads.length / _CELL), 1).astype(np.int64)
    owner = np.repeat(np.arange(beads.n_beads), count)
    share = (consecutive(np.zeros(beads.n_beads, np.int64), count) + 0.5) / count[owner]
    way = beads.end - beads.begin
    side = np.stack([-way[:, 1], way[:, 0]], axis=1) / np.maximum(beads.length, 1e-9)[:, None]
    middle = beads.begin[owner] + share[:, None] * way[owner]
    cells = []
    for step in (0.0, -_HALF_WIDTH, -_HALF_WIDTH / 2, _HALF_WIDTH / 2, _HALF_WIDTH):
        column, row = np.floor((middle + step * side[owner] - low) / _CELL).astype(np.int64).T
        cells.append(row * columns + column)
    return cells[0], np.concatenate(cells)
