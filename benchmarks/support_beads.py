"""The supports in a G-code file of any slicer: extrusions with their heights, paths, and travels to them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from benchmarks.support_solid import Grid
from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.errors import UsageError
from printer_slicer.inspection.coverage.extrusions import Extrusions
from printer_slicer.inspection.coverage.gcode_extrusions import extrusions_of_gcode
from printer_slicer.inspection.deposition.marks import Purpose
from printer_slicer.values import replace

__all__ = ["SupportFile", "draw_beads", "read_supports", "support_seconds"]

_JOINED: Final = 0.002  # mm; a nearer begin continues a path
_PIECE: Final = 1.0  # mm, length of the pieces in which extrusions are drawn
_BLOCK: Final = 1 << 22  # cells at a time
_SAME_Z: Final = 0.0005  # mm
_STOP_DEG: Final = 30.0  # corners sharper than this stop the nozzle
_SUPPORT_SPEED, _TRAVEL_SPEED, _ACCELERATION = 60.0, 150.0, 1500.0  # mm/s, mm/s, mm/s²


@dataclass(frozen=True, eq=False)
class SupportFile:
    """Extrusions of a file.

    Attributes:
        support: of supports, in printing order.
        path: (B,) number of the path of each of them; a path is extruded without a stop between.
        part: of the part.
        travel: (T, 2, 2) mm, travel moves to extrusions of supports.
        before: (T,) number of the support path that each travel leads to.
    """

    support: Extrusions
    path: Int
    part: Extrusions
    travel: Float
    before: Int


def read_supports(text: bytes, filament_diameter: float) -> SupportFile:
    """Return the extrusions of a file without skirt and brim of the part.

    Without comments on heights, an extrusion is as high as its top is above the next lower top of the part. With
    neither skirt nor brim of the part, extrusions of this role are the brim of supports.

    Args:
        text: G-code.
        filament_diameter: mm.

    Raises:
        UsageError: the text extrudes nothing.
    """
    found = extrusions_of_gcode(text, filament_diameter=filament_diameter)
    beads = found.beads
    if not beads.n_beads:
        raise UsageError("the G-code extrudes nothing", remedy="Check that the file has E values")
    beads = replace(beads, height=_heights(beads))
    is_support = np.isin(beads.purpose, [Purpose.SUPPORT_MATERIAL, Purpose.SKIRT])
    is_part = ~is_support & (beads.purpose != Purpose.CUSTOM)
    index = np.flatnonzero(is_support)
    support = beads.take(index)
    continues = np.zeros(len(index), np.bool_)
    if len(index):
        gap = np.hypot(*(support.begin[1:] - support.end[:-1]).T)
        continues[1:] = (np.diff(index) == 1) & (gap < _JOINED) & (np.abs(np.diff(support.z_top)) < _SAME_Z)
        continues[np.isin(index, found.before)] = False
    path = np.cumsum(~continues) - 1
    leads = np.isin(found.before, index)
    to = np.searchsorted(index, found.before[leads])
    return SupportFile(
        support, path, beads.take(is_part), found.travel[leads], path[to] if len(index) else to
    )


def _heights(beads: Extrusions) -> Float:
    """Return the heights (B,) from comments, or from the next lower top of the part."""
    tops = np.unique(np.round(beads.z_top, 3))
    lower = np.concatenate([[0.0], tops])
    to_next = beads.z_top - lower[np.searchsorted(tops, beads.z_top - _SAME_Z)]
    return np.where(np.isnan(beads.height), to_next, beads.height)


def draw_beads(beads: Extrusions, grid: Grid) -> Bool:
    """Return the cells whose middle lies under an extrusion, with round ends."""
    flags = np.zeros(grid.n_cells, np.bool_)
    count = np.maximum(np.ceil(beads.length / _PIECE), 1).astype(np.int64)
    bead = np.repeat(np.arange(beads.n_beads), count)
    number = np.arange(len(bead)) - np.repeat(np.cumsum(count) - count, count)
    way = (beads.end - beads.begin)[bead]
    begin = (beads.begin[bead] + way * (number / count[bead])[:, None] - grid.low) / grid.cell - 0.5
    end = begin + way / count[bead][:, None] / grid.cell
    radius = beads.width[bead] / 2 / grid.cell
    low = np.ceil(np.minimum(begin, end) - radius[:, None]).astype(np.int64)
    high = np.floor(np.maximum(begin, end) + radius[:, None]).astype(np.int64)
    wide, deep = np.maximum(high - low + 1, 0).T
    cells = wide * deep
    block = np.cumsum(cells) // _BLOCK
    for one in np.unique(block):
        some = np.flatnonzero(block == one)
        piece = np.repeat(some, cells[some])
        step = np.arange(len(piece)) - np.repeat(np.cumsum(cells[some]) - cells[some], cells[some])
        i, j = np.divmod(step, np.maximum(wide[piece], 1))
        at = low[piece] + np.column_stack([j, i])
        along = (end - begin)[piece]
        share = ((at - begin[piece]) * along).sum(axis=1) / np.maximum((along**2).sum(axis=1), 1e-12)
        away = at - begin[piece] - np.clip(share, 0, 1)[:, None] * along
        inside = (away**2).sum(axis=1) <= radius[piece] ** 2
        inside &= (at >= 0).all(axis=1) & (at[:, 1] < grid.shape[0]) & (at[:, 0] < grid.shape[1])
        flags[at[inside, 1] * grid.shape[1] + at[inside, 0]] = True
    return flags.reshape(grid.shape)


def support_seconds(file: SupportFile) -> tuple[float, float]:
    """Return the time to extrude all supports and that of the travels to them, s, by one rule for all files.

    Supports are extruded at 60 mm/s, travels take place at 150 mm/s, the acceleration is 1500 mm/s². The nozzle stops
    at both ends of a path and at corners of more than 30 degrees.
    """
    beads = file.support
    extruding = _run_seconds(beads.begin, beads.end, file.path, _SUPPORT_SPEED)
    return extruding, _run_seconds(file.travel[:, 0], file.travel[:, 1], file.before, _TRAVEL_SPEED)


def _run_seconds(begin: Float, end: Float, path: Int, speed: float) -> float:
    """Return the time, s, of moves from `begin` to `end` (n, 2), with stops where the path (n,) changes or turns."""
    if not len(begin):
        return 0.0
    way = end - begin
    length = np.hypot(*way.T)
    unit = way / np.maximum(length, 1e-12)[:, None]
    straight = (unit[1:] * unit[:-1]).sum(axis=1) > np.cos(np.deg2rad(_STOP_DEG))
    run = np.concatenate([[0], np.cumsum(~(straight & (path[1:] == path[:-1])))])
    total = np.bincount(run, weights=length)
    reaches = speed**2 / _ACCELERATION
    seconds = np.where(
        total >= reaches, total / speed + speed / _ACCELERATION, 2 * np.sqrt(total / _ACCELERATION)
    )
    return float(seconds.sum())
