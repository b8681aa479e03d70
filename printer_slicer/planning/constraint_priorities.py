"""The constraints on layers in order of priority; a constraint is never violated in favour of a lower one."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.model import Mesh
from printer_slicer.planning.candidate_layers import CandidateLayers
from printer_slicer.planning.height_grid import overlaps_range, range_ends
from printer_slicer.planning.support_tops import find_support_contacts
from printer_slicer.planning.z_steps import ZSteps, layer_tolerances
from printer_slicer.profile import Profile
from printer_slicer.surface import find_flats

__all__ = ["UNLISTED_FACTOR", "Constraint", "find_underestimated", "rank_constraints"]

UNLISTED_FACTOR: Final = 1.1
"""Cost factor for a layer whose height is not on the list, next to an event plane."""
_ROUNDING: Final = 1e-9  # mm


class Constraint(NamedTuple):
    """A constraint on layers.

    Attributes:
        weight: cost per unit of violation, as a multiple of the largest layer cost, if constraints must be weighted.
        cost: (A,) violation by each layer, at least 0.
    """

    weight: float
    cost: Float


def rank_constraints(
    mesh: Mesh, candidates: CandidateLayers, steps: ZSteps, profile: Profile
) -> list[Constraint]:
    """Return the constraints that some candidate layers violate, highest priority first.

    Limits for neighbouring layers are not among them. The order is: heights not on the list; heights that differ from
    those of ranges; deviation above the tolerance; missed flats and ends of ranges; missed tops of supports that have
    the layers of the part; heights outside the limits of the list. If the thinnest layers can deviate by more than the
    tolerance, deviation above twice their bound comes before flats, and the rest after them. Deviations are squared and
    multiplied by the layer height.

    Args:
        mesh: the part.
        candidates: the candidate layers.
        steps: z steps of the printer.
        profile: tolerance, ranges, containment and snap tolerance.
    """
    grid, graph = candidates.grid, candidates.graph
    start, end = graph.start, graph.end
    height, tolerance = end - start, _candidate_tolerances(candidates, profile)
    share = 0.5 if profile.quality.containment == "mid" else 1.0
    # The deviation bound of the thinnest layers; layers below twice their height can divide any interval.
    certain = np.float64(share * steps.allowed[0] * steps.size)
    mm: Float = np.asarray(grid.unit * height, np.float64)
    possible: Float = np.asarray(np.where(tolerance < certain, 2 * certain, tolerance), np.float64)
    # A layer with contoured parts may deviate by more than half its height.
    largest_possible: Float = np.asarray(mm if profile.quality.z_contouring else share * mm)
    over, beyond = (
        _compute_excess(candidates.bound, tolerance, largest_possible),
        _compute_excess(candidates.bound, possible, largest_possible),
    )
    chosen = (start > 0) | (steps.first == 0)  # without a fixed first layer
    other = np.zeros(len(start))
    for height_range in profile.dials.ranges:
        if height_range.layer_height:
            inside = overlaps_range(height_range, grid, start, end) & chosen
            other += inside & (height != grid.to_units(height_range.layer_height))
    units = height * grid.steps
    outside = ((units < steps.allowed[0]) | (units > steps.allowed[-1])) & chosen
    constraints = [
        Constraint(1e14, np.asarray(~candidates.free, np.float64)),
        Constraint(1e12, other),
        Constraint(1e13, mm * beyond**2),
        Constraint(1e5, _count_missed_planes(mesh, candidates, profile)),
        Constraint(1e6, mm * over**2),
        Constraint(2e4, _count_missed_support_tops(mesh, candidates, profile)),
        Constraint(1e4, np.asarray(outside, np.float64)),
    ]
    return [constraint for constraint in constraints if constraint.cost.any()]


def _compute_excess(bound: Float, limit: Float, largest_possible: Float) -> Float:
    """Return the excess of bounds over their limit (A,), mm, rounded to 1 nm to hide rounding errors of 32-bit files.

    The excess is 0 for layers so thin that they cannot exceed the limit.
    """
    over, gap = np.zeros(len(bound)), bound - limit
    some = np.flatnonzero((gap > 0) & (largest_possible > limit + _ROUNDING))
    excess = np.round(gap.take(some), 6)
    over[some] = np.where(excess > _ROUNDING, excess, 0.0)
    return over


def find_underestimated(candidates: CandidateLayers, profile: Profile, layers: Int, bounds: Float) -> Bool:
    """Return which layers (L,) exceed the tolerance by their exact bound, although their tabulated bound does not.

    Args:
        candidates: the candidate layers.
        profile: gives the tolerance.
        layers: (L,) the layers of a plan.
        bounds: (L,) their exact bounds, mm.
    """
    tolerance = _candidate_tolerances(candidates, profile)[layers] + 2 * _ROUNDING
    return np.asarray((candidates.bound[layers] <= tolerance) & (bounds > tolerance))


def _candidate_tolerances(candidates: CandidateLayers, profile: Profile) -> Float:
    """Return the tolerance of every layer (A,), mm."""
    if not any(height_range.tolerance for height_range in profile.dials.ranges):
        return np.broadcast_to(np.float64(profile.quality.tolerance), candidates.graph.start.shape)
    start, end = (
        np.asarray(candidates.grid.unit * nodes) for nodes in (candidates.graph.start, candidates.graph.end)
    )
    return layer_tolerances(profile, start, end)


def _count_missed_planes(mesh: Mesh, candidates: CandidateLayers, profile: Profile) -> Float:
    """Return the number (A,) of flats and ends of height ranges inside each layer, weighted from 1 to 2."""
    grid = candidates.grid
    flats, areas = find_flats(mesh)
    borders = range_ends(profile, mesh.height)
    place = np.concatenate([flats, borders]) / grid.unit
    weight = np.concatenate([1 + areas / max(areas.sum(initial=0.0), 1e-9), np.full(len(borders), 2.0)])
    # With containment a flat snaps to the node above or below it, depending on the side of the layer.
    least = 0.5 if profile.quality.containment == "mid" else 1.0
    snap = max(profile.dials.snap_tolerance / grid.unit, least)
    lowest, highest = np.ceil(place - snap - 1e-6), np.floor(place + snap + 1e-6)
    return _sum_missed(candidates, lowest.astype(np.int64), highest.astype(np.int64), weight)


def _count_missed_support_tops(mesh: Mesh, candidates: CandidateLayers, profile: Profile) -> Float:
    """Return the number (A,) of flats above supports, and of tops of these supports, inside each layer."""
    nodes = np.concatenate(find_support_contacts(mesh, profile, candidates.grid.unit))
    return _sum_missed(candidates, nodes, nodes, np.ones(len(nodes)))


def _sum_missed(candidates: CandidateLayers, lowest: Int, highest: Int, weight: Float) -> Float:
    """Return the total weight (A,) of the node intervals (n,), ends included, that lie inside each layer."""
    grid, graph = candidates.grid, candidates.graph
    inside = (lowest > 0) & (highest < grid.n)
    started, ended = (
        np.cumsum(np.bincount(nodes[inside], weight[inside], grid.n + 1)) for nodes in (lowest, highest)
    )
    within = np.append(0.0, ended[:-1])[graph.end] - started[graph.start]
    return np.where(within > 1e-9, within, 0.0)  # removes rounding errors of the sums
