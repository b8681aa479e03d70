"""Join pieces that hang into patches, and drop patches that are too small to need supports.

A slope hangs as one strip in each layer, and the thinner the layers, the narrower the strips. So the size of a patch
counts, seen from above, never that of a strip.
"""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.geometry import (
    Areas,
    ConnectedAreas,
    difference,
    intersection,
    normalize,
    offset,
    split_connected,
)
from printer_slicer.geometry.boxes import Boxes
from printer_slicer.geometry.connectivity import label_components
from printer_slicer.profile import Quality
from printer_slicer.supports.pieces import find_touching

__all__ = ["join_patches"]

_NEAR = 0.35  # mm; pieces this close to each other are one patch
_SEAM = 0.02  # mm by which strips are grown, so that no gap between two of them stays


def join_patches(
    hanging: Areas, islands: Areas, cover: Areas, step: Float, quality: Quality
) -> tuple[Areas, Int]:
    """Return the areas of patches that need supports, and the patch (R,) of each of their rings, from 0.

    Args:
        hanging: areas that hang.
        islands: areas of patches that need supports whatever their size; parts of `hanging`.
        cover: areas that bridges carry; what lies above or below them does not count.
        step: (L,) mm from section to section on the steepest slope that hangs.
        quality: smallest area and reach of patches.
    """
    pieces = split_connected(hanging)
    special = intersection(pieces.areas, pieces.select_nearby_rings(islands)).used
    reach = np.maximum(step, _NEAR)[pieces.layer]
    possible = np.flatnonzero(_mark_large_groups(pieces, reach, special, quality))
    if not len(possible):
        return Areas.empty(hanging.n_layers), np.zeros(0, np.int64)
    pieces, special, reach = pieces.take(possible), special[possible], reach[possible]
    patch = label_components(np.stack(find_touching(pieces, pieces, reach, (0, 1))), pieces.count)
    needed = _mark_large(_unite(pieces, patch, split_connected(cover), reach), quality)
    needed[patch[special]] = True
    kept = np.flatnonzero(needed[patch])
    rings = np.flatnonzero(np.isin(pieces.areas.ring_layer, kept))
    number = np.cumsum(needed) - 1
    return pieces.on_layers(hanging.n_layers, kept), number[patch[pieces.areas.ring_layer[rings]]]


def _mark_large_groups(pieces: ConnectedAreas, reach: Float, special: Bool, quality: Quality) -> Bool:
    """Return a mask (P,) of pieces that may belong to a patch that needs supports.

    Pieces whose bounding boxes touch form groups. Each patch lies within one group, so groups with too little area are
    left out. This takes far less time than to join patches.
    """
    boxes = Boxes(*pieces.areas.boxes(), pieces.layer)
    around = boxes.expand(reach)
    links = [
        np.stack(Boxes(around.low, around.high, around.layer + rise).find_overlapping(boxes))
        for rise in (0, 1)
    ]
    group = label_components(np.concatenate(links, axis=1), pieces.count)
    large = np.bincount(group, pieces.areas.area()) >= quality.support_min_area
    large[group[special]] = True
    return np.asarray(large[group])


def _unite(pieces: ConnectedAreas, patch: Int, cover: ConnectedAreas, reach: Float) -> Areas:
    """Return each patch as seen from above, grown by the width of a seam, without what bridges beside it carry."""
    n_patches = int(patch.max()) + 1
    united = _stack(offset(pieces.areas, _SEAM), np.arange(pieces.count), patch, n_patches)
    if not cover.count:
        return united
    own, other = find_touching(pieces, cover, reach, (-1, 0, 1))
    pairs = np.unique(np.stack([patch[own], other]), axis=1)
    return difference(united, _stack(cover.areas, pairs[1], pairs[0], n_patches))


def _stack(areas: Areas, which: Int, entry: Int, n_entries: int) -> Areas:
    """Return the union of the layers `which` (n,) of areas in each entry, given by `entry` (n,)."""
    order = np.argsort(entry, kind="stable")
    chosen = areas.copy_layers(which[order])
    return normalize(chosen.on_layers(entry[order], n_entries))


def _mark_large(united: Areas, quality: Quality) -> Bool:
    """Return a mask of the patches (n,), grown by a seam, that are neither too small nor too narrow."""
    area = united.area() - _SEAM * united.length()
    wide = offset(united, -(quality.support_min_reach + _SEAM)).used
    return wide & (area >= quality.support_min_area)
