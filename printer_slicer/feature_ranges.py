"""Find features of a part that stand apart, such as towers, and their surfaces.

Sources: Tyberg and Bohn, "Local adaptive slicing", 1998.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from printer_slicer.arrays import Float, Int
from printer_slicer.geometry import (
    Areas,
    contain_points,
    find_enclosing_rings,
    offset,
    simplify,
    split_connected,
    union,
)
from printer_slicer.geometry.facet_clipping import clip_facets
from printer_slicer.geometry.plane_sections import section_contours
from printer_slicer.geometry.slab_projection import BESIDE, project_slabs
from printer_slicer.model import Mesh
from printer_slicer.surface.flats import find_flats
from printer_slicer.values import Struct

__all__ = ["FeatureRange", "clip_features", "find_feature_ranges", "list_rings_of_feature"]

_SMALLEST_GAP: Final = 1.0  # mm between features as seen from above
_FINE: Final = 0.05  # mm; outlines are simplified by this tolerance
_SLAB: Final = 0.5  # mm, thickness of the slabs in which features are searched for
_STEP_TOLERANCE: Final = 1e-2  # of a z step


class FeatureRange(Struct, frozen=True, eq=False):
    """A range of heights in which features stand apart.

    Attributes:
        low, high: mm, whole z steps.
        outlines: one layer for each feature: an area that contains it and no other one, as seen from above.
    """

    low: float
    high: float
    outlines: Areas


def find_feature_ranges(mesh: Mesh, z_step: float, shortest: float) -> list[FeatureRange]:
    """Return the ranges of heights in which parts of a mesh are at least 1 mm apart as seen from above, ascending.

    What overlaps as seen from above anywhere in the range is one feature.

    Args:
        mesh: the part, standing on z = 0.
        z_step: mm; ranges begin and end at whole steps.
        shortest: mm; ranges that are not so high are left out.
    """
    planes = _list_planes(mesh, z_step)
    shadows = _project_slabs(mesh, planes)
    return [
        FeatureRange(float(planes[first]), float(planes[last]), outlines)
        for first, last, outlines in _join_slabs(shadows)
        if planes[last] - planes[first] >= shortest
    ]


def _list_planes(mesh: Mesh, step: float) -> Float:
    """Return heights (n,) that divide a part, mm, in whole z steps: every 0.5 mm, and on both sides of flats."""
    even = np.linspace(0.0, mesh.height, max(round(mesh.height / _SLAB), 1) + 1)
    z = np.concatenate([even, find_flats(mesh)[0]]) / step
    whole = np.concatenate([np.ceil(z - _STEP_TOLERANCE), np.floor(z[len(even) :] + _STEP_TOLERANCE)])
    return np.unique(np.round(whole * step, 7))


def _project_slabs(mesh: Mesh, planes: Float) -> Areas:
    """Return what is solid anywhere between two planes, as seen from above, grown by half of the smallest gap."""
    bottom, top = planes[:-1], planes[1:]
    middle = section_contours(mesh.triangles, np.minimum((bottom + top) / 2, mesh.height - BESIDE))
    shadows = simplify(union(middle, project_slabs(mesh.triangles, bottom, top)), _FINE)
    return offset(shadows, _SMALLEST_GAP / 2 + _FINE)


def _join_slabs(shadows: Areas) -> Iterator[tuple[int, int, Areas]]:
    """Yield ranges of slabs in which features stand apart: first plane, last plane, one layer for each feature."""
    slabs = [shadows.copy_layers(np.array([layer])) for layer in range(shadows.n_layers)]
    count = [split_connected(slab).count for slab in slabs]
    first = 0
    while first < len(slabs):
        last, whole = first + 1, slabs[first]
        pieces = split_connected(whole)
        while pieces.count >= 2 and last < len(slabs) and count[last] >= 2:
            joined = union(whole, slabs[last])
            found = split_connected(joined)
            if found.count < pieces.count:
                break
            whole, pieces, last = joined, found, last + 1
        if pieces.count >= 2:
            yield first, last, pieces.areas
        first = last


def clip_features(part: Mesh, place: FeatureRange) -> list[Mesh]:
    """Return the surface of each feature in a range; an empty list if a facet belongs to none."""
    triangles = clip_facets(part.triangles, place.low, place.high)
    points = triangles.mean(axis=1)[:, :2]
    outlines = place.outlines
    flat = Areas(outlines.xy, outlines.ring_start, np.zeros(outlines.n_rings, np.int64), 1)
    ring = find_enclosing_rings(flat, points, np.zeros(len(points), np.int64))
    owner = outlines.ring_layer[ring]
    if (ring < 0).any() or len(np.unique(owner)) < outlines.n_layers:
        return []
    return [
        Mesh(triangles[owner == k], f"{part.name}, z {place.low:g} to {place.high:g}, feature {k + 1}")
        for k in range(outlines.n_layers)
    ]


def list_rings_of_feature(solid: Areas, here: Int, outline: Areas) -> Int:
    """Return the rings of some layers that lie within an outline, and all rings of other layers, ascending.

    Args:
        solid: the part in all layers.
        here: (n,) layers.
        outline: area of the feature as seen from above, one layer.
    """
    first = solid.xy[solid.ring_start[:-1]]
    is_here = np.isin(solid.ring_layer, here)
    rings = np.flatnonzero(is_here)
    # Not in a hole of the outline, where another feature may stand.
    inside = contain_points(outline, first[rings], np.zeros(len(rings), np.int64))
    return np.sort(np.concatenate([np.flatnonzero(~is_here), rings[inside]]))
