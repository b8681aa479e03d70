"""Solid areas too narrow for rows: beads along them, as many and as wide as fit."""

from __future__ import annotations

import numpy as np

from printer_slicer import bead
from printer_slicer.arrays import Float, Int
from printer_slicer.geometry import Pieces, offset
from printer_slicer.model import LayerPlan, Toolpaths
from printer_slicer.perimeters import fill_pieces
from printer_slicer.profile import Profile

__all__ = ["along_narrow", "beads_amid"]

_BEADS = 5  # side by side; wider places are filled with rows
_OFF = 0.15  # of the volume: what is filled worse is left to rows
_DOT = 0.2  # mm²: nobody sees whether so little is there


def along_narrow(plan: LayerPlan, pieces: Pieces, role: Int, profile: Profile) -> tuple[Toolpaths, Int]:
    """Beads along those of the pieces that are narrow everywhere, and the pieces (n,) that are left for rows."""
    gap = bead.spacing(profile.extrusion_width, plan.height)[pieces.layer]
    slim = np.flatnonzero(pieces.mean_width() < _BEADS * gap)
    core = offset(pieces.take(slim).areas, -_BEADS / 2 * gap[slim])
    narrow = slim[~core.used]
    some = pieces.take(narrow)
    paths, owner, laid = beads_amid(plan, some, role[narrow], profile, beads=_BEADS)
    area = some.areas.area()
    fits = np.abs(laid - area) < _OFF * area + _DOT
    left = np.ones(pieces.count, np.bool_)
    left[narrow[fits]] = False
    return paths.take(np.flatnonzero(fits[owner])), np.flatnonzero(left)


def beads_amid(
    plan: LayerPlan, pieces: Pieces, role: Int, profile: Profile, *, beads: int
) -> tuple[Toolpaths, Int, Float]:
    """Beads of varying width in the narrow places of the pieces; `role` (P,) is that of the beads in each.

    Returns:
        The paths; (M,) the piece that each lies in; (P,) mm² of each piece that they fill, at the layer's height.
    """
    paths, owner = fill_pieces(pieces, role, plan, profile, beads=beads)
    return paths, owner, np.bincount(owner, paths.area(), minlength=pieces.count).astype(np.float64)
