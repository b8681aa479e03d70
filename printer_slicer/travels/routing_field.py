"""Routing field: corners of outlines at which routes turn, and the cost of crossing an outline."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Float, Int
from printer_slicer.geometry.segment_index import OutlineIndex
from printer_slicer.geometry.vectors import cross
from printer_slicer.model import Areas
from printer_slicer.values import Struct

__all__ = ["OFF", "SHARPEST", "Corners", "RoutingField"]

OFF = 0.002  # mm from the outlines, so that a route along them does not touch them
SHARPEST = 0.5
"""Cosine of half the turn; sharper corners are passed no farther away than at this angle."""

_COLUMNS = ("place", "tip", "away", "before", "after", "ring")


class Corners(Struct, frozen=True, eq=False):
    """Corners of outlines around which routes may turn.

    Attributes:
        place: (C, 2) mm, position beside the corner at which a route turns.
        tip: (C, 2) mm, the corner.
        away: (C, 2) unit vector from the corner to its place, which bisects the angle outside the corner.
        before, after: (C, 2) mm, the points of the outline before and after the corner.
        ring: (C,) ring of the corner.
    """

    place: Float
    tip: Float
    away: Float
    before: Float
    after: Float
    ring: Int

    @classmethod
    def inside(cls, areas: Areas, off: float = OFF) -> Corners:
        """Return the concave corners of areas, for routes inside; turning points are `off` mm from the outlines."""
        return cls._find_corners(areas, -1, off)

    @classmethod
    def outside(cls, areas: Areas, off: float = OFF) -> Corners:
        """Return the convex corners of areas, for routes outside; turning points are `off` mm from the outlines."""
        return cls._find_corners(areas, 1, off)

    @classmethod
    def _find_corners(cls, areas: Areas, sign: int, off: float) -> Corners:
        """Return convex (sign 1) or concave (sign -1) corners of areas; turning points are `off` mm from outlines."""
        before, after = areas.xy[areas.previous], areas.xy[areas.following]
        coming, going = _normalize(areas.xy - before), _normalize(after - areas.xy)
        some = np.flatnonzero(sign * cross(coming, going) > 0)
        # Its length is twice the sine of half the angle by which the outline turns.
        turn = (coming - going)[some]
        away, cosine = _normalize(turn), np.sqrt(np.maximum(1 - (turn**2).sum(axis=1) / 4, SHARPEST**2))
        tip = areas.xy[some]
        place = tip + (off / cosine)[:, None] * away
        return cls(place, tip, away, before[some], after[some], areas.point_ring[some])

    def joined(self, other: Corners) -> Corners:
        """Return these corners followed by the corners of `other`."""
        return Corners(*(np.concatenate([getattr(self, name), getattr(other, name)]) for name in _COLUMNS))

    def take(self, indices: Int) -> Corners:
        """Return the corners with the given indices."""
        return Corners(*(getattr(self, name)[indices] for name in _COLUMNS))


class RoutingField(Struct, frozen=True, eq=False):
    """Fields in which routes are searched; each route stays in one field.

    Attributes:
        areas: areas whose rings are obstacles.
        outlines: search index of the outlines of `areas`.
        own: (R,) field of each ring.
        corners: corners of the rings, sorted by ring, then by x.
        toll: mm by which a route may be longer to cross one outline less; inf if no outline may be crossed.
        key: (C,) ascending, for searching corners by ring and x.
        pitch: offset from ring to ring in `key`.
    """

    areas: Areas
    outlines: OutlineIndex
    own: Int
    corners: Corners
    toll: float
    key: Float
    pitch: float

    @classmethod
    def of(
        cls, areas: Areas, outlines: OutlineIndex, own: Int, corners: Corners, toll: float
    ) -> RoutingField:
        """Return the field with its corners sorted."""
        x = corners.place[:, 0]
        pitch = 4 * float(np.abs(x).max(initial=0.0)) + 1.0
        order = np.lexsort((x, corners.ring))
        corners = corners.take(order)
        return cls(areas, outlines, own, corners, toll, corners.ring * pitch + x[order], pitch)

    def find_corners_between(self, low: Float, high: Float, ring: Int) -> tuple[Int, Int]:
        """Return the first corner (n,) with x from `low` to `high` (n,) on each ring (n,), and their number (n,)."""
        room = self.pitch / 4  # beyond all corners, but before the next ring
        first = np.searchsorted(self.key, ring * self.pitch + np.clip(low, -room, room), side="left")
        last = np.searchsorted(self.key, ring * self.pitch + np.clip(high, -room, room), side="right")
        return np.asarray(first, np.int64), np.asarray(np.maximum(last - first, 0), np.int64)

    def find_crossed_rings(self, begin: Float, end: Float, layer: Int) -> tuple[Int, Int]:
        """Return a pair (leg, ring) for each crossing of a leg from `begin` to `end` (n, 2) on `layer` (n,)."""
        leg, edge, _ = self.outlines.find_crossings(begin, end, layer)
        return leg, self.areas.point_ring[edge]


def _normalize(vectors: Float) -> Float:
    """Return vectors (n, 2) scaled to length 1; zero vectors stay zero."""
    return np.asarray(vectors / np.maximum(np.hypot(*vectors.T), 1e-12)[:, None])
