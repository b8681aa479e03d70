"""Rows joined into zigzags by thin turns, which hold just what is missing beyond the ends of the rows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, consecutive, next_in_ring, previous_in_ring
from printer_slicer.geometry import Areas, Lines, row_ends

__all__ = ["LONGEST_TURN", "Zigzags", "room_beyond", "zigzags"]

# Spacings. A turn runs along the border, which meets the rows at any angle; under 27° it would be longer.
LONGEST_TURN = 2.2


@dataclass(frozen=True, slots=True, eq=False)
class Zigzags:
    """Rows and turns, one after the other; where one goes over into the other the same point stands twice.

    Attributes:
        xy: (N, 2) mm.
        start: (M + 1,) where each begins.
        entry: (M,) of the area that each fills.
        thin: (N,) whether the point is one of a turn.
    """

    xy: Float
    start: Int
    entry: Int
    thin: Bool

    @classmethod
    def plain(cls, rows: Lines, area: Areas, angle: Float, gap: Float, overlap: Float) -> Zigzags:
        """Join rows of a hatch by turns of the same width; other ends overlap the perimeter.

        Args:
            rows: hatch of `area`.
            area: P entries, the area to fill, inset by half a row.
            angle: (P,) radians, of the rows.
            gap: (P,) mm from row to row.
            overlap: (P,) mm by which ends without a turn reach farther.
        """
        end, start = row_ends(rows, max_turn=LONGEST_TURN * gap)
        entry = rows.layer[end // 2]
        xy = _reaching(rows, area, angle, end, np.where(_turning(end, start), 0.0, overlap[entry]))
        return cls(xy, start, entry[start[:-1]], np.zeros(len(xy), np.bool_))

    def take(self, chosen: Int) -> Zigzags:
        """Some of them, by number."""
        size = np.diff(self.start)[chosen]
        point = consecutive(self.start[chosen], size)
        return Zigzags(self.xy[point], np.append(0, np.cumsum(size)), self.entry[chosen], self.thin[point])

    def length(self) -> Float:
        """(M, 2) mm of rows and of turns in each."""
        step = np.hypot(*(self.xy[next_in_ring(self.start, False)] - self.xy).T)
        owner = np.repeat(np.arange(len(self.entry)), np.diff(self.start))
        kinds = (np.where(self.thin, 0.0, step), np.where(self.thin, step, 0.0))
        return np.stack([np.bincount(owner, kind, len(self.entry)) for kind in kinds], axis=1)


def zigzags(rows: Lines, area: Areas, angle: Float, gap: Float, turn: Float, *, overlap: Float) -> Zigzags:
    """Rows made longer toward the border, and joined along it.

    A turn as wide as the rows would lie on their ends with half of itself, and the place between it and the next turn
    would stay half empty. Rows that end half a turn before the border, whatever its angle, leave just as much room
    beyond them as every second gap's turn fills: all of it at any width, and the more evenly the narrower it is.

    Args:
        rows: hatch of `area`.
        area: P entries, the area to fill, inset by half a row.
        angle: (P,) radians, of the rows.
        gap: (P,) mm from row to row.
        turn: (P,) mm, spacing of the turns.
        overlap: (P,) mm by which ends without a turn reach farther at least.
    """
    end, start = row_ends(rows, max_turn=LONGEST_TURN * gap)
    entry = rows.layer[end // 2]
    inner = _turning(end, start)
    deep = (gap - turn)[entry] / 2
    xy = _reaching(rows, area, angle, end, np.where(inner, deep, np.maximum(deep, overlap[entry])))
    point = np.repeat(np.arange(len(end)), 1 + inner)
    first = np.diff(point, prepend=-1) > 0
    # A row is left at its second end, then the turn begins; the turn ends at the first one of the next row.
    thin = inner[point] & (first == (point % 2 == 0))
    return Zigzags(xy[point], np.append(0, np.cumsum(1 + inner))[start], entry[start[:-1]], thin)


def _turning(end: Int, start: Int) -> Bool:
    """(N,) which row ends belong to turns: all but the first and last of each zigzag."""
    inner = np.ones(len(end), np.bool_)
    inner[start[:-1]] = inner[start[1:] - 1] = False
    return inner


def _reaching(rows: Lines, area: Areas, angle: Float, end: Int, deep: Float) -> Float:
    """(N, 2) mm, row ends extended along their rows until they are `deep` (N,) mm beyond the border."""
    entry = rows.layer[end // 2]
    along = np.stack([np.cos(angle), np.sin(angle)], axis=1).take(entry, axis=0)
    out = np.where((end % 2 == 1)[:, None], along, -along)
    xy = rows.ends.reshape(-1, 2).take(end, axis=0)
    return np.asarray(xy + room_beyond(xy, out, area, rows.edge.ravel()[end], deep)[:, None] * out)


def room_beyond(xy: Float, out: Float, area: Areas, edge: Int, deep: Float) -> Float:
    """(N,) mm by which rows can go on without being `deep` (N,) mm beyond the edge they end on, or one beside it."""
    begin = area.xy
    side = begin[area.following] - begin
    side /= np.maximum(np.hypot(*side.T), 1e-12)[:, None]
    inward = np.stack([-side[:, 1], side[:, 0]], axis=1)
    sine = -(inward[edge] * out).sum(axis=1)
    # Where the border meets rows at a small angle they end as they are: beads along it fill what they leave.
    room = np.where(sine * LONGEST_TURN >= 1, deep / np.maximum(sine, 1e-12), 0.0)
    for other in (previous_in_ring(area.ring_start)[edge], area.following[edge]):
        # Only corners that stick out are in the way.
        turned = side[edge, 0] * side[other, 1] - side[edge, 1] * side[other, 0]
        convex = np.where(other == area.following[edge], turned, -turned) > 0
        nearing = -(inward[other] * out).sum(axis=1)
        left = ((xy - begin[other]) * inward[other]).sum(axis=1) + deep
        limit = np.where(convex & (nearing > 1e-9), left / np.maximum(nearing, 1e-9), np.inf)
        room = np.minimum(room, np.maximum(limit, 0.0))
    return room
