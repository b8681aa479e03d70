"""Narrow solid strips beside the walls, filled along them: rows across would be short and many."""

from __future__ import annotations

import numpy as np

from printer_slicer import bead
from printer_slicer.geometry import (
    Areas,
    Bool,
    Float,
    Int,
    Pieces,
    difference,
    offset,
    offset_open,
    outlines_within,
    stroked,
)
from printer_slicer.geometry.areas import lengths
from printer_slicer.model import Regions, Role, Toolpaths
from printer_slicer.profile import Profile

__all__ = ["strip_paths"]

_WIDEST = 3.5  # beads
_FULL = (0.87, 1.15)  # of what a strip holds, in beads of the usual width
_BARE = 0.02  # of a strip may stay uncovered
_SLIT = 0.05  # mm: half the width of gaps that do not count
_MANY = 300_000  # points of walls beside strips; with more each strip is not asked on its own


def strip_paths(regions: Regions, pieces: Pieces, profile: Profile) -> tuple[Toolpaths, Pieces]:
    """Beads along the walls in the strips that are evenly wide; and the pieces that such beads would not fill.

    Strips as wide as a whole number of usual beads are found first. In others the beads are as much wider or narrower
    as the strip is wide in the mean.
    """
    plan, width = regions.plan, profile.extrusion_width
    gap = bead.spacing(width, plan.height)
    left = np.flatnonzero(pieces.mean_width() < _WIDEST * gap[pieces.layer])
    others = np.setdiff1d(np.arange(pieces.count), left)
    parts = []
    for each in (False, True):
        strips = pieces.take(left)
        walls = regions.inside.of_layers(strips.layer)
        if each:
            walls = strips.beside(walls)
            if len(walls.xy) > _MANY:
                break
            wide = strips.mean_width()
            step = wide / np.maximum(np.rint(wide / gap[strips.layer]), 1)
        else:
            step = gap[strips.layer]
        paths, fits = _filled(regions, strips, _lines(walls, strips, step if each else gap), step)
        parts.append(paths)
        left = left[~fits]
    return Toolpaths.joined(plan, parts), pieces.take(np.union1d(others, left))


def _filled(
    regions: Regions, strips: Pieces, lines: tuple[Float, Int, Int], gap: Float
) -> tuple[Toolpaths, Bool]:
    """Lines as beads, scaled so that each strip holds what it should, and (P,) the strips that this fills."""
    plan = regions.plan
    xy, size, piece = lines
    area, height = strips.areas.area(), plan.height[strips.layer]
    full = (
        np.bincount(piece, lengths(xy, np.append(0, np.cumsum(size)), closed=False), minlength=strips.count)
        * gap
        / np.maximum(area, 1e-9)
    )
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
        role=np.full(len(layer), Role.SOLID),
        width=wide[piece[kept]],
        closed=False,
    )
    return paths, fits


def _lines(walls: Areas, strips: Pieces, step: Float) -> tuple[Float, Int, Int]:
    """Points, sizes and strips of lines half a step, one and a half and so on from walls, of layers or of strips."""
    loop, by = walls, step / 2
    found: list[tuple[Float, Int, Int]] = []
    while loop.n_rings and len(found) < _WIDEST:
        loop, by = offset(loop, -by), step
        beside = loop if loop.n_layers == strips.count else strips.beside(loop)
        found.append(outlines_within(beside, strips.areas))
        if not len(found[-1][1]):
            break
    if not found:
        return np.zeros((0, 2)), np.zeros(0, np.int64), np.zeros(0, np.int64)
    xy, size, piece = (np.concatenate([part[i] for part in found]) for i in range(3))
    return xy, size, piece
