"""Estimate the supports of a turned part: the columns below its overhangs, down to the part or to the bed.

The surface is known at samples. Seen from above, they lie in square cells. A column reaches from each sample of an
overhang down to the next sample in the same cell that faces up, or to the bed. Bridges need no columns.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, unique_inverse
from printer_slicer.geometry.raster import Float32
from printer_slicer.orienting.cost_model import FLAT, GENTLE, CostModel
from printer_slicer.orienting.surface_samples import TurnedSamples

__all__ = ["estimate_supports"]

_CELL: Final = 2.0  # distances between samples, so that hardly a cell has none
_SAME_SURFACE: Final = 0.75  # cells; samples of one surface in a cell differ by less in height
_INSIDE: Final = 0.6  # of the area of a cell
_FACES_UP: Final = 0.05  # cosine; steeper surfaces carry nothing
_LEVEL: Final = 0.5  # cells; samples of one bridge differ by less in height
_STEEP: Final = 0.5  # vertical component of the normals of walls that may carry the end of a bridge


def estimate_supports(samples: TurnedSamples, cost_model: CostModel) -> tuple[Float, Float]:
    """Return the space (2,) below gentle and steeper overhangs, mm³, and their area (2,) seen from above, mm².

    Args:
        samples: of the turned part.
        cost_model: settings of supports.
    """
    z, rise = samples.points[2], samples.rise
    hangs = np.flatnonzero((-rise > cost_model.overhang_cosine) & (z > cost_model.on_bed))
    if not len(hangs):
        return np.zeros(2), np.zeros(2)
    cell = _CELL * samples.spacing
    place = _find_cells(samples.points, cell)
    floor, is_open = _find_floors(
        samples, place[0] * (int(place[1].max()) + 2) + place[1], hangs, cell, cost_model
    )
    hangs, floor = hangs[is_open], floor[is_open]
    stays = ~_find_bridges(samples, place, hangs, cell, cost_model.max_bridge)
    hangs, floor = hangs[stays], floor[stays]
    seen = (samples.area[hangs] * -rise[hangs]).astype(np.float64)
    kind = (-rise[hangs] <= GENTLE).astype(np.int64)
    space, area = (np.bincount(kind, values, 2) for values in (seen * (z[hangs] - floor), seen))
    return space.astype(np.float64), area.astype(np.float64)


def _find_cells(points: Float32, cell: float) -> tuple[Int, Int]:
    """Return column and row (n,) of the cell of each point (3, n), from 1."""
    column, row = (
        np.floor((axis - axis.min()) / np.float32(cell)).astype(np.int64) + 1 for axis in points[:2]
    )
    return column, row


def _find_floors(
    samples: TurnedSamples, key: Int, hangs: Int, cell: float, cost_model: CostModel
) -> tuple[Float, Bool]:
    """Return the height (h,) on which the column below each overhang stands, mm, and whether there is room for it.

    There is none inside another shape of the part. Inside, the surfaces above face up more than down.

    Args:
        samples: of the turned part.
        key: (n,) number of the cell of each sample.
        hangs: (h,) samples of overhangs.
        cell: size of a cell, mm.
        cost_model: settings of supports.
    """
    z = samples.points[2].astype(np.float64)
    step = float(z.max()) + 2 * cell
    rank = key * step + z
    order = np.argsort(rank)
    rank = rank[order]
    faced = np.append(0.0, np.cumsum((samples.area * samples.rise)[order], dtype=np.float64))
    lower = np.searchsorted(rank, key[hangs] * step + np.maximum(z[hangs] - _SAME_SURFACE * cell, 0.0))
    above = faced[np.searchsorted(rank, (key[hangs] + 1) * step - cell)] - faced[lower]
    floor = np.zeros(len(hangs))
    up = np.flatnonzero(samples.rise[order] > _FACES_UP)
    if len(up) and cost_model.lands_on_part:
        nearest = up[
            np.maximum(np.searchsorted(rank[up], key[hangs] * step + z[hangs] + cost_model.on_bed) - 1, 0)
        ]
        found = key[order[nearest]] == key[hangs]
        floor[found] = np.minimum(z[order[nearest[found]]], z[hangs[found]])
    return floor, (z[hangs] - floor > cost_model.on_bed) & (above < _INSIDE * cell**2)


def _find_bridges(
    samples: TurnedSamples, place: tuple[Int, Int], hangs: Int, cell: float, most: float
) -> Bool:
    """Return a mask (h,) of the overhangs that are flat and bridged between walls on both sides.

    Args:
        samples: of the turned part.
        place: column and row (n,) of the cell of each sample, from 1.
        hangs: (h,) samples of overhangs.
        cell: size of a cell, mm.
        most: length of the longest bridge, mm.
    """
    z, rise = samples.points[2], samples.rise
    bridged = np.zeros(len(hangs), np.bool_)
    flat = np.flatnonzero(-rise[hangs] > FLAT)
    if not len(flat) or most < cell:
        return bridged
    level = np.floor(z / np.float32(_LEVEL * cell)).astype(np.int64) + 2
    walls = np.flatnonzero(np.abs(rise) < _STEEP)
    for along, across in (place, place[::-1]):
        key = (level * (int(across.max()) + 2) + across) * (int(along.max()) + 3) + along
        # A wall that carries the end of a bridge reaches below it.
        solid = np.sort(np.concatenate([key[walls] + up * _level_step(along, across) for up in (1, 2)]))
        cells, of = unique_inverse(key[hangs[flat]])
        bridged[flat] |= _span_cells(cells, solid, most / cell)[of]
    return bridged


def _level_step(along: Int, across: Int) -> int:
    """Return the difference between the keys of two cells, one above the other."""
    return (int(across.max()) + 2) * (int(along.max()) + 3)


def _span_cells(cells: Int, solid: Int, most: float) -> Bool:
    """Return a mask (n,) of cells in rows of at most `most` cells between two walls.

    Args:
        cells: numbers of the cells of flat overhangs, ascending; neighbours in a row have consecutive numbers.
        solid: numbers of cells above walls, ascending.
        most: number of cells.
    """
    begins = np.flatnonzero(np.diff(cells, prepend=cells[0] - 2) != 1)
    length = np.diff(np.append(begins, len(cells)))
    first, last = cells[begins], cells[begins] + length - 1
    carried = _is_near(first, solid, -1) & _is_near(last, solid, 1)
    return np.repeat(carried & (length <= most), length)


def _is_near(cells: Int, solid: Int, step: int) -> Bool:
    """Return where (n,) the cell itself, or the next one in the direction `step`, is among those in `solid`."""
    found = np.zeros(len(cells), np.bool_)
    for shift in (0, step):
        place = np.minimum(np.searchsorted(solid, cells + shift), max(len(solid) - 1, 0))
        found |= solid[place] == cells + shift if len(solid) else False
    return found
