"""The convex hull of points."""

from __future__ import annotations

from printer_slicer.arrays import Float
from printer_slicer.geometry.areas import Areas

__all__ = ["convex_hull"]


def convex_hull(points: Float) -> Areas:
    """The smallest convex area around points (N, 2), as a stack of one layer; empty where they span no area."""
    from printer_slicer.geometry import planar  # noqa: PLC0415 - shapely only when it is needed

    return planar.convex_hull(points)
