"""Decide which layer heights may be neighbours, because large steps show as bands on walls."""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.arrays import Bool, Int
from printer_slicer.model import Mesh
from printer_slicer.planning.lattice import Lattice, borders_of
from printer_slicer.planning.path import NeighbourLimits
from printer_slicer.planning.steps import Steps
from printer_slicer.profile import Profile
from printer_slicer.surface import find_flats

__all__ = ["STEP", "STEP_RATIO", "neighbour_limits"]

STEP: Final = 0.06
"""Step between smooth neighbours that is always allowed, mm."""

STEP_RATIO: Final = 0.25
"""Step that is also allowed, as a share of the thicker neighbour."""

_DUST: Final = 1e-6  # units


def neighbour_limits(mesh: Mesh, lattice: Lattice, steps: Steps, profile: Profile) -> NeighbourLimits | None:
    """Return the profile's constraint on neighbouring layers; None if there is none.

    `max_step` applies everywhere, as far as more important rules allow. Without it layers are smooth if the objective
    is `balanced`, or with a time budget, and without `max_layers`. Next to a flat, the top, the end of a range and a
    fixed first layer, a large step costs as much as half a layer more.
    """
    dials = profile.dials
    highest = max(lattice.highest, int(steps.allowed[-1]) // lattice.steps)
    spare = abs(lattice.rest) / lattice.steps  # the last layer may be thicker or thinner by this
    if dials.max_step:
        change = int(dials.max_step / lattice.unit - spare + _DUST)
        return NeighbourLimits.by_step(change, highest, lattice.n)
    if not dials.smooth or dials.max_layers or (dials.objective != "balanced" and not dials.time_budget):
        return None
    least = _least_neighbours(np.arange(highest + 1), lattice, steps, spare)
    most = np.searchsorted(least, np.arange(highest + 1), side="right") - 1
    return NeighbourLimits(least, most, _spared_nodes(mesh, lattice, steps, profile))


def _least_neighbours(height: Int, lattice: Lattice, steps: Steps, spare: float) -> Int:
    """(H,) the thinnest allowed neighbour of each height from 0 up, in units; ascending."""
    change = np.floor(np.maximum(STEP / lattice.unit, STEP_RATIO * height) - spare + _DUST)
    # Consecutive heights of the list may always be neighbours.
    allowed = steps.allowed // lattice.steps
    place = np.searchsorted(allowed, height) - 1
    below = np.where(place >= 0, allowed[np.maximum(place, 0)], height)
    return np.maximum.accumulate(np.minimum(height - change.astype(np.int64), below))


def _spared_nodes(mesh: Mesh, lattice: Lattice, steps: Steps, profile: Profile) -> Bool:
    """(n + 1,) the nodes next to which large steps cost less."""
    free = np.zeros(lattice.n + 1, np.bool_)
    free[0], free[-1] = bool(steps.first), True
    planes = np.concatenate([find_flats(mesh)[0], borders_of(profile, mesh.height)]) / lattice.unit
    snap = max(profile.dials.snap_tolerance / lattice.unit, 0.5)
    lowest, highest = np.ceil(planes - snap - _DUST), np.floor(planes + snap + _DUST)
    for first, last in zip(lowest.astype(np.int64).tolist(), highest.astype(np.int64).tolist(), strict=True):
        free[max(first, 0) : last + 1] = True
    return free
