"""Solid areas too narrow for rows: beads along them, as many and as wide as fit."""

from __future__ import annotations

import numpy as np

from printer_slicer import bead
from printer_slicer.geometry import Float, Int, Pieces, offset, rings_around
from printer_slicer.model import LayerPlan, Role, Toolpaths
from printer_slicer.perimeters import fill_narrow
from printer_slicer.profile import Profile

__all__ = ["along_narrow", "beads_amid"]

_BEADS = 5  # side by side; wider places are filled with rows
_OFF = 0.15  # of the volume: what is filled worse is left to rows
_ALONE = 8  # pieces at most that are tried once more, one by one
_DOT = 0.2  # mm²: nobody sees whether so little is there


def along_narrow(plan: LayerPlan, pieces: Pieces, role: Role, profile: Profile) -> tuple[Toolpaths, Pieces]:
    """Beads along those of the pieces that are narrow everywhere, and the pieces that are left for rows."""
    gap = bead.spacing(profile.extrusion_width, plan.height)[pieces.layer]
    slim = np.flatnonzero(pieces.mean_width() < _BEADS * gap)
    core = offset(pieces.take(slim).areas, -_BEADS / 2 * gap[slim])
    narrow = slim[~core.used]
    paths, unfilled = _well_filled(plan, pieces.take(narrow), role, profile)
    parts, bare = [paths], narrow[unfilled]
    for piece in bare[:_ALONE].tolist():
        # A piece that cannot be traced takes the others of its layer with it.
        paths, unfilled = _well_filled(plan, pieces.take(np.array([piece])), role, profile)
        parts.append(paths)
        bare = bare if len(unfilled) else bare[bare != piece]
    left = np.setdiff1d(np.arange(pieces.count), np.setdiff1d(narrow, bare))
    return Toolpaths.joined(plan, parts), pieces.take(left)


def _well_filled(plan: LayerPlan, pieces: Pieces, role: Role, profile: Profile) -> tuple[Toolpaths, Int]:
    """Beads in those of the pieces that hold as much as they should then; and which do not."""
    paths, owner, laid = beads_amid(plan, pieces, role, profile, beads=_BEADS)
    area = pieces.areas.area()
    fits = np.abs(laid - area) < _OFF * area + _DOT
    return paths.take(np.flatnonzero(fits[owner])), np.flatnonzero(~fits)


def beads_amid(
    plan: LayerPlan, pieces: Pieces, role: Role, profile: Profile, *, beads: int
) -> tuple[Toolpaths, Int, Float]:
    """Beads of varying width in the narrow places of the pieces.

    Returns:
        The paths; (M,) the piece that each lies in; (P,) mm² of each piece that they fill, at the layer's height.
    """
    areas = pieces.on_layers(plan.n_layers, np.arange(pieces.count))
    paths = fill_narrow(areas, plan, profile, beads=beads, role=role).paths
    first = paths.start[:-1] + np.diff(paths.start) // 2
    middle = (paths.xy[first - 1] + paths.xy[first]) / 2
    ring = rings_around(areas, middle, paths.layer)
    paths, ring = paths.take(np.flatnonzero(ring >= 0)), ring[ring >= 0]
    owner = pieces.areas.ring_layer[ring]
    return paths, owner, np.bincount(owner, paths.area(), minlength=pieces.count).astype(np.float64)
