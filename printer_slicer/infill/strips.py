"""Narrow solid strips beside the walls, filled along them: rows across would be short and many."""

from __future__ import annotations

import numpy as np

from printer_slicer import bead
from printer_slicer.geometry import Float, Int, Pieces, offset, outlines_within
from printer_slicer.geometry.areas import lengths
from printer_slicer.model import Regions, Role, Toolpaths
from printer_slicer.profile import Profile

__all__ = ["strip_paths"]

_WIDEST = 3.0  # beads
# What as many usual beads as there are may hold of what the strip does: between two walls there is one beside each, and
# both together fill what one would.
_FULL = (0.7, 2.1)

_CORNERS = (
    0.75  # of the overlap: what walls leave open in corners, within 0.5 % of volume for boxes of 3 to 20 mm
)


def strip_paths(regions: Regions, pieces: Pieces, profile: Profile) -> tuple[Toolpaths, Pieces]:
    """Beads along the walls in the narrow ones of these pieces; and the pieces that such beads would not fill."""
    plan, width = regions.plan, profile.extrusion_width
    narrow = np.flatnonzero(pieces.mean_width() < _WIDEST * width)
    strips = pieces.take(narrow)
    gap = bead.spacing(width, plan.height)
    overlap = profile.quality.infill_overlap * width if profile.quality.perimeters else 0.0
    xy, size, piece, first = _lines(regions, strips, gap, overlap)
    length = lengths(xy, np.append(0, np.cumsum(size)), closed=False)
    laid = np.bincount(piece, length, minlength=strips.count) * gap[strips.layer]
    # Rows reach into the walls to fill the notches at their ends too. Lines along a wall leave none: less is needed to
    # fill what is left in its corners. The first line shows how much of the outline is at a wall.
    beside = np.bincount(piece, length * first, minlength=strips.count)
    full = laid / (strips.areas.area() + _CORNERS * overlap * beside)
    fits = (full >= _FULL[0]) & (full <= _FULL[1])
    # A little wider or narrower, so that as many as there are hold what the strip holds.
    height = plan.height[strips.layer]
    wide = np.round(bead.width_for_spacing(gap[strips.layer] / np.where(fits, full, 1.0), height), 4)
    fits &= wide >= height
    kept, rest = fits[piece], np.ones(pieces.count, np.bool_)
    rest[narrow[fits]] = False
    of = piece[kept]
    layer = strips.layer[of]
    paths = Toolpaths.gathered(
        plan,
        xy=xy[np.repeat(kept, size)],
        size=size[kept],
        layer=layer,
        role=np.full(len(layer), Role.SOLID),
        width=wide[of],
        closed=False,
    )
    return paths, pieces.take(np.flatnonzero(rest))


def _lines(regions: Regions, strips: Pieces, gap: Float, overlap: float) -> tuple[Float, Int, Int, Float]:
    """Points, sizes and strips of lines along the walls, and whether they are the first beside them (1 or 0)."""
    loop = regions.inside.select(np.isin(regions.inside.ring_layer, strips.layer))
    step, room = gap / 2 - overlap, offset(strips.areas, -overlap)
    found: list[tuple[Float, Int, Int]] = []
    while loop.n_rings and len(found) <= _WIDEST:
        loop, step = offset(loop, -step), gap
        found.append(outlines_within(strips.beside(loop), room))
    if not found:
        return np.zeros((0, 2)), np.zeros(0, np.int64), np.zeros(0, np.int64), np.zeros(0)
    xy, size, piece = (np.concatenate([part[i] for part in found]) for i in range(3))
    return xy, size, piece, (np.arange(len(size)) < len(found[0][1])).astype(np.float64)
