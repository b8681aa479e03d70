"""Extend bridge lines into the walls at their ends."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Float, run_starts
from printer_slicer.geometry import (
    Areas,
    ConnectedAreas,
    HatchGrids,
    Lines,
    difference,
    offset,
    offset_open,
    row_ends,
)
from printer_slicer.infill.connections import MAX_CONNECTION, Zigzags

__all__ = ["join_bridge_lines", "measure_extensions"]

_HALF_SLIVER = 0.01  # mm: half the width of gaps that rounding leaves between touching areas
_SLACK = 1.05  # of the longest extension, because curves are polygons


def join_bridge_lines(rows: Lines, extension: Float, gap: Float, angle: Float) -> Zigzags:
    """Join rows into bridge lines that start and end in the walls; the turns between rows stay beside the walls.

    Args:
        rows: of P pieces.
        extension: (S, 2) mm from both ends of each row to the end in the wall, see `measure_extensions`.
        gap: (P,) mm between rows.
        angle: (P,) radians.
    """
    end, start = row_ends(rows, max_turn=MAX_CONNECTION * gap)
    xy, piece = rows.ends.reshape(-1, 2).take(end, axis=0), rows.layer[end[start[:-1]] // 2]
    loose = np.concatenate([start[:-1], start[1:] - 1])
    turn = np.tile(angle[piece], 2)
    xy[loose] += extension.ravel()[end[loose], None] * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    return Zigzags(xy, start, piece, np.zeros(len(xy), np.bool_))


def measure_extensions(
    rows: Lines, grid: HatchGrids, pieces: ConnectedAreas, inside: Areas, distance: Float
) -> Float:
    """Return how far both ends of each row extend into the wall, (S, 2) mm; 0 where they do not.

    Rows do not extend into other regions, which have their own lines at the border. Nor do they extend where they meet
    the wall at a small angle, because a line runs along the wall there.

    Args:
        rows: rows of the grid, inside the pieces and `distance` from their borders.
        grid: hatch grids.
        pieces: areas.
        inside: area inside the walls, by layer.
        distance: (P,) mm between rows and borders.
    """
    distance = np.maximum(distance, 0.0)
    others = offset_open(difference(pieces.select_nearby_rings(inside), pieces.areas), _HALF_SLIVER)
    longest = grid.clip_rows(difference(pieces.areas, offset(others, distance)))
    if not rows.n_lines or not longest.n_lines:
        return np.zeros((rows.n_lines, 2))
    # One sort key for piece, row and position along the row.
    both = np.concatenate([rows.row, longest.row])
    low, span = float(longest.u.min()), float(np.ptp(longest.u)) + 1.0
    row = np.concatenate([rows.layer, longest.layer]) * (np.ptp(both) + 1) + both - both.min()
    middle = row[: rows.n_lines] * span + rows.u.mean(axis=1) - low
    begin, finish = row[rows.n_lines :] * span + longest.u.T - low
    own = np.maximum(np.searchsorted(begin, middle, side="right") - 1, 0)
    within = (begin[own] <= middle) & (middle <= finish[own])
    # Where a thin wall interrupts a row, the ends beside it do not extend.
    first = run_starts(own)
    outermost = np.stack([first, np.append(first[1:], True)], axis=1)
    way = longest.u[own] - rows.u
    near = np.abs(way) <= _SLACK * MAX_CONNECTION * distance[rows.layer, None]
    return np.where(outermost & near & within[:, None], way, 0.0)
