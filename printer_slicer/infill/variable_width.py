"""Fill narrow solid areas with extrusions of variable width along the area."""

from __future__ import annotations

import numpy as np

from printer_slicer import bead
from printer_slicer.arrays import Float, Int
from printer_slicer.geometry import ConnectedAreas, offset
from printer_slicer.model import LayerPlan, Toolpaths
from printer_slicer.perimeters import fill_pieces
from printer_slicer.profile import Profile

__all__ = ["fill_gaps", "fill_narrow_pieces"]

_MAX_BEADS = 5  # extrusions side by side; wider places are filled with parallel lines
_MAX_ERROR = 0.15  # largest volume error; pieces with more are filled with parallel lines
_SMALL_ERROR = 0.2  # mm², volume errors this small are accepted in any piece


def fill_narrow_pieces(
    plan: LayerPlan, pieces: ConnectedAreas, role: Int, profile: Profile
) -> tuple[Toolpaths, Int]:
    """Fill the pieces that are narrow everywhere; return the paths and the indices (n,) of the other pieces."""
    gap = bead.spacing(profile.extrusion_width, plan.height)[pieces.layer]
    slim = np.flatnonzero(pieces.mean_width() < _MAX_BEADS * gap)
    core = offset(pieces.take(slim).areas, -_MAX_BEADS / 2 * gap[slim])
    narrow = slim[~core.used]
    some = pieces.take(narrow)
    paths, owner, laid = fill_gaps(plan, some, role[narrow], profile, beads=_MAX_BEADS)
    area = some.areas.area()
    fits = np.abs(laid - area) < _MAX_ERROR * area + _SMALL_ERROR
    left = np.ones(pieces.count, np.bool_)
    left[narrow[fits]] = False
    return paths.take(np.flatnonzero(fits[owner])), np.flatnonzero(left)


def fill_gaps(
    plan: LayerPlan, pieces: ConnectedAreas, role: Int, profile: Profile, *, beads: int
) -> tuple[Toolpaths, Int, Float]:
    """Fill the narrow places of pieces with extrusions of variable width; `role` (P,) is the role in each piece.

    Returns:
        The paths, the piece (M,) of each path, and the area (P,) mm² filled in each piece at the layer's height.
    """
    paths, owner = fill_pieces(pieces, role, plan, profile, beads=beads)
    return paths, owner, np.bincount(owner, paths.area(), minlength=pieces.count).astype(np.float64)
