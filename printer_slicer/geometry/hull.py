"""Convex hull of points."""

from __future__ import annotations

from printer_slicer.arrays import Float
from printer_slicer.geometry.areas import Areas

__all__ = ["convex_hull"]


def convex_hull(points: Float) -> Areas:
    """Return the convex hull of points (N, 2) as a stack of one layer; empty if they span no area."""
    from printer_slicer.geometry import planar  # noqa: PLC0415 - loads shapely only if needed

    return planar.convex_hull(points)
