"""Narrow solid strips beside the walls, filled along them: rows across would be short and many."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from printer_slicer import bead
from printer_slicer.arrays import Bool, Float, Int, lengths
from printer_slicer.geometry import Areas, Pieces, difference, offset, offset_open, outlines_within, stroked
from printer_slicer.model import LayerPlan, Regions, Toolpaths
from printer_slicer.profile import Profile
from printer_slicer.roles import Role

__all__ = ["strip_paths"]

_WIDEST = 3.5  # beads
_FULL = (0.87, 1.15)  # of what a strip holds, in beads of the usual width
_BARE = 0.02  # of a strip may stay uncovered
_SLIT = 0.05  # mm: half the width of gaps that do not count
_MANY = 300_000  # points of walls beside strips; with more each strip is not asked on its own

_Lines = tuple[Float, Int, Int]  # points (N, 2), how many (M,) each line has, and the strip (M,) it lies in


def strip_paths(regions: Regions, pieces: Pieces, profile: Profile) -> tuple[Toolpaths, Pieces]:
    """Beads along the walls in the strips that are evenly wide; and the pieces that such beads would not fill.

    Strips as wide as a whole number of usual beads are found first. In others the beads are as much wider or narrower
    as the strip is wide in the mean.
    """
    plan = regions.plan
    usual = bead.spacing(profile.extrusion_width, plan.height)
    left = np.flatnonzero(pieces.mean_width() < _WIDEST * usual[pieces.layer])
    rest = np.ones(pieces.count, np.bool_)
    parts = []
    for lines_along in (_usual_lines, _fitted_lines):
        strips = pieces.take(left)
        lines, gap = lines_along(regions.inside.of_layers(strips.layer), strips, usual)
        paths, fits = _filled(plan, strips, lines, gap)
        parts.append(paths)
        rest[left[fits]] = False
        left = left[~fits]
    return Toolpaths.joined(plan, parts), pieces.take(np.flatnonzero(rest))


def _usual_lines(walls: Areas, strips: Pieces, usual: Float) -> tuple[_Lines, Float]:
    """Lines along the walls as far apart as on all of the layer (L,), and (P,) mm of that."""
    beside = (strips.beside(loop) for loop in _loops(walls, usual))
    return _within(beside, strips), usual[strips.layer]


def _fitted_lines(walls: Areas, strips: Pieces, usual: Float) -> tuple[_Lines, Float]:
    """Lines so far apart that a whole number of them is as wide as the strip in the mean, and (P,) mm of that."""
    wide, beside = strips.mean_width(), strips.beside(walls)
    gap = wide / np.maximum(np.rint(wide / usual[strips.layer]), 1)
    if len(beside.xy) > _MANY:
        beside = Areas.empty(strips.count)
    return _within(_loops(beside, gap), strips), gap


def _loops(walls: Areas, gap: Float) -> Iterator[Areas]:
    """What lies half a gap, one and a half and so on inside walls; as many as a strip has lines at most."""
    loop, by = walls, gap / 2
    for _ in range(math.ceil(_WIDEST)):
        if not loop.n_rings:
            return
        loop, by = offset(loop, -by), gap
        yield loop


def _within(loops: Iterator[Areas], strips: Pieces) -> _Lines:
    """The parts of loops (P entries each) within the strips, up to loops that are nowhere within one."""
    found: list[_Lines] = [(np.zeros((0, 2)), np.zeros(0, np.int64), np.zeros(0, np.int64))]
    for loop in loops:
        found.append(outlines_within(loop, strips.areas))
        if not len(found[-1][1]):
            break
    xy, size, strip = (np.concatenate([part[i] for part in found]) for i in range(3))
    return xy, size, strip


def _filled(plan: LayerPlan, strips: Pieces, lines: _Lines, gap: Float) -> tuple[Toolpaths, Bool]:
    """Lines as beads, scaled so that each strip holds what it should, and (P,) the strips that this fills."""
    xy, size, piece = lines
    area, height = strips.areas.area(), plan.height[strips.layer]
    long = lengths(xy, np.append(0, np.cumsum(size)), closed=False)
    full = np.bincount(piece, long, minlength=strips.count) * gap / np.maximum(area, 1e-9)
    fits = (full >= _FULL[0]) & (full <= _FULL[1])
    wide = np.round(bead.width_for_spacing(gap / np.where(fits, full, 1.0), height), 4)
    fits &= wide >= height
    kept = fits[piece]
    xy, size, piece = xy.compress(np.repeat(kept, size), axis=0), size[kept], piece[kept]
    covered = stroked(xy, np.append(0, np.cumsum(size)), piece, wide[piece] / 2, strips.count)
    bare = offset_open(difference(strips.areas.of_layers(fits), covered), _SLIT)
    fits &= bare.area() < _BARE * area
    kept = fits[piece]
    layer = strips.layer[piece[kept]]
    paths = Toolpaths.gathered(
        plan,
        xy=xy.compress(np.repeat(kept, size), axis=0),
        size=size[kept],
        layer=layer,
        role=np.full(len(layer), Role.SOLID_INFILL),
        width=wide[piece[kept]],
        closed=False,
    )
    return paths, fits
