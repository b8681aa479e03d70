"""What the layers of a plan break, rule by rule: no rule is broken for a lesser one, and none for the objective."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.model import Mesh
from printer_slicer.planning.candidate_layers import CandidateLayers
from printer_slicer.planning.height_grid import overlaps_range, range_borders
from printer_slicer.planning.z_steps import ZSteps, layer_tolerances
from printer_slicer.profile import Profile
from printer_slicer.surface import find_flats

__all__ = ["UNLISTED_FACTOR", "Constraint", "find_underrated", "rank_constraints"]

UNLISTED_FACTOR: Final = 1.1
"""Times its cost for a layer of a height that is not on the list, where that is free."""
_ROUNDING: Final = 1e-9  # mm


class Constraint(NamedTuple):
    """A rule.

    Attributes:
        weight: what a unit of it is worth, in the cost of the dearest layer, where rules must be weighed.
        cost: (A,) how much each layer breaks it, at least 0.
    """

    weight: float
    cost: Float


def rank_constraints(
    mesh: Mesh, candidates: CandidateLayers, steps: ZSteps, profile: Profile
) -> list[Constraint]:
    """The rules that some layers break, the gravest first; evenness apart.

    Unlisted heights; other heights than ranges have; error over the tolerance; flats and ends of ranges; heights beyond
    the list's. Where the thinnest layers can be wrong by more than the tolerance, it is error over twice theirs that
    comes before flats, and what is left of it comes after them. Errors count squared, over the height of the layer.

    Args:
        mesh: the part.
        candidates: its layers.
        steps: of the printer.
        profile: tolerance, ranges, containment and snap tolerance.
    """
    grid, graph = candidates.grid, candidates.graph
    start, end = graph.start, graph.end
    height, tolerance = end - start, _tolerances(candidates, profile)
    share = 0.5 if profile.quality.containment == "mid" else 1.0
    # The thinnest layers are nowhere wrong by more than this; layers under twice their height can divide everything.
    certain = np.float64(share * steps.allowed[0] * steps.size)
    mm: Float = np.asarray(grid.unit * height, np.float64)
    possible: Float = np.asarray(np.where(tolerance < certain, 2 * certain, tolerance), np.float64)
    most: Float = np.asarray(share * mm)
    over, beyond = _excess(candidates.bound, tolerance, most), _excess(candidates.bound, possible, most)
    chosen = (start > 0) | (steps.first == 0)  # not the first layer, where that is set
    other = np.zeros(len(start))
    for stretch in profile.dials.ranges:
        if stretch.layer_height:
            inside = overlaps_range(stretch, grid, start, end) & chosen
            other += inside & (height != grid.units(stretch.layer_height))
    units = height * grid.steps
    outside = ((units < steps.allowed[0]) | (units > steps.allowed[-1])) & chosen
    levels = [
        Constraint(1e14, np.asarray(~candidates.free, np.float64)),
        Constraint(1e12, other),
        Constraint(1e13, mm * beyond**2),
        Constraint(1e5, _missed_planes(mesh, candidates, profile)),
        Constraint(1e6, mm * over**2),
        Constraint(1e4, np.asarray(outside, np.float64)),
    ]
    return [level for level in levels if level.cost.any()]


def _excess(bound: Float, limit: Float, most: Float) -> Float:
    """(A,) mm by which bounds are over their limit, to a nanometre: 32-bit files must not decide between plans.

    A layer that can be wrong by no more than the limit, by its height alone, is not, rounding or not.
    """
    over, gap = np.zeros(len(bound)), bound - limit
    some = np.flatnonzero((gap > 0) & (most > limit + _ROUNDING))
    excess = np.round(gap.take(some), 6)
    over[some] = np.where(excess > _ROUNDING, excess, 0.0)
    return over


def find_underrated(candidates: CandidateLayers, profile: Profile, layers: Int, bounds: Float) -> Bool:
    """(L,) whether a layer's exact bound breaks the tolerance that its arc seems to keep.

    Args:
        candidates: the layers that there are.
        profile: what they were found with.
        layers: (L,) arcs of a plan.
        bounds: (L,) mm, exact.
    """
    tolerance = _tolerances(candidates, profile)[layers] + 2 * _ROUNDING
    return np.asarray((candidates.bound[layers] <= tolerance) & (bounds > tolerance))


def _tolerances(candidates: CandidateLayers, profile: Profile) -> Float:
    """(A,) mm, the tolerance of every layer."""
    if not any(stretch.tolerance for stretch in profile.dials.ranges):
        return np.broadcast_to(np.float64(profile.quality.tolerance), candidates.graph.start.shape)
    start, end = (
        np.asarray(candidates.grid.unit * nodes) for nodes in (candidates.graph.start, candidates.graph.end)
    )
    return layer_tolerances(profile, start, end)


def _missed_planes(mesh: Mesh, candidates: CandidateLayers, profile: Profile) -> Float:
    """(A,) the flats and borders of ranges that lie within a layer, large flats twice."""
    grid = candidates.grid
    flats, areas = find_flats(mesh)
    borders = range_borders(profile, mesh.height)
    place = np.concatenate([flats, borders]) / grid.unit
    weight = np.concatenate([1 + areas / max(areas.sum(initial=0.0), 1e-9), np.full(len(borders), 2.0)])
    # A contained flat belongs to the node over it or under it, whichever leaves the layer on its side.
    least = 0.5 if profile.quality.containment == "mid" else 1.0
    snap = max(profile.dials.snap_tolerance / grid.unit, least)
    lowest, highest = np.ceil(place - snap - 1e-6), np.floor(place + snap + 1e-6)
    inside = (lowest > 0) & (highest < grid.n)
    started, ended = (
        np.cumsum(np.bincount(nodes[inside].astype(np.int64), weight[inside], grid.n + 1))
        for nodes in (lowest, highest)
    )
    within = np.append(0.0, ended[:-1])[candidates.graph.end] - started[candidates.graph.start]
    return np.where(within > 1e-9, within, 0.0)  # sums leave their rounding behind
