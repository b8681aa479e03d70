"""Simplify the outlines of areas."""

from __future__ import annotations

import numpy as np

from printer_slicer.geometry.areas import Areas
from printer_slicer.geometry.collinear_points import remove_collinear
from printer_slicer.kernel import load_kernel

__all__ = ["simplify_outlines"]


def simplify_outlines(areas: Areas, tolerance: float) -> Areas:
    """Remove points from rings, so that no outline moves by more than `tolerance` mm; see `engine.simplify`."""
    turned = _start_at_leftmost(areas.select(np.diff(areas.ring_start) >= 3))
    if tolerance == 0:
        return remove_collinear(turned)
    simple = _simplify_rings(turned, tolerance)
    sizes = np.diff(simple.ring_start)
    kept = sizes >= 3
    # Drop rings that changed direction: a hole would become a solid.
    before, simple = turned.select(kept).ring_area(), simple.select(kept)
    # A ring that crosses itself may have a total area of zero.
    return simple.select((simple.ring_area() * before > 0) | (before == 0))


def _simplify_rings(areas: Areas, tolerance: float) -> Areas:
    """Simplify rings, each of which begins at a corner; some may collapse."""
    kernel = load_kernel()
    if kernel is None:
        from printer_slicer.geometry import planar  # noqa: PLC0415 - shapely only when it is needed

        return planar.simplify_rings(areas, tolerance)
    needed = np.frombuffer(kernel.outline_points(areas.xy.data, areas.ring_start.data, tolerance), np.bool_)
    start = np.append(0, np.cumsum(needed))[areas.ring_start]
    return Areas(areas.xy.compress(needed, axis=0), start, areas.ring_layer, areas.n_layers)


def _start_at_leftmost(areas: Areas) -> Areas:
    """Rotate each ring so that it starts at its leftmost point, the lowest if there are several."""
    if not areas.n_rings:
        return areas
    start, sizes = areas.ring_start[:-1], np.diff(areas.ring_start)
    x, y = areas.xy.T
    leftmost = x == np.repeat(np.minimum.reduceat(x, start), sizes)
    height = np.where(leftmost, y, np.inf)
    lowest = np.flatnonzero(height == np.repeat(np.minimum.reduceat(height, start), sizes))
    ring = np.searchsorted(areas.ring_start, lowest, side="right") - 1
    begin = np.zeros_like(start)
    begin[ring[::-1]] = lowest[::-1] - start[ring[::-1]]
    place = np.arange(len(x)) - np.repeat(start - begin, sizes)
    size = np.repeat(sizes, sizes)
    place -= np.where(place >= size, size, 0)
    return Areas(
        areas.xy.take(np.repeat(start, sizes) + place, axis=0),
        areas.ring_start,
        areas.ring_layer,
        areas.n_layers,
    )
