"""What ways turn around: the corners of outlines, and what crossing an outline costs."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from printer_slicer.geometry.nearest import Outlines
from printer_slicer.geometry.vectors import cross
from printer_slicer.model import Areas, Float, Int

__all__ = ["OFF", "Corners", "Ground"]

OFF = 0.002  # mm from the outlines, so that a way along them does not touch them
_SHARPEST = 0.5  # cosine of half the turn: sharper corners are not passed farther away
_COLUMNS = ("place", "tip", "away", "before", "after", "owner")


@dataclass(frozen=True, slots=True, eq=False)
class Corners:
    """Where outlines stick into where ways are sought.

    Attributes:
        place: (C, 2) mm, just beside the corner.
        tip: (C, 2) mm, the corner.
        away: (C, 2) from the corner through there, of length 1: it halves the angle in which ways lie.
        before, after: (C, 2) mm, the points of the outline before and after the corner.
        owner: (C,) what the outline belongs to.
    """

    place: Float
    tip: Float
    away: Float
    before: Float
    after: Float
    owner: Int

    @classmethod
    def of(cls, areas: Areas, owner: Int) -> Corners:
        """Those that stick into areas; `owner` (R,) of each ring, -1 of rings without any."""
        return cls._of(areas, owner, -1, OFF)

    @classmethod
    def around(cls, areas: Areas, owner: Int, off: float) -> Corners:
        """Those of areas that stick out of them, moved out so that ways from one to the next keep `off` mm away."""
        return cls._of(areas, owner, 1, off)

    @classmethod
    def _of(cls, areas: Areas, owner: Int, hand: int, off: float) -> Corners:
        before, after = areas.xy[areas.previous], areas.xy[areas.following]
        coming, going = _unit(areas.xy - before), _unit(after - areas.xy)
        of_point = owner[areas.point_ring]
        some = np.flatnonzero((hand * cross(coming, going) > 0) & (of_point >= 0))
        away = (coming - going)[some]
        # As long as twice the sine of half the angle by which the outline turns there.
        away, cosine = _unit(away), np.sqrt(np.maximum(1 - (away**2).sum(axis=1) / 4, _SHARPEST**2))
        tip = areas.xy[some]
        place = tip + (off / cosine)[:, None] * away
        return cls(place, tip, away, before[some], after[some], of_point[some])

    def joined(self, other: Corners) -> Corners:
        """These and others."""
        return Corners(*(np.concatenate([getattr(self, name), getattr(other, name)]) for name in _COLUMNS))

    def take(self, some: Int) -> Corners:
        """Some of them."""
        return Corners(*(getattr(self, name)[some] for name in _COLUMNS))


@dataclass(frozen=True, slots=True, eq=False)
class Ground:
    """Fields in which ways are sought; a way stays in its own.

    Attributes:
        corners: by field, then by x.
        layer: (G,) of each field.
        outlines: that ways may not cross, or not for nothing.
        toll: mm that a way may be longer to cross one outline less; inf: none is crossed.
        start: (G + 1,) the corners of field `i` are `start[i]:start[i + 1]`.
        key: (C,) ascending, for searching corners by field and x.
        pitch: from field to field in `key`.
    """

    corners: Corners
    layer: Int
    outlines: Outlines
    toll: float
    start: Int = field(init=False)
    key: Float = field(init=False)
    pitch: float = field(init=False)

    def __post_init__(self) -> None:
        x = self.corners.place[:, 0]
        pitch = 4 * float(np.abs(x).max(initial=0.0)) + 1.0
        order = np.lexsort((x, self.corners.owner))
        corners = self.corners.take(order)
        object.__setattr__(self, "corners", corners)
        object.__setattr__(self, "start", np.searchsorted(corners.owner, np.arange(len(self.layer) + 1)))
        object.__setattr__(self, "key", corners.owner * pitch + x[order])
        object.__setattr__(self, "pitch", pitch)

    def between(self, low: Float, high: Float, own: Int) -> tuple[Int, Int]:
        """(W,) the first corner with an x from `low` to `high` (W,) in the field `own` (W,), and one after the last."""
        room = self.pitch / 4  # beyond all corners, not yet in the next field
        first = np.searchsorted(self.key, own * self.pitch + np.clip(low, -room, room), side="left")
        last = np.searchsorted(self.key, own * self.pitch + np.clip(high, -room, room), side="right")
        return np.asarray(first, np.int64), np.asarray(np.maximum(last, first), np.int64)

    def cost(self, begin: Float, end: Float, own: Int) -> Float:
        """(n,) mm of each leg, with its tolls; inf where it may not go."""
        hits = self.outlines.crossings(begin, end, self.layer[own])
        length = np.hypot(*(end - begin).T)
        return np.asarray(length + np.where(hits > 0, self.toll * np.maximum(hits, 1), 0.0))


def _unit(way: Float) -> Float:
    """(n, 2) ways of length 1; none stay none."""
    return np.asarray(way / np.maximum(np.hypot(*way.T), 1e-12)[:, None])
