"""Drop loose shells: flat open surfaces beside or through the part that enclose no volume."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.geometry.vectors import nearest_on_segments
from printer_slicer.healing.facets import Facets
from printer_slicer.healing.holes import CRACK
from printer_slicer.healing.orient_outward import measure_volume_and_area
from printer_slicer.model import Repair

__all__ = ["drop_loose_facets"]

_FLATNESS = 1e-3  # of its area to the power of 1.5: a patch that encloses less volume is flat
_MAX_LOOSE_RATIO = 0.05  # of the area of the mesh
_MAX_EDGES = 100_000  # maximum number of open edges that are compared


def drop_loose_facets(facets: Facets) -> tuple[Facets, list[Repair]]:
    """Drop flat patches that share no edge with another patch and do not run along an open edge of another patch.

    An edge runs along another if both of its ends and its middle are within the width of a crack. All patches stay if
    nothing else would remain, or if the rest is open too and they are more than a twentieth of the surface: then the
    mesh may consist of such patches, which are joined in each section.
    """
    open_edge = facets.count[facets.edges] == 1
    if not open_edge.any() or int(open_edge.sum()) > _MAX_EDGES:
        return facets, []
    patch = facets.label_patches()
    n_patches = int(patch.max()) + 1
    volume, area = measure_volume_and_area(facets, patch, n_patches)
    n_open = np.bincount(patch, open_edge.sum(axis=1), n_patches)
    joint = np.bincount(patch, (facets.count[facets.edges] > 2).any(axis=1), n_patches) > 0
    loose = (n_open > 0) & ~joint & (np.abs(volume) <= _FLATNESS * area**1.5)
    loose[_find_patches_along_others(facets, patch, open_edge, loose)] = False
    open_beside = bool(((n_open > 0) & ~loose).any())
    if not loose.any() or loose.all() or (open_beside and area[loose].sum() > _MAX_LOOSE_RATIO * area.sum()):
        return facets, []
    gone = loose[patch]
    return facets.select(~gone), [Repair("loose facets dropped", facets.centroids[gone])]


def _find_patches_along_others(facets: Facets, patch: Int, open_edge: Bool, loose: Bool) -> Int:
    """Return the patches (n,) among `loose` (P,) that have an open edge along an open edge of another patch."""
    from printer_slicer.geometry.planar import SegmentTree  # noqa: PLC0415 - shapely only when it is needed

    if not loose.any():
        return np.zeros(0, np.int64)
    owner = np.repeat(patch, 3)[open_edge.ravel()]
    start = facets.points[facets.corners[open_edge]]
    end = facets.points[facets.corners[:, [1, 2, 0]][open_edge]]
    tree = SegmentTree(np.stack([start[:, :2], end[:, :2]], axis=1))
    own = np.flatnonzero(loose[owner])
    beside = np.ones(len(own), np.bool_)
    for point in (start[own], (start[own] + end[own]) / 2, end[own]):
        place, other = tree.query_boxes(point[:, :2] - CRACK, point[:, :2] + CRACK)
        apart = owner[own[place]] == owner[other]
        near = ~apart & (_distance_from_segments(point[place], start[other], end[other]) <= CRACK)
        beside &= np.bincount(place[near], minlength=len(own)) > 0
    return np.unique(owner[own[beside]])


def _distance_from_segments(point: Float, start: Float, end: Float) -> Float:
    """Return the distance (n,) of each point (n, 3) from its segment from `start` to `end`, mm."""
    return np.asarray(np.linalg.norm(point - nearest_on_segments(point, start, end)[0], axis=1))
