"""Threads of bridges whose ends are held by the walls, where these stand at their ends."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from printer_slicer.geometry import (
    Areas,
    Float,
    Lines,
    Pieces,
    difference,
    hatch,
    offset,
    offset_open,
    row_ends,
)
from printer_slicer.geometry.areas import run_begins
from printer_slicer.infill.turns import LONGEST_TURN, Zigzags

__all__ = ["Grid", "held_threads", "way_to_walls"]

_SLIVER = 0.01  # mm: half the width of what rounding leaves between areas that touch
_SLACK = 1.05  # of the longest way: outlines of curves have corners


@dataclass(frozen=True, slots=True, eq=False)
class Grid:
    """Where rows of P pieces lie: (P,) radians, mm from row to row, and the phase in rows; see `hatch`."""

    angle: Float
    step: Float
    phase: Float

    def rows(self, areas: Areas) -> Lines:
        """The parts of the rows that lie in areas (P entries)."""
        return hatch(areas, angle=self.angle, spacing=self.step, phase=self.phase)


def held_threads(rows: Lines, way: Float, gap: Float, angle: Float) -> Zigzags:
    """Rows joined into threads that begin and end in the walls. Turns stay where they are: they lie along the walls.

    Args:
        rows: of P pieces.
        way: (S, 2) mm from the ends of each to the wall, as `way_to_walls` gives it.
        gap: (P,) mm between rows.
        angle: (P,) radians.
    """
    end, start = row_ends(rows, max_turn=LONGEST_TURN * gap)
    xy, piece = rows.ends.reshape(-1, 2).take(end, axis=0), rows.layer[end[start[:-1]] // 2]
    loose = np.concatenate([start[:-1], start[1:] - 1])
    turn = np.tile(angle[piece], 2)
    xy[loose] += way.ravel()[end[loose], None] * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    return Zigzags(xy, start, piece, np.zeros(len(xy), np.bool_))


def way_to_walls(rows: Lines, grid: Grid, pieces: Pieces, inside: Areas, apart: Float) -> Float:
    """(S, 2) mm along the rows from both ends of each to where the wall's share begins; 0 where they stay.

    They stay beside other regions, which have beads of their own at the border, and where a row meets the wall at so
    small an angle that none turns there: a bead lies along it.

    Args:
        rows: of the grid, in what of the pieces is `apart` from their borders.
        grid: where rows lie.
        pieces: areas.
        inside: what the walls leave, by layer.
        apart: (P,) mm.
    """
    apart = np.maximum(apart, 0.0)
    others = offset_open(difference(pieces.beside(inside), pieces.areas), _SLIVER)
    longest = grid.rows(difference(pieces.areas, offset(others, apart)))
    if not rows.n_lines or not longest.n_lines:
        return np.zeros((rows.n_lines, 2))
    # One key for piece, row and place: rows lie behind each other.
    both = np.concatenate([rows.row, longest.row])
    low, span = float(longest.u.min()), float(np.ptp(longest.u)) + 1.0
    row = np.concatenate([rows.layer, longest.layer]) * (np.ptp(both) + 1) + both - both.min()
    middle = row[: rows.n_lines] * span + rows.u.mean(axis=1) - low
    begin, finish = row[rows.n_lines :] * span + longest.u.T - low
    own = np.maximum(np.searchsorted(begin, middle, side="right") - 1, 0)
    within = (begin[own] <= middle) & (middle <= finish[own])
    # Where a wall parts a row for a short way only, its ends beside that stay.
    first = run_begins(own)
    outermost = np.stack([first, np.append(first[1:], True)], axis=1)
    way = longest.u[own] - rows.u
    near = np.abs(way) <= _SLACK * LONGEST_TURN * apart[rows.layer, None]
    return np.where(outermost & near & within[:, None], way, 0.0)
