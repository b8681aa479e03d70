"""Search tree for the segments of polylines, with the compiled kernel where there is one."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from printer_slicer.arrays import Float, Int
from printer_slicer.kernel import load_kernel

if TYPE_CHECKING:
    from printer_slicer.geometry import planar

__all__ = ["PolylineTree"]


class PolylineTree:
    """Search tree for the segments of polylines, each near the one before it."""

    def __init__(self, ends: Float) -> None:
        """Build the tree from the ends (S, 2, 2) of at least one segment."""
        self._ends: Float = np.ascontiguousarray(ends, np.float64)
        self._kernel = load_kernel()
        self._boxes = self._kernel.build_polyline_tree(self._ends.data) if self._kernel else b""

    def nearest(self, points: Float) -> Int:
        """Return the segment (P,) nearest to each point (P, 2), the first of several."""
        if not self._kernel:
            return self._planar.first_nearest(points)
        points = np.ascontiguousarray(points, np.float64)
        return np.frombuffer(
            self._kernel.nearest_segments(self._ends.data, self._boxes, points.data), np.int64
        )

    def query_boxes(self, low: Float, high: Float) -> tuple[Int, Int]:
        """Return index pairs (box, segment) where the bounding box of a segment touches a box `low`-`high` (B, 2).

        The pairs are sorted by box. The two corners of a box may be any two opposite ones.
        """
        if not self._kernel:
            return self._planar.query_boxes(low, high)
        corners = np.concatenate([low, high], axis=1)
        box, segment = self._kernel.query_polyline_tree(self._ends.data, self._boxes, corners.data)
        return np.frombuffer(box, np.int64), np.frombuffer(segment, np.int64)

    @cached_property
    def _planar(self) -> planar.SegmentTree:
        from printer_slicer.geometry import planar  # noqa: PLC0415 - shapely only when it is needed

        return planar.SegmentTree(self._ends)
