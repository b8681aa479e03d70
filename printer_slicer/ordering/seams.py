"""Place seams: set the start point of every external perimeter loop."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Float, Int
from printer_slicer.model import Toolpaths
from printer_slicer.ordering.alignment import align_seams
from printer_slicer.ordering.loops import Loops, start_loops_at
from printer_slicer.profile import Profile
from printer_slicer.roles import Role

__all__ = ["find_external_loops", "place_seams"]

_SEED = 20_181


def find_external_loops(paths: Toolpaths) -> Int:
    """Return the indices of the external perimeters that are closed."""
    return np.flatnonzero(paths.closed & (paths.role == Role.EXTERNAL_PERIMETER))


def place_seams(paths: Toolpaths, profile: Profile) -> Toolpaths:
    """Start external perimeters at the seam position that the profile sets."""
    loops = Loops.of(paths, find_external_loops(paths))
    rule = profile.quality.seam
    if rule == "nearest" or not loops.n_loops:
        return paths
    return start_loops_at(
        paths, loops, _choose_seam_positions(paths, loops, rule, profile.quality.seam_angle_deg)
    )


def _choose_seam_positions(paths: Toolpaths, loops: Loops, rule: str, angle_deg: float) -> Float:
    """Return the seam positions of loops (R,), mm along each loop."""
    if rule == "rear":
        return _find_rear_positions(loops)
    if rule == "random":
        return np.random.default_rng(_SEED).random(loops.n_loops) * loops.length
    angle = np.radians(angle_deg)
    toward = np.array([np.cos(angle), np.sin(angle)])
    return align_seams(paths, loops, toward, prefers_side=rule == "direction")


def _find_rear_positions(loops: Loops) -> Float:
    """Return the position (R,) of the rearmost point of each loop, mm; of equally far points, that of the rightmost."""
    owner = np.repeat(np.arange(loops.n_loops), np.diff(loops.start))
    ranked = np.lexsort((loops.xy[:, 0], np.round(loops.xy[:, 1], 3), owner))
    return loops.reach[ranked[loops.start[1:] - 1]]
