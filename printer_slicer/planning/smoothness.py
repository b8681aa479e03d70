"""Which layer heights may lie next to each other: jumps show as bands on walls."""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.model import Bool, Int, Mesh
from printer_slicer.planning.lattice import Lattice, borders_of
from printer_slicer.planning.path import Evenness
from printer_slicer.planning.steps import Steps
from printer_slicer.profile import Profile
from printer_slicer.surface import find_flats

__all__ = ["STEP", "STEP_RATIO", "evenness_of"]

STEP: Final = 0.06
"""mm by which smooth neighbours may always differ."""

STEP_RATIO: Final = 0.25
"""Of the thicker of two neighbours, by which they may differ too."""

_DUST: Final = 1e-6  # units


def evenness_of(mesh: Mesh, lattice: Lattice, steps: Steps, profile: Profile) -> Evenness | None:
    """What the profile asks of neighbours; None where it asks for nothing.

    `max_step` holds everywhere, as far as graver rules allow. Without it layers are smooth, where time and volume error
    are weighed and no number of layers is asked for. Beside a flat, the top, the end of a range and a first layer that
    is set, where layers are thinner or thicker than the shape wants, a jump is as bad as half a layer more.
    """
    dials = profile.dials
    highest = max(lattice.highest, int(steps.allowed[-1]) // lattice.steps)
    spare = abs(lattice.rest) / lattice.steps  # the last layer is higher or lower by this
    if dials.max_step:
        change = int(dials.max_step / lattice.unit - spare + _DUST)
        return Evenness.by_step(change, highest, lattice.n)
    if not dials.smooth or dials.max_layers or (dials.objective != "balanced" and not dials.time_budget):
        return None
    least = _least_neighbours(np.arange(highest + 1), lattice, steps, spare)
    most = np.searchsorted(least, np.arange(highest + 1), side="right") - 1
    return Evenness(least, most, _spared_nodes(mesh, lattice, steps, profile))


def _least_neighbours(height: Int, lattice: Lattice, steps: Steps, spare: float) -> Int:
    """(H,) the thinnest smooth neighbour that is no thicker, of each height from 0 up, in units; ascending."""
    change = np.floor(np.maximum(STEP / lattice.unit, STEP_RATIO * height) - spare + _DUST)
    # Heights that follow each other in the list may always meet.
    allowed = steps.allowed // lattice.steps
    place = np.searchsorted(allowed, height) - 1
    below = np.where(place >= 0, allowed[np.maximum(place, 0)], height)
    return np.maximum.accumulate(np.minimum(height - change.astype(np.int64), below))


def _spared_nodes(mesh: Mesh, lattice: Lattice, steps: Steps, profile: Profile) -> Bool:
    """(n + 1,) the nodes beside which jumps are fined less."""
    free = np.zeros(lattice.n + 1, np.bool_)
    free[0], free[-1] = bool(steps.first), True
    planes = np.concatenate([find_flats(mesh)[0], borders_of(profile, mesh.height)]) / lattice.unit
    snap = max(profile.dials.snap_tolerance / lattice.unit, 0.5)
    lowest, highest = np.ceil(planes - snap - _DUST), np.floor(planes + snap + _DUST)
    for first, last in zip(lowest.astype(np.int64).tolist(), highest.astype(np.int64).tolist(), strict=True):
        free[max(first, 0) : last + 1] = True
    return free
