"""Compute on a coarse raster of cells, level by level, where branches of trees can go.

Slabs are ranges of heights, all equally high; level f is the plane under slab f. A branch stands at the middle of a
cell on each level and moves sideways to another cell within each slab. A single field tells for all radii where a
branch can get from: its value is the radius of the thickest branch that still reaches the bed.
"""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, distinct
from printer_slicer.geometry.raster import (
    NEIGHBOUR_CELLS,
    CellGrid,
    Float32,
    cheapest_within,
    clearance,
    highest_within,
    rasterize_areas,
)
from printer_slicer.model import Sections
from printer_slicer.supports.tree_settings import TreeSettings
from printer_slicer.values import Struct

__all__ = ["BranchRoutes", "CellMoves", "ReachFields", "build_fields", "find_branch_routes"]

CELL = 0.5  # mm
SLAB_RATIO = 3.0  # height of a slab, in cells
_MAX_CELLS = 6e6  # in all slabs; large parts get larger cells
_MARGIN = 15.0  # mm around the part in which branches may go
_HALF_DIAGONAL = 0.35  # cells; the outline of a solid may pass beside the middles of its cells
_MAX_UNEVEN = 0.6  # mm by which a horizontal surface may vary between cells
_STEEP_PRICE = 5.0  # times the price of standing on a horizontal surface
_STEEPEST = (
    1.1  # mm by which a surface may vary between cells around a branch that stands on it, about 40 degrees
)


class CellMoves(Struct, frozen=True, eq=False):
    """The moves of a branch from level to level.

    Attributes:
        step: (M, 2) rows and columns, the shortest first.
        aside: (M,) movement sideways, mm.
        length: (M,) length of the branch, mm.
    """

    step: Int
    aside: Float
    length: Float

    @classmethod
    def within(cls, aside: float, slab: float, cell: float) -> CellMoves:
        """Return all moves by at most `aside` mm sideways within a slab."""
        reach = int(aside / cell + 1e-9)
        line = np.arange(-reach, reach + 1)
        step = np.stack(np.meshgrid(line, line, indexing="ij"), axis=-1).reshape(-1, 2)
        squares = (step**2).sum(axis=1)
        order = np.argsort(squares, kind="stable")
        order = order[squares[order] * cell**2 <= aside**2 + 1e-9]
        by = np.sqrt(squares[order]) * cell
        return cls(step[order], by, np.hypot(by, slab))


class BranchRoutes(Struct, frozen=True, eq=False):
    """How thick branches from each cell may be, and how long they get, all (F, n_rows, n_columns), mm.

    Attributes:
        radius: the thickest branch that reaches its end from each cell; below 0: none.
        free: the thickest branch that may come down to the cell and goes on from there.
        price: length of the cheapest branch to its end, with the price of standing on the part; inf: none.
    """

    radius: Float32
    free: Float32
    price: Float32


class ReachFields(Struct, frozen=True, eq=False):
    """The part on the raster, and the ways that branches may go.

    Attributes:
        grid: the cells.
        slab: height of each slab, mm.
        moves: from level to level.
        solid: (F, n_rows, n_columns) where the part is in the slab above each level.
        clear: (F, n_rows, n_columns) the thickest branch that keeps its distance there, mm.
        end_radius: (F, n_rows, n_columns) the thickest branch that may end on the part's surface under the level, mm.
        end_price: (F, n_rows, n_columns) length of branch that must be saved for ending there on the part, mm.
        surface: (F, n_rows, n_columns) z of the highest surface of the part under each level, mm; -inf: none.
        to_bed: ways that end on the bed.
        to_any: ways that end on the bed or on the part.
    """

    grid: CellGrid
    slab: float
    moves: CellMoves
    solid: Bool
    clear: Float32
    end_radius: Float32
    end_price: Float32
    surface: Float32
    to_bed: BranchRoutes
    to_any: BranchRoutes

    @property
    def n_levels(self) -> int:
        """Number of levels."""
        return len(self.solid)

    def find_levels(self, z: Float) -> Int:
        """Return the slab (n,) in which each z (n,) lies."""
        level = np.floor(z / self.slab + 1e-6).astype(np.int64)
        return np.asarray(np.clip(level, 0, self.n_levels - 1))


