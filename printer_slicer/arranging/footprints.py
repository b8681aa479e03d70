"""Footprints of parts on a raster, in every rotation that is tried.

A cell belongs to a footprint if the part touches it, so parts whose cells are disjoint are disjoint, too.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.geometry import Areas, offset
from printer_slicer.geometry.facet_topology import expand_counts
from printer_slicer.geometry.raster import CellGrid, rasterize_areas
from printer_slicer.geometry.vectors import cosine_and_sine
from printer_slicer.values import Struct, replace

__all__ = ["Footprint", "find_touched_cells", "list_footprints", "rotate_outline"]

_ROUND_ERROR = 0.01  # mm; by so much a rounded outline may lie inside the true one


class Footprint(Struct, frozen=True, eq=False):
    """The cells that a rotated part needs; cell (0, 0) begins at the lowest x and y of its box.

    Attributes:
        angle: degrees about z.
        corner: (2,) lowest x and y of the rotated outline, mm.
        size: (2,) of its box, mm.
        touched: (rows, columns) cells that the part touches.
        kept_free: (rows + 2 n, columns + 2 n) cells that are nearer than the gap to it; begins n cells lower.
        margin: n, the number of cells around the part.
    """

    angle: float
    corner: Float
    size: Float
    touched: Bool
    kept_free: Bool
    margin: int


def list_footprints(outline: Areas, angles: Sequence[float], gap: float, cell: float) -> list[Footprint]:
    """Return the footprint of a part in each rotation in which it differs from the earlier ones.

    Args:
        outline: one layer, the part as seen from above, mm.
        angles: degrees about z.
        gap: smallest distance to other parts, mm.
        cell: side of a cell, mm.
    """
    reach = gap + _ROUND_ERROR
    wide = offset(outline, reach, join="round") if gap else outline
    turned = [(angle, rotate_outline(outline, angle), rotate_outline(wide, angle)) for angle in angles]
    made = (_make_footprint(own, around, angle, reach, cell) for angle, own, around in turned)
    # A symmetric part has the same footprint in several rotations; the first is enough.
    known: dict[tuple[object, ...], Footprint] = {}
    for one in made:
        known.setdefault((one.touched.shape, one.touched.tobytes(), one.kept_free.tobytes()), one)
    return list(known.values())


def rotate_outline(outline: Areas, angle: float) -> Areas:
    """Return areas rotated about the origin; degrees, counter-clockwise; quarter turns are exact."""
    c, s = cosine_and_sine(angle)
    x, y = outline.xy.T
    return replace(outline, xy=np.stack([c * x - s * y, s * x + c * y], axis=1))


def _make_footprint(outline: Areas, wide: Areas, angle: float, reach: float, cell: float) -> Footprint:
    """Return the footprint of a rotated outline, and of the area `wide` within `reach` around it."""
    low, high = (corner[0] for corner in outline.boxes())
    columns, rows = np.maximum(np.ceil((high - low) / cell - 1e-9), 1).astype(np.int64).tolist()
    margin = int(np.ceil(reach / cell))
    grid = CellGrid(float(low[0]), float(low[1]), cell, rows, columns)
    x, y = (low - margin * cell).tolist()
    border = CellGrid(x, y, cell, rows + 2 * margin, columns + 2 * margin)
    own, kept_free = find_touched_cells(outline, grid), find_touched_cells(wide, border)
    return Footprint(angle, low, high - low, own, kept_free, margin)


def find_touched_cells(areas: Areas, grid: CellGrid) -> Bool:
    """Return the mask (n_rows, n_columns) of the cells that areas of one layer touch."""
    touched: Bool = rasterize_areas(areas, grid)[0]
    rows, columns = _list_edge_cells(areas, grid)
    inside = (rows >= 0) & (rows < grid.n_rows) & (columns >= 0) & (columns < grid.n_columns)
    touched[rows[inside], columns[inside]] = True
    return touched


def _list_edge_cells(areas: Areas, grid: CellGrid) -> tuple[Int, Int]:
    """Return the rows and columns (n,) of all cells through which outlines pass.

    An outline changes cells where it crosses a line of the grid, so the middle of each piece between two crossings
    lies in the cell of that piece.
    """
    begin = (areas.xy - (grid.x, grid.y)) / grid.cell
    step = begin[areas.following] - begin
    edges, shares = [np.arange(len(begin))], [np.zeros(len(begin))]
    for axis in (0, 1):
        first = np.minimum(begin[:, axis], begin[:, axis] + step[:, axis])
        last = np.maximum(begin[:, axis], begin[:, axis] + step[:, axis])
        count = np.maximum(np.floor(last) - np.ceil(first) + 1, 0).astype(np.int64)
        edge, nth = expand_counts(count)
        line = np.ceil(first)[edge] + nth
        moved = step[edge, axis]
        edges.append(edge)
        shares.append(np.where(moved == 0, 0.0, (line - begin[edge, axis]) / np.where(moved == 0, 1, moved)))
    edge, share = np.concatenate(edges), np.clip(np.concatenate(shares), 0, 1)
    order = np.lexsort((share, edge))
    edge, share = edge[order], share[order]
    is_last = np.append(edge[1:] != edge[:-1], True)
    following = np.where(is_last, 1.0, np.append(share[1:], 1.0))
    middle = begin[edge] + step[edge] * ((share + following) / 2)[:, None]
    # A point on a line of the grid lies in the cells on both sides.
    low, high = np.floor(middle - 1e-9).astype(np.int64), np.floor(middle + 1e-9).astype(np.int64)
    return np.concatenate([low[:, 1], high[:, 1]]), np.concatenate([low[:, 0], high[:, 0]])
