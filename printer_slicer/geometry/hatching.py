"""Parallel lines across the areas of a whole stack, at given or at even distances, and their joining into zigzags."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, consecutive, per_layer
from printer_slicer.geometry.areas import Areas, Lines
from printer_slicer.geometry.connectivity import find_chain_ends
from printer_slicer.geometry.engine import offset
from printer_slicer.values import Struct

__all__ = [
    "HatchGrids",
    "chain_rows",
    "find_columns",
    "find_row_crossings",
    "hatch",
    "hatch_evenly",
    "row_ends",
]

_NARROWEST, _WIDEST = 0.7, 1.5  # limits of the row spacing, as a share of the usual spacing
_INSET = 2e-4  # mm; more than the engine's rounding


def hatch(areas: Areas, *, angle: float | Float, spacing: float | Float, phase: float | Float = 0.0) -> Lines:
    """Return the parts of parallel rows that lie within the areas.

    Row j of a layer runs in the direction `angle` at the distance (j + phase) * spacing to the left of the
    origin. Rows are fixed to the bed, not to the part, so they are aligned between islands and between layers with
    the same parameters. A point of an outline that lies on a row counts as below it. So a row along a lower side of
    an area lies in the area, a row along an upper side does not, and each row crosses each outline an even number
    of times.

    Args:
        areas: clean areas.
        angle: radians, one for all layers or one per layer.
        spacing: mm between rows, positive; infinite for layers without lines.
        phase: offset of the rows, in spacings.

    Returns:
        Lines ordered by layer, row, and position along the row, each from its smaller to its larger position.

    Raises:
        ValueError: an array has another length, or a spacing is not positive.
    """
    n = areas.n_layers
    spacings, phases = per_layer(spacing, n), per_layer(phase, n)
    if (spacings <= 0).any():
        raise ValueError("spacing must be positive")
    angles = per_layer(angle, n)
    axis = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    layer, row, u, edge = find_row_crossings(areas, axis, spacings, phases)
    if not len(u):
        return Lines(np.zeros((0, 2, 2)), layer, row, np.zeros((0, 2)), np.zeros((0, 2), np.int64))
    # Sorting by one key for layer, row and position takes a third of the time of sorting by three: rows are laid end
    # to end, with gaps. This rounds positions by less than 0.001 µm, which is below the grid of the outlines.
    rank = layer * (row.max() - row.min() + 1) + (row - row.min())
    order = np.argsort(rank * (u.max() - u.min() + 1.0) + (u - u.min()))
    layer, row, u = layer.take(order[::2]), row.take(order[::2]), u.take(order).reshape(-1, 2)
    edge = edge.take(order).reshape(-1, 2)
    long = np.flatnonzero(u[:, 1] > u[:, 0])
    layer, row = layer.take(long), row.take(long)
    u, edge = u.take(long, axis=0), edge.take(long, axis=0)
    v = ((row + phases[layer]) * spacings[layer])[:, None]
    cos, sin = axis[layer, :, None].transpose(1, 0, 2)
    return Lines(np.stack([u * cos - v * sin, u * sin + v * cos], axis=2), layer, row, u, edge)


def find_row_crossings(
    areas: Areas, axis: Float, spacing: Float, phase: Float
) -> tuple[Int, Int, Float, Int]:
    """Return layer, row, position along the row and edge of every crossing of an outline and a row."""
    layer = areas.point_layer
    (x, y), (cos, sin) = areas.xy.T, axis.take(layer, axis=0).T
    u = x * cos + y * sin
    # Heights in units of rows: row j is at j. Levels are integers, so crossings are decided without rounding.
    height = (y * cos - x * sin) / spacing[layer] - phase[layer]
    level = np.ceil(height).astype(np.int64)
    following = areas.following
    low, high = np.minimum(level, level[following]), np.maximum(level, level[following])
    row = consecutive(low, high - low)
    start = np.repeat(np.arange(len(u)), high - low)
    end = following[start]
    share = (row - height[start]) / (height[end] - height[start])
    return layer[start], row, u[start] + share * (u[end] - u[start]), start


def chain_rows(lines: Lines, *, max_turn: float | Float) -> tuple[Float, Int, Int]:
    """Join the lines of a hatch into zigzags over neighbouring rows.

    Two lines of neighbouring rows are joined if each is the only line of its row beside the other, and if the
    step from end to end is at most `max_turn`. The side of the first turn is chosen so that a zigzag gets the most
    joints. Both ends of a step lie on the outline, so no point of it is farther than `max_turn` / 2 outside the
    area. It leaves the area only where a notch or a gap passes between the two rows without reaching either.

    Args:
        lines: from `hatch`.
        max_turn: mm, one for all layers or one per layer.

    Returns:
        xy (N, 2) mm, start (M + 1,) and layer (M,): polyline i is `xy[start[i]:start[i + 1]]` and consists of the
        ends of its lines. Ordered by layer, then by the lowest line of each.
    """
    end, start = row_ends(lines, max_turn=max_turn)
    return lines.ends.reshape(-1, 2).take(end, axis=0), start, lines.layer[end[start[:-1]] // 2]


def row_ends(lines: Lines, *, max_turn: float | Float) -> tuple[Int, Int]:
    """Join lines as `chain_rows` does, but return indices of line ends instead of points.

    Returns:
        The line ends (N,), 2 i for the first and 2 i + 1 for the second end of line i, and the offset (M + 1,) of
        each polyline.
    """
    if not lines.n_lines:
        return np.zeros(0, np.int64), np.zeros(1, np.int64)
    above = _find_only_neighbours(lines)
    lowest, rank = _group_columns(lines, above)
    joined, backward = _choose_turns(lines, above, lowest, max_turn)
    order = np.lexsort((rank, lowest))
    begin = np.flatnonzero(np.append(True, ~joined[order][:-1]))
    sizes = np.diff(np.append(begin, len(order)))
    # Pieces of one zigzag are consecutive here. Their first lines give their order in the stack.
    pieces = np.argsort(order[begin])
    order = order[consecutive(begin[pieces], sizes[pieces])]
    end = (2 * order + backward[order])[:, None] ^ np.array([0, 1])
    return end.ravel(), np.append(0, np.cumsum(2 * sizes[pieces]))


def _find_only_neighbours(lines: Lines) -> Int:
    """Return the line (S,) beside each line in the next row, or -1 unless both lines have no other beside them."""
    changes = (np.diff(lines.row) != 0) | (np.diff(lines.layer) != 0)
    group = np.append(0, np.cumsum(changes))
    # One ascending key for row and position: rows are laid end to end, with gaps.
    low = lines.u.min()
    pitch = lines.u.max() - low + 1.0
    left, right = (lines.u - low + pitch * group[:, None]).T
    first = np.searchsorted(right, left + pitch, side="right")
    last = np.searchsorted(left, right + pitch, side="left")
    next_row = np.append(np.flatnonzero(changes) + 1, len(group))[group]
    exists = next_row < len(group)
    next_line = np.where(exists, next_row, 0)
    neighbours = exists & (lines.layer[next_line] == lines.layer) & (lines.row[next_line] == lines.row + 1)
    n_beside = np.where(neighbours, last - first, 0)
    has_neighbour = np.flatnonzero(n_beside > 0)
    steps = np.bincount(first[has_neighbour], minlength=len(group) + 1) - np.bincount(
        last[has_neighbour], minlength=len(group) + 1
    )
    beside_below = np.cumsum(steps)
    only = np.flatnonzero(n_beside == 1)
    only = only[beside_below[first[only]] == 1]
    above = np.full(len(group), -1)
    above[only] = first[only]
    return above


def find_columns(lines: Lines) -> tuple[Int, Int]:
    """Group the lines of neighbouring rows into columns, in which each line is the only one beside the next.

    Returns:
        The lowest line (S,) of the column of each line, and the number of rows (S,) from there to the line.
    """
    return _group_columns(lines, _find_only_neighbours(lines))


def _group_columns(lines: Lines, above: Int) -> tuple[Int, Int]:
    """Group lines into columns as `find_columns` does, given the line (S,) above each."""
    foot = np.arange(len(above))
    joinable = np.flatnonzero(above >= 0)
    foot[above[joinable]] = joinable
    foot = find_chain_ends(foot)
    return foot, lines.row - lines.row[foot]


def _choose_turns(lines: Lines, above: Int, lowest: Int, max_turn: float | Float) -> tuple[Bool, Bool]:
    """Return two masks (S,): lines that are joined to the line above them, and lines that are printed backward."""
    limit = np.asarray(max_turn, dtype=np.float64)
    limit = limit[lines.layer] if limit.ndim else limit
    step = lines.ends.take(above, axis=0) - lines.ends
    near = (above >= 0)[:, None] & (np.hypot(step[..., 0], step[..., 1]) <= np.reshape(limit, (-1, 1)))
    odd = (lines.row - lines.row[lowest]) % 2 == 1
    # Column 0: the lowest line is printed forward, so the zigzag turns at its right end first, then at the left.
    possible = np.where(odd[:, None], near, near[:, ::-1])
    joints = [np.bincount(lowest, weights=mask, minlength=len(lowest)) for mask in possible.T]
    start_backward = (joints[1] > joints[0])[lowest]
    return np.where(start_backward, possible[:, 1], possible[:, 0]), odd ^ start_backward


class HatchGrids(Struct, frozen=True, eq=False):
    """Hatch grids of P pieces, each (P,): angle in radians, row spacing in mm, and phase in rows; see `hatch`."""

    angle: Float
    step: Float
    phase: Float

    def clip_rows(self, areas: Areas) -> Lines:
        """Return the parts of the rows that lie inside the areas (P entries)."""
        return hatch(areas, angle=self.angle, spacing=self.step, phase=self.phase)


def hatch_evenly(areas: Areas, angle: Float, gap: Float) -> tuple[Lines, Areas, Float, HatchGrids]:
    """Hatch each area with a whole number of rows, whose outermost are half a spacing inside its borders.

    Args:
        areas: P entries.
        angle: (P,) radians.
        gap: (P,) mm, usual distance between rows; it changes to 0.7 to 1.5 of that.

    Returns:
        Rows, areas of their centre lines (P entries), (P,) distance between rows in mm, and the grid.
    """
    low, high = _extents_across(areas, angle)
    count = np.maximum(np.rint((high - low) / gap), 1)
    gap = np.clip((high - low) / count, _NARROWEST * gap, _WIDEST * gap)
    # Centre lines stay half a width inside. The outermost rows would lie on the border, where rounding could lose
    # them, so they are moved inward a little.
    area = offset(areas, -gap / 2)
    first = np.where(count > 1, low + gap / 2 + _INSET, (low + high) / 2)
    step = np.where(count > 1, (high - low - gap - 2 * _INSET) / np.maximum(count - 1, 1), gap)
    grid = HatchGrids(angle, step, first / step)
    return grid.clip_rows(area), area, gap, grid


def _extents_across(areas: Areas, angle: Float) -> tuple[Float, Float]:
    """Return the extent (P,) of each piece perpendicular to its rows: lowest and highest position, mm."""
    if not areas.n_rings:
        return np.zeros(areas.n_layers), np.zeros(areas.n_layers)
    owner = areas.point_layer
    (x, y), turn = areas.xy.T, angle[owner]
    across = y * np.cos(turn) - x * np.sin(turn)
    start = np.searchsorted(owner, np.arange(areas.n_layers)).astype(np.int64)
    low: Float = np.minimum.reduceat(across, start)
    high: Float = np.maximum.reduceat(across, start)
    return low, high
