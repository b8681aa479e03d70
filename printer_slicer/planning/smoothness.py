"""Decide which layer heights may be neighbours, because large steps show as bands on walls."""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.arrays import Bool, Int
from printer_slicer.model import Mesh
from printer_slicer.planning.height_grid import HeightGrid, range_ends
from printer_slicer.planning.z_steps import ZSteps
from printer_slicer.profile import Profile
from printer_slicer.shortest_path import NeighbourLimits
from printer_slicer.surface import find_flats

__all__ = ["SMOOTH_STEP", "SMOOTH_STEP_RATIO", "neighbour_limits"]

SMOOTH_STEP: Final = 0.06
"""Step between smooth neighbours that is always allowed, mm."""

SMOOTH_STEP_RATIO: Final = 0.25
"""Step that is also allowed, as a fraction of the thicker neighbour."""

_ROUNDING: Final = 1e-6  # units


def neighbour_limits(mesh: Mesh, grid: HeightGrid, steps: ZSteps, profile: Profile) -> NeighbourLimits | None:
    """Return the profile's constraint on neighbouring layers; None if there is none.

    `max_step` applies everywhere, as far as more important rules allow. Without it layers are smooth if the objective
    is `balanced`, or with a time budget, and without `max_layers`. Next to a flat, the top, the end of a range and a
    fixed first layer, a large step costs as much as half a layer more.
    """
    dials = profile.dials
    highest = max(grid.highest, int(steps.allowed[-1]) // grid.steps)
    spare = abs(grid.rest) / grid.steps  # the last layer may be thicker or thinner by this
    if dials.max_step:
        change = int(dials.max_step / grid.unit - spare + _ROUNDING)
        return NeighbourLimits.by_step(change, highest, grid.n)
    if not dials.smooth or dials.max_layers or (dials.objective != "balanced" and not dials.time_budget):
        return None
    least = _thinnest_neighbours(np.arange(highest + 1), grid, steps, spare)
    most = np.searchsorted(least, np.arange(highest + 1), side="right") - 1
    return NeighbourLimits(least, most, _find_spared_nodes(mesh, grid, steps, profile))


def _thinnest_neighbours(height: Int, grid: HeightGrid, steps: ZSteps, spare: float) -> Int:
    """Return the thinnest allowed neighbour (H,) of each height from 0 up, in units; ascending."""
    change = np.floor(np.maximum(SMOOTH_STEP / grid.unit, SMOOTH_STEP_RATIO * height) - spare + _ROUNDING)
    # Consecutive heights of the list may always be neighbours.
    allowed = steps.allowed // grid.steps
    place = np.searchsorted(allowed, height) - 1
    below = np.where(place >= 0, allowed[np.maximum(place, 0)], height)
    return np.maximum.accumulate(np.minimum(height - change.astype(np.int64), below))


def _find_spared_nodes(mesh: Mesh, grid: HeightGrid, steps: ZSteps, profile: Profile) -> Bool:
    """Return the nodes (n + 1,) next to which large steps between layer heights cost less."""
    free = np.zeros(grid.n + 1, np.bool_)
    free[0], free[-1] = bool(steps.first), True
    planes = np.concatenate([find_flats(mesh)[0], range_ends(profile, mesh.height)]) / grid.unit
    snap = max(profile.dials.snap_tolerance / grid.unit, 0.5)
    lowest, highest = np.ceil(planes - snap - _ROUNDING), np.floor(planes + snap + _ROUNDING)
    for first, last in zip(lowest.astype(np.int64).tolist(), highest.astype(np.int64).tolist(), strict=True):
        free[max(first, 0) : last + 1] = True
    return free
