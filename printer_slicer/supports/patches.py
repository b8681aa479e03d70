"""Join overhanging pieces into patches, and drop patches that are too small to need supports.

An overhanging slope is one strip in each layer. Thinner layers have narrower strips. So the size of a patch counts,
seen from above, not the size of a strip.
"""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.geometry import (
    Areas,
    ConnectedAreas,
    depths,
    difference,
    fits_circle,
    intersection,
    normalize,
    offset,
    split_connected,
)
from printer_slicer.geometry.boxes import Boxes
from printer_slicer.geometry.connectivity import label_components
from printer_slicer.profile import Quality
from printer_slicer.supports.pieces import find_touching

__all__ = ["drop_small_groups", "find_far_pieces", "join_patches"]

_NEAR = 0.35  # mm; pieces this close to each other are one patch
_FAR = 4.0  # times the smallest reach; narrow pieces that extend this far over nothing bend down
_SEAM = 0.02  # mm by which strips are grown, so that no gap between two of them stays


def drop_small_groups(overhanging: Areas, required: Areas, step: Float, quality: Quality) -> Areas:
    """Return the areas of groups that may contain a patch that needs supports.

    Pieces whose bounding boxes touch form groups, so each patch lies within one group. This takes less time than to
    join patches, and on most parts it leaves little to join. Arguments are those of `join_patches`.
    """
    pieces = split_connected(overhanging)
    if not pieces.count:
        return overhanging
    boxes = Boxes(*pieces.areas.boxes(), pieces.layer)
    around = boxes.expand(_compute_reach(pieces, step))
    links = [
        np.stack(Boxes(around.low, around.high, around.layer + rise).find_overlapping(boxes))
        for rise in (0, 1)
    ]
    group = label_components(np.concatenate(links, axis=1), pieces.count)
    needed = _mark_large(_unite(pieces, group), quality)
    needed[group[_hold_areas(pieces, required)]] = True
    return pieces.on_layers(overhanging.n_layers, np.flatnonzero(needed[group]))


def find_far_pieces(overhanging: Areas, below: Areas, quality: Quality) -> Areas:
    """Return the pieces that extend far beyond the section below, such as a thin wall that is held at one end.

    Args:
        overhanging: areas of overhangs by layer.
        below: section below each layer.
        quality: smallest area and reach of patches.
    """
    pieces = split_connected(overhanging)
    large = np.flatnonzero(pieces.areas.area() >= quality.support_min_area)
    corners = pieces.areas.copy_layers(large)
    piece = large[corners.point_layer]
    reach = _FAR * quality.support_min_reach
    depth = depths(below, corners.xy, pieces.layer[piece], reach)
    far = np.unique(piece[~(depth > -reach)])  # nan: farther than the reach from all outlines
    return pieces.on_layers(overhanging.n_layers, far)


def join_patches(
    overhanging: Areas, required: Areas, cover: Areas, step: Float, quality: Quality
) -> tuple[Areas, Int]:
    """Return the areas of patches that need supports, and the patch (R,) of each of their rings, from 0.

    Args:
        overhanging: areas of overhangs by layer.
        required: areas of patches that need supports whatever their size, such as islands; parts of `overhanging`.
        cover: areas that bridges carry; what lies above or below them does not count.
        step: (L,) mm from section to section on the steepest slope that is an overhang.
        quality: smallest area and reach of patches.
    """
    pieces = split_connected(overhanging)
    if not pieces.count:
        return Areas.empty(overhanging.n_layers), np.zeros(0, np.int64)
    reach = _compute_reach(pieces, step)
    patch = label_components(np.stack(find_touching(pieces, pieces, reach, (0, 1))), pieces.count)
    united = _subtract_covers(_unite(pieces, patch), pieces, patch, split_connected(cover), reach)
    needed = _mark_large(united, quality)
    needed[patch[_hold_areas(pieces, required)]] = True
    kept = np.flatnonzero(needed[patch])
    rings = np.flatnonzero(np.isin(pieces.areas.ring_layer, kept))
    number = np.cumsum(needed) - 1
    return pieces.on_layers(overhanging.n_layers, kept), number[patch[pieces.areas.ring_layer[rings]]]


def _compute_reach(pieces: ConnectedAreas, step: Float) -> Float:
    """Return the distance (P,) up to which other pieces touch each piece, mm."""
    return np.asarray(np.maximum(step, _NEAR)[pieces.layer])


def _hold_areas(pieces: ConnectedAreas, areas: Areas) -> Bool:
    """Return a mask (P,) of pieces that some of the areas lie in."""
    return intersection(pieces.areas, pieces.select_nearby_rings(areas)).used


def _unite(pieces: ConnectedAreas, patch: Int) -> Areas:
    """Return each patch as seen from above, grown by the width of a seam."""
    grown = offset(pieces.areas, _SEAM)
    return _stack(grown, np.arange(pieces.count), patch, int(patch.max()) + 1)


def _subtract_covers(
    united: Areas, pieces: ConnectedAreas, patch: Int, cover: ConnectedAreas, reach: Float
) -> Areas:
    """Return the united patches without what bridges beside their pieces carry."""
    if not cover.count:
        return united
    own, other = find_touching(pieces, cover, reach, (-1, 0, 1))
    pairs = np.unique(np.stack([patch[own], other]), axis=1)
    return difference(united, _stack(cover.areas, pairs[1], pairs[0], united.n_layers))


def _stack(areas: Areas, which: Int, entry: Int, n_entries: int) -> Areas:
    """Return the union of the layers `which` (n,) of areas in each entry, given by `entry` (n,)."""
    order = np.argsort(entry, kind="stable")
    chosen = areas.copy_layers(which[order])
    return normalize(chosen.on_layers(entry[order], n_entries))


def _mark_large(united: Areas, quality: Quality) -> Bool:
    """Return a mask of the patches (n,), grown by a seam, that are neither too small nor too narrow."""
    area = united.area() - _SEAM * united.length()
    wide = fits_circle(united, quality.support_min_reach + _SEAM)
    return wide & (area >= quality.support_min_area)
