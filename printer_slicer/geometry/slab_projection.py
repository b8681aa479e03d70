"""Clip facets to slabs between two heights and project them onto the bed."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Float, Int
from printer_slicer.geometry.areas import Areas
from printer_slicer.geometry.facet_topology import expand_counts
from printer_slicer.geometry.vectors import cross

__all__ = ["BESIDE", "project_pieces", "project_slabs"]

BESIDE = 2e-5
"""mm; margin left out at both ends of a slab, because 32-bit coordinates round heights near its borders."""
_NO_AREA = 1e-9  # mm²


def project_slabs(triangles: Float, bottom: Float, top: Float) -> Areas:
    """Project the parts of all facets that lie within each slab onto the bed.

    Vertical facets, facets that only touch a slab from outside, and anything within rounding of a border are left out.

    Args:
        triangles: (F, 3, 3) mm.
        bottom: (L,) mm, ascending.
        top: (L,) mm, ascending; slabs may touch but not overlap.

    Returns:
        One layer per slab, with rings that may overlap.
    """
    low, high = bottom + BESIDE, top - BESIDE
    z = triangles[:, :, 2]
    first = np.searchsorted(high, z.min(axis=1), side="right")
    last = np.searchsorted(low, z.max(axis=1), side="left")
    flat = triangles[..., :2]
    area = cross(flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0])
    facets = np.flatnonzero(np.abs(area) > _NO_AREA)
    owner, place = expand_counts(np.maximum(last - first, 0)[facets])
    facet = facets[owner]
    # Make all facets counter-clockwise as seen from above.
    corners = np.where((area[facet] > 0)[:, None, None], triangles[facet], triangles[facet][:, ::-1])
    return project_pieces(corners, first[facet] + place, bottom, top)


def project_pieces(triangles: Float, slab: Int, bottom: Float, top: Float) -> Areas:
    """Project the part of each triangle that lies within its own slab onto the bed.

    Args:
        triangles: (n, 3, 3) mm, counter-clockwise as seen from above, none of them vertical.
        slab: (n,) slab of each triangle.
        bottom: (L,) mm.
        top: (L,) mm.

    Returns:
        One layer per slab, with rings that may overlap.
    """
    xy, size = _clip_triangles(triangles, (bottom + BESIDE)[slab], (top - BESIDE)[slab])
    layers, order = slab[size > 0], np.argsort(slab[size > 0], kind="stable")
    return _stack_rings(xy, size[size > 0], layers, order, len(bottom))


def _clip_triangles(corners: Float, low: Float, high: Float) -> tuple[Float, Int]:
    """Clip triangles (n, 3, 3) to the heights `low` to `high` (n,).

    The outline of a clipped triangle consists of its clipped edges in order, joined by straight lines.

    Returns:
        The points (m, 2) of all outlines, one after the other, and the number of points (n,) of each.
    """
    begin, end = corners, corners[:, [1, 2, 0]]
    rise = end[:, :, 2] - begin[:, :, 2]
    is_level = rise == 0
    share = [
        np.clip((border[:, None] - begin[:, :, 2]) / np.where(is_level, 1.0, rise), 0, 1)
        for border in (low, high)
    ]
    enter, leave = np.where(rise > 0, share[0], share[1]), np.where(rise > 0, share[1], share[0])
    within = (begin[:, :, 2] >= low[:, None]) & (begin[:, :, 2] <= high[:, None])
    enter, leave = np.where(is_level, 0.0, enter), np.where(is_level, 1.0, leave)
    kept = np.where(is_level, within, enter < leave)
    # Where two edges meet, the corner is listed once.
    begins_at_corner = kept & (enter == 0)
    ends = kept & ~((leave == 1) & begins_at_corner[:, [1, 2, 0]])
    step = (end - begin)[:, :, :2]
    points = np.stack(
        [begin[:, :, :2] + enter[:, :, None] * step, begin[:, :, :2] + leave[:, :, None] * step], axis=2
    )
    used = np.stack([kept, ends], axis=2)
    return points[used], used.sum(axis=(1, 2))


def _stack_rings(xy: Float, size: Int, layer: Int, order: Int, n_layers: int) -> Areas:
    """Build a stack from rings with `size` points each, sorted by layer."""
    start = np.cumsum(size) - size
    owner, place = expand_counts(size[order])
    moved = xy[start[order][owner] + place]
    return Areas(moved, np.concatenate([[0], np.cumsum(size[order])]), layer[order], n_layers)
