"""What ways turn around: the corners of outlines, and what crossing an outline costs."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from printer_slicer.arrays import Float, Int
from printer_slicer.geometry.segment_index import OutlineIndex
from printer_slicer.geometry.vectors import cross
from printer_slicer.model import Areas

__all__ = ["OFF", "Corners", "RoutingField"]

OFF = 0.002  # mm from the outlines, so that a way along them does not touch them
_SHARPEST = 0.5  # cosine of half the turn: sharper corners are not passed farther away
_COLUMNS = ("place", "tip", "away", "before", "after", "ring")


@dataclass(frozen=True, slots=True, eq=False)
class Corners:
    """Where outlines stick into where ways are sought.

    Attributes:
        place: (C, 2) mm, beside the corner.
        tip: (C, 2) mm, the corner.
        away: (C, 2) from the corner to its place, of length 1: it halves the angle in which ways lie.
        before, after: (C, 2) mm, the points of the outline before and after the corner.
        ring: (C,) of the outline.
    """

    place: Float
    tip: Float
    away: Float
    before: Float
    after: Float
    ring: Int

    @classmethod
    def inside(cls, areas: Areas, off: float = OFF) -> Corners:
        """Those that stick into areas, moved in so that ways from one to the next keep `off` mm away."""
        return cls._of(areas, -1, off)

    @classmethod
    def outside(cls, areas: Areas, off: float = OFF) -> Corners:
        """Those that stick out of areas, moved out likewise."""
        return cls._of(areas, 1, off)

    @classmethod
    def _of(cls, areas: Areas, hand: int, off: float) -> Corners:
        before, after = areas.xy[areas.previous], areas.xy[areas.following]
        coming, going = _unit(areas.xy - before), _unit(after - areas.xy)
        some = np.flatnonzero(hand * cross(coming, going) > 0)
        # As long as twice the sine of half the angle by which the outline turns there.
        turn = (coming - going)[some]
        away, cosine = _unit(turn), np.sqrt(np.maximum(1 - (turn**2).sum(axis=1) / 4, _SHARPEST**2))
        tip = areas.xy[some]
        place = tip + (off / cosine)[:, None] * away
        return cls(place, tip, away, before[some], after[some], areas.point_ring[some])

    def joined(self, other: Corners) -> Corners:
        """These and others."""
        return Corners(*(np.concatenate([getattr(self, name), getattr(other, name)]) for name in _COLUMNS))

    def take(self, some: Int) -> Corners:
        """Some of them."""
        return Corners(*(getattr(self, name)[some] for name in _COLUMNS))


@dataclass(frozen=True, slots=True, eq=False)
class RoutingField:
    """Fields in which ways are sought; a way stays in its own.

    Attributes:
        areas: whose rings stand in the way.
        outlines: of `areas`, to be asked.
        own: (R,) the field of each ring.
        corners: of the rings, by ring, then by x.
        toll: mm that a way may be longer to cross one outline less; inf: none is crossed.
        key: (C,) ascending, for searching corners by ring and x.
        pitch: from ring to ring in `key`.
    """

    areas: Areas
    outlines: OutlineIndex
    own: Int
    corners: Corners
    toll: float
    key: Float = field(init=False)
    pitch: float = field(init=False)

    def __post_init__(self) -> None:
        x = self.corners.place[:, 0]
        pitch = 4 * float(np.abs(x).max(initial=0.0)) + 1.0
        order = np.lexsort((x, self.corners.ring))
        corners = self.corners.take(order)
        object.__setattr__(self, "corners", corners)
        object.__setattr__(self, "key", corners.ring * pitch + x[order])
        object.__setattr__(self, "pitch", pitch)

    def between(self, low: Float, high: Float, ring: Int) -> tuple[Int, Int]:
        """(n,) the first corner of each ring (n,) with an x from `low` to `high` (n,), and how many there are."""
        room = self.pitch / 4  # beyond all corners, not yet at the next ring
        first = np.searchsorted(self.key, ring * self.pitch + np.clip(low, -room, room), side="left")
        last = np.searchsorted(self.key, ring * self.pitch + np.clip(high, -room, room), side="right")
        return np.asarray(first, np.int64), np.asarray(np.maximum(last - first, 0), np.int64)

    def met(self, begin: Float, end: Float, layer: Int) -> tuple[Int, Int]:
        """Which legs from `begin` to `end` (n, 2) on `layer` (n,) cross which rings: leg and ring for each time."""
        leg, edge, _ = self.outlines.crossed(begin, end, layer)
        return leg, self.areas.point_ring[edge]


def _unit(way: Float) -> Float:
    """(n, 2) ways of length 1; none stay none."""
    return np.asarray(way / np.maximum(np.hypot(*way.T), 1e-12)[:, None])
