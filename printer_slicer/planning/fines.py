"""What the layers of a plan break, as fines: rules that outweigh each other, and all of them any objective."""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.model import Bool, Float, Int, Mesh
from printer_slicer.planning.arcs import Arcs
from printer_slicer.planning.lattice import borders_of, ranges_of, reaches
from printer_slicer.planning.steps import Steps, tolerances
from printer_slicer.profile import OptimalPlanner, Profile
from printer_slicer.surface import find_flats

__all__ = ["ODD", "UNEVEN", "fines_of", "underrated"]

# In the cost of the dearest layer there is. Within a plan of a thousand layers no rule is broken for the objective.
UNEVEN: Final = 1e3
"""For a pair of neighbours that differ by more than the greatest step."""
_OUTSIDE: Final = 1e4  # for a layer next to an event plane that is thinner or thicker than all on the list
_MISSED: Final = 1e5  # for a flat, and up to twice that for a large one
_UNFORCED: Final = 1e7  # for a layer of another height than its range has
_EXCESS: Final = 1e11  # for a mm of error over the tolerance
_UNLISTED: Final = 1e13  # for a layer, where the part can be divided in no other way

ODD: Final = 1.1
"""Times its cost for a layer of a height that is not on the list, where that is free."""
_ROUNDING: Final = 1e-9  # mm


def fines_of(mesh: Mesh, arcs: Arcs, steps: Steps, profile: Profile) -> Float:
    """(A,) what every layer breaks, in the cost of the dearest layer; evenness apart.

    Args:
        mesh: the part.
        arcs: its layers.
        steps: of the printer.
        profile: tolerance, ranges, containment and snap tolerance.
    """
    lattice, graph = arcs.lattice, arcs.graph
    start, end = graph.start, graph.end
    height, tolerance = end - start, _tolerances(arcs, profile)
    over = arcs.bound - tolerance
    # Half a layer that is no higher than the tolerance cannot be wrong by more, rounding or not.
    share = 0.5 if profile.quality.containment == "mid" else 1.0
    over[(share * lattice.unit * height <= tolerance + _ROUNDING) | (over <= _ROUNDING)] = 0.0
    fines: Float = _EXCESS * over
    fines += _MISSED * _missed(mesh, arcs, profile)
    units = height * lattice.steps
    outside = (units < steps.allowed[0]) | (units > steps.allowed[-1])
    fines += _OUTSIDE * (outside & ~((start == 0) & (steps.first > 0)))
    fines += _UNLISTED * ~arcs.free
    for stretch in ranges_of(profile):
        if stretch.layer_height:
            other = height != lattice.units(stretch.layer_height)
            fines += _UNFORCED * (other & reaches(stretch, lattice, start, end))
    return fines


def underrated(arcs: Arcs, profile: Profile, layers: Int, bounds: Float) -> Bool:
    """(L,) whether a layer's exact bound breaks the tolerance that its arc seems to keep.

    Args:
        arcs: the layers that there are.
        profile: what they were found with.
        layers: (L,) arcs of a plan.
        bounds: (L,) mm, exact.
    """
    tolerance = _tolerances(arcs, profile)[layers] + 2 * _ROUNDING
    return np.asarray((arcs.bound[layers] <= tolerance) & (bounds > tolerance))


def _tolerances(arcs: Arcs, profile: Profile) -> Float:
    """(A,) mm, the tolerance of every layer."""
    if not any(stretch.tolerance for stretch in ranges_of(profile)):
        return np.broadcast_to(np.float64(profile.quality.tolerance), arcs.graph.start.shape)
    start, end = (np.asarray(arcs.lattice.unit * nodes) for nodes in (arcs.graph.start, arcs.graph.end))
    return tolerances(profile, start, end)


def _missed(mesh: Mesh, arcs: Arcs, profile: Profile) -> Float:
    """(A,) the flats and borders of ranges that lie within a layer, large flats twice."""
    lattice, planner = arcs.lattice, profile.quality.planner
    flats, areas = find_flats(mesh)
    borders = borders_of(profile, mesh.height)
    place = np.concatenate([flats, borders]) / lattice.unit
    weight = np.concatenate([1 + areas / max(areas.sum(initial=0.0), 1e-9), np.full(len(borders), 2.0)])
    # A contained flat belongs to the node over it or under it, whichever leaves the layer on its side.
    least = 0.5 if profile.quality.containment == "mid" else 1.0
    snap = max((planner.snap_tolerance if isinstance(planner, OptimalPlanner) else 0.0) / lattice.unit, least)
    lowest, highest = np.ceil(place - snap - 1e-6), np.floor(place + snap + 1e-6)
    inside = (lowest > 0) & (highest < lattice.n)
    started, ended = (
        np.cumsum(np.bincount(nodes[inside].astype(np.int64), weight[inside], lattice.n + 1))
        for nodes in (lowest, highest)
    )
    within = np.append(0.0, ended[:-1])[arcs.graph.end] - started[arcs.graph.start]
    return np.where(within > 1e-9, within, 0.0)  # sums leave their rounding behind