def build_fields(
    sections: Sections, highest: float, bed: tuple[Float, Float], settings: TreeSettings
) -> ReachFields:
    """Compute the fields for tips up to the height `highest`, mm.

    Args:
        sections: the part.
        highest: z of the highest tip, mm.
        bed: lowest and highest corner (2,) of the bed, mm.
        settings: of trees.
    """
    grid, slab = _choose_grid(sections, highest, bed)
    n_levels = int(highest / slab + 1e-6) + 1
    solid, tops = _rasterize_slabs(sections, grid, slab, n_levels)
    surface = _find_surfaces(tops)
    margin = np.float32(settings.xy_gap + _HALF_DIAGONAL * grid.cell)
    reach = settings.largest_radius + float(margin)
    clear = _measure_clearance(solid, grid.cell, reach) - margin
    end_radius, end_price = np.full_like(clear, -1.0), np.full_like(clear, settings.scar_price)
    if not settings.on_bed_only:
        end_radius, horizontal = (
            one - margin for one in _measure_end_clearance((solid, surface), grid.cell, reach)
        )
        end_price[horizontal < settings.tip_radius] *= _STEEP_PRICE
    moves = CellMoves.within(settings.slope * slab, slab, grid.cell)
    on_bed = _measure_bed(grid, bed, settings.largest_radius)
    to_bed = find_branch_routes(clear, (np.full_like(end_radius, -1.0), end_price), on_bed, moves, settings)
    to_any = (
        find_branch_routes(clear, (end_radius, end_price), on_bed, moves, settings)
        if (end_radius > 0).any()
        else to_bed
    )
    return ReachFields(grid, slab, moves, solid, clear, end_radius, end_price, surface, to_bed, to_any)


def _choose_grid(sections: Sections, highest: float, bed: tuple[Float, Float]) -> tuple[CellGrid, float]:
    """Return the grid around the part, within the bed, and the height of a slab, mm."""
    low, high = sections.solid.boxes()
    low = np.maximum(low.min(axis=0) - _MARGIN, np.minimum(bed[0], low.min(axis=0)))
    high = np.minimum(high.max(axis=0) + _MARGIN, np.maximum(bed[1], high.max(axis=0)))
    volume = float(np.prod(high - low)) * max(highest, 1.0)
    cell = max(CELL, round((volume / SLAB_RATIO / _MAX_CELLS) ** (1 / 3), 2))
    return CellGrid.around(low, high, cell), SLAB_RATIO * cell


def _rasterize_slabs(sections: Sections, grid: CellGrid, slab: float, n_levels: int) -> tuple[Bool, Float32]:
    """Return where the part is in each slab, and z of its surface there, mm.

    Equal sections are rasterized once in each slab.
    """
    plan, own = sections.plan, sections.solid.find_first_equal_layers()
    shape = (n_levels, grid.n_rows, grid.n_columns)
    solid, surface = np.zeros(shape, np.bool_), np.full(shape, -np.inf, np.float32)
    levels = np.arange(n_levels + 1) * slab
    first = np.searchsorted(plan.top, levels[:-1] + 1e-6, side="right")
    last = np.searchsorted(plan.bottom, levels[1:] - 1e-6)
    before, masks = np.full(1, -1), np.zeros((0, grid.n_rows, grid.n_columns), np.bool_)
    for level, (begin, end) in enumerate(zip(first.tolist(), last.tolist(), strict=True)):
        here = distinct(own[begin:end])
        if not np.array_equal(here, before):
            masks = rasterize_areas(sections.solid.copy_layers(here), grid)
        before = here
        solid[level] = masks.any(axis=0)
        highest = np.zeros(plan.n_layers)
        np.maximum.at(highest, own[begin:end], np.minimum(plan.top[begin:end], levels[level + 1]))
        for mask, z in zip(masks, highest[here].astype(np.float32), strict=True):
            np.maximum(surface[level], np.where(mask, z, -np.inf), out=surface[level])
    return solid, surface


