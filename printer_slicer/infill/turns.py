"""Rows joined into zigzags whose turns fill the corners that slanting borders leave beside them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from printer_slicer.geometry import Areas, Bool, Float, Int, Lines, row_ends

__all__ = ["zigzags"]

_AHEAD = 0.6  # spacings times the cosine of the angle between row and border: into the notch beside the turn
_END = 0.5  # of what a row without a turn would need to fill its end to the border
_BEND = 1.0  # spacings before its end from which on a row leaves its line
_LEAST = 0.05  # spacings: smaller bends are not worth a move


@dataclass(frozen=True, slots=True, eq=False)
class _Ends:
    """Ends of rows in the order of the zigzags (N,).

    Attributes:
        xy: (N, 2) mm.
        out: (N, 2) the row's direction, outward.
        edge: (N,) of the area, on which the end lies.
        gap: (N,) mm between rows.
        long: (N,) mm of the row.
    """

    xy: Float
    out: Float
    edge: Int
    gap: Float
    long: Float


def zigzags(rows: Lines, area: Areas, angle: Float, gap: Float, longest: float) -> tuple[Float, Int, Int]:
    """Zigzags, with more than one row where turns are no longer than `longest` spacings.

    Where the border slants, a turn along it has a sharp corner at the end of the longer row, and beyond that a notch
    stays open, up to the next row. That row bends toward it. An end without a turn reaches on toward the border.

    Args:
        rows: of a hatch of `area`.
        area: P entries; centre lines stay inside, but for ends without a turn.
        angle: (P,) radians, of the rows.
        gap: (P,) mm from row to row.
        longest: turn.

    Returns:
        xy (N, 2) mm, start (M + 1,) and entry (M,) of polylines.
    """
    end, start = row_ends(rows, max_turn=longest * gap)
    entry = rows.layer[end // 2]
    along = np.stack([np.cos(angle), np.sin(angle)], axis=1).take(entry, axis=0)
    ends = _Ends(
        rows.ends.reshape(-1, 2).take(end, axis=0),
        np.where((end % 2 == 1)[:, None], along, -along),
        rows.edge.ravel()[end],
        gap[entry],
        rows.length()[end // 2],
    )
    loose = np.zeros(len(end), np.bool_)
    loose[start[:-1]] = loose[start[1:] - 1] = True
    ahead = np.where(loose | _longer(ends), 1.0, 0.0)
    xy, bent = _reaching(ends, area, ahead, loose)
    return _with_bends(ends, xy, bent, start, entry)


def _longer(ends: _Ends) -> Bool:
    """(N,) whether the row reaches farther out than the one that its turn leads to."""
    partner = np.arange(len(ends.xy))
    # Points 2 i + 1 and 2 i + 2 lie at both sides of a turn; first and last ones of a path are not asked.
    partner[1::2] += 1
    partner[2::2] -= 1
    partner = np.minimum(partner, len(partner) - 1)
    return np.asarray(((ends.xy - ends.xy[partner]) * ends.out).sum(axis=1) > 0)


def _reaching(ends: _Ends, area: Areas, ahead: Float, loose: Bool) -> tuple[Float, Bool]:
    """(N, 2) ends moved on along the border, where it leads outward, and (N,) whether they were."""
    begin, after = area.xy[ends.edge], area.xy[area.following[ends.edge]]
    side = after - begin
    long = np.maximum(np.hypot(*side.T), 1e-12)
    side /= long[:, None]
    cosine = (side * ends.out).sum(axis=1)
    by = ahead * _AHEAD * ends.gap * np.abs(cosine)
    # On along this side of the border, no farther than to its end.
    into = ((ends.xy - begin) * side).sum(axis=1)
    room = np.maximum(np.where(cosine > 0, long - into, into), 0.0)
    step = np.minimum(by, room) * np.sign(cosine)
    xy = ends.xy + step[:, None] * side
    sine = np.sqrt(np.maximum(1 - cosine**2, 0.0))
    # Near a corner it would reach beyond the other side.
    far = np.where(loose & (room > by), _END * ends.gap / 2 / np.maximum(sine, 0.5), 0.0)
    xy += far[:, None] * ends.out
    return xy, np.asarray(np.abs(step) > _LEAST * ends.gap)


def _with_bends(ends: _Ends, xy: Float, bent: Bool, start: Int, entry: Int) -> tuple[Float, Int, Int]:
    """The zigzags with the places where rows leave their lines."""
    n = len(xy)
    bend = ends.xy - np.minimum(_BEND * ends.gap, ends.long / 2)[:, None] * ends.out
    # Before the second end of a row, after its first.
    where = np.stack([xy, xy], axis=1)
    first = np.arange(n) % 2 == 0
    where[first, 1] = bend[first]
    where[~first, 0] = bend[~first]
    kept = np.ones((n, 2), np.bool_)
    kept[first, 1] = bent[first]
    kept[~first, 0] = bent[~first]
    count = np.append(0, np.cumsum(kept.sum(axis=1)))
    return where.reshape(-1, 2)[kept.ravel()], count[start], entry[start[:-1]]