def _find_surfaces(tops: Float32) -> Float32:
    """Return z of the highest surface under each level, mm, from that in each slab (F, n_rows, n_columns)."""
    result = np.full_like(tops, -np.inf)
    np.maximum.accumulate(tops[:-1], axis=0, out=result[1:])
    return result


def _measure_end_clearance(
    fields: tuple[Bool, Float32], cell: float, reach: float
) -> tuple[Float32, Float32]:
    """Return how far it is from each cell on each level to where the surface below is steep, or not horizontal, mm.

    Only cells with the part in the slab right under the level have a distance above 0. The surface around them may
    lie in lower slabs.

    Args:
        fields: where the part is in each slab, and z of the surface under each level, mm.
        cell: side of a cell, mm.
        reach: largest distance, mm.
    """
    solid, surface = fields
    gentle, horizontal = np.zeros(solid.shape, np.float32), np.zeros(solid.shape, np.float32)
    for level in range(1, len(solid)):
        top = solid[level - 1] & ~solid[level]
        if not top.any():
            continue
        under = surface[level]
        with np.errstate(invalid="ignore"):
            change = highest_within(under, NEIGHBOUR_CELLS) + highest_within(-under, NEIGHBOUR_CELLS)
            for result, most in ((gentle, _STEEPEST), (horizontal, _MAX_UNEVEN)):
                result[level] = np.where(top, clearance(~(change <= most), cell, reach), 0.0)
    return gentle, horizontal


def _measure_clearance(solid: Bool, cell: float, reach: float) -> Float32:
    """Return the distance from each cell to the part in each slab, mm; equal slabs are measured once."""
    result = np.zeros(solid.shape, np.float32)
    for level, here in enumerate(solid):
        if level and np.array_equal(here, solid[level - 1]):
            result[level] = result[level - 1]
        else:
            result[level] = clearance(here, cell, reach)
    return result


def _measure_bed(grid: CellGrid, bed: tuple[Float, Float], most: float) -> Float32:
    """Return how far each cell is inside the edges of the bed, mm, at most `most`; negative outside."""
    middles = grid.find_middles(np.arange(grid.n_cells)).reshape(grid.n_rows, grid.n_columns, 2)
    inside = np.minimum(middles - bed[0], bed[1] - middles).min(axis=-1)
    return np.asarray(np.minimum(inside, most), np.float32)


def find_branch_routes(
    clear: Float32,
    ends: tuple[Float32, Float32],
    on_bed: Float32,
    moves: CellMoves,
    settings: TreeSettings,
) -> BranchRoutes:
    """Compute from the bed upwards how thick a branch gets to its end from each cell, and the cheapest length.

    Args:
        clear: (F, n_rows, n_columns) the thickest branch that keeps its distance in the slab above each level, mm.
        ends: (F, n_rows, n_columns) the thickest branch that may end on the part under each level, and its price, mm.
        on_bed: (n_rows, n_columns) the thickest branch that may stand on the bed, mm.
        moves: from level to level.
        settings: of trees.
    """
    thin, (end_radius, end_price) = settings.tip_radius, ends
    radius, free, price = np.full_like(clear, -1.0), np.full_like(clear, -1.0), np.full_like(clear, np.inf)
    radius[0] = on_bed
    price[0][on_bed >= thin] = 0.0
    free[0] = np.minimum(clear[0], on_bed)
    for level in range(1, len(clear)):
        below = level - 1
        way = np.minimum(clear[below], highest_within(free[below], moves.step))
        radius[level] = np.maximum(way, end_radius[level])
        free[level] = np.minimum(clear[level], radius[level])
        open_below = np.where(free[below] >= thin, price[below], np.inf).astype(np.float32)
        onward = np.where(way >= thin, cheapest_within(open_below, moves.step, moves.length), np.inf)
        price[level] = np.where(end_radius[level] >= thin, np.minimum(onward, end_price[level]), onward)
    return BranchRoutes(radius, free, price)
