"""The optimal planner: the shortest path in a graph of heights at which layers may end.

Every candidate layer between two heights of the grid is an arc with a cost. The cheapest path from the bed to the top
of the part is the plan. The constraints and the objective, highest priority first:

    list        allowed heights only; other heights only next to an event plane (a flat, a peak, the top of the part,
                the end of a range), where they cost 10% more
    ranges      height ranges with their own layer height use it
    tolerance   the certified deviation of every layer (see `surface`) is within the tolerance
    flats       layers end on every flat, within the snap tolerance
    supports    with `support_synchronize_layers`, layers end at `support_gap` below flats
    limits      heights outside the limits of the list only to meet a flat or the tolerance
    evenness    neighbours differ by at most `max_step`, or are smooth (see `smoothness`)
    objective   time plus priced volume error, time, number of layers, or volume error

Constraints that cannot be met are violated as little as possible (see `constraint_priorities`); `violations` reports
where and why. Guarantee: no other path is better in this order. With `max_layers` no path has less volume error; with
`max_step` in addition, or with a time budget, the plan is optimal for some price on the limited quantity. The
deviation bounds of arcs are slightly too high where contacts start close together, by much less than a z step. Cost:
number of heights times number of ends; reading the surface is linear in the number of facets.

Sources: dynamic programming over layer ends after Alexa, Hildebrand and Lefebvre, "Optimal discrete slicing", 2017, and
Mao, Kwok, Chen and Wang, 2019. The certified bound, the events and the priorities are this project's.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.arrays import Float, Int, median
from printer_slicer.errors import PlanError
from printer_slicer.model import LayerPlan, Mesh
from printer_slicer.planning.candidate_layers import CandidateLayers
from printer_slicer.planning.constraint_priorities import (
    UNLISTED_FACTOR,
    Constraint,
    find_underestimated,
    rank_constraints,
)
from printer_slicer.planning.height_grid import HeightGrid
from printer_slicer.planning.smoothness import neighbour_limits
from printer_slicer.planning.z_steps import ZSteps, fill_with_layers
from printer_slicer.profile import Profile
from printer_slicer.shortest_path import (
    ArcGraph,
    NeighbourLimits,
    cheapest_path,
    cheapest_with_max_layers,
    cheapest_with_neighbours,
    cheapest_within_budget,
    optimal_arcs,
)
from printer_slicer.surface import layer_bounds, read_surface

__all__ = ["plan_optimal"]

# Tabulated bounds treat coordinates just below a cell border as on it. If the exact bound of a layer in the plan
# exceeds the tolerance, it replaces the tabulated one and the search is repeated, at most this many times.
_MAX_ROUNDS: Final = 20
_MAX_ARCS: Final = 50_000_000  # memory limit; an arc takes about 70 bytes
_COST_DECIMALS: Final = 9  # decimals of costs, relative to the largest layer cost
_COST_PER_LAYER: Final = (
    1e-6  # added per layer, relative to the largest cost, so that on ties the plan with fewer layers wins
)
_PRICE_FACTORS: Final = (
    1.0,
    1.25,
    1.6,
    2.0,
    3.0,
    5.0,
    10.0,
    0.8,
    0.6,
    0.4,
    0.2,
)  # price factors, in the order in which they are tried
_MIN_DIFFERENCE: Final = 1e-4  # smallest relative difference of time or volume error that is not rounding
_STEP_PENALTY: Final = 0.5  # penalty for a large step next to a flat, in median layer costs
_ERROR_PER_LAYER: Final = 1e-4  # mm³ added per layer if the objective is the volume error alone


def plan_optimal(mesh: Mesh, profile: Profile) -> LayerPlan:
    """Plan the layers of least cost within the tolerance.

    Args:
        mesh: the part, standing on z = 0.
        profile: `quality.planner` has the objective and other settings, `quality` the tolerance and allowed heights.

    Raises:
        PlanError: the part is thinner than the thinnest layer, or `max_layers` is too small.
    """
    steps = ZSteps(mesh, profile)
    first, rest = steps.split_first_layer()
    if rest < steps.lowest or first != steps.first:  # too low for any choice
        heights = np.array([first, rest] if rest and first else [first or rest], np.int64)
        return steps.make_plan(heights, "optimal")
    for everywhere in (False, True):
        plan = _search_plan(mesh, profile, steps, everywhere=everywhere)
        if plan is not None:
            return plan
    # No printable heights add up to the height of the part, so the last layer extends above it.
    above = fill_with_layers(rest, steps.lowest, steps.lowest, steps.highest)
    return steps.make_plan(np.append([first] if first else [], above).astype(np.int64), "optimal")


def _search_plan(mesh: Mesh, profile: Profile, steps: ZSteps, *, everywhere: bool) -> LayerPlan | None:
    """Find the best plan of allowed layers or, with `everywhere`, of all printable layers; None if there is none."""
    surface = read_surface(mesh)
    grid = HeightGrid.of(steps, [height_range.layer_height for height_range in profile.dials.ranges])
    if grid.n * len(steps.allowed) > _MAX_ARCS:
        raise PlanError(
            f"{mesh.name}: {grid.n} possible layer tops with {len(steps.allowed)} layer heights are too many to search",
            remedy="Set a coarser layer_step, a list of layer_heights, or a coarser printer.z_step",
        )
    candidates = CandidateLayers.for_part(mesh, grid, steps, profile, everywhere=everywhere)
    neighbours = neighbour_limits(mesh, grid, steps, profile)
    for _ in range(_MAX_ROUNDS):
        layers = _Search(
            mesh, candidates, profile, rank_constraints(mesh, candidates, steps, profile), neighbours
        ).find_best()
        if layers is None:
            return None
        plan = steps.make_plan(grid.to_steps(candidates.graph.height[layers]), "optimal")
        bounds = layer_bounds(surface, plan)
        worse = find_underestimated(candidates, profile, layers, bounds)
        if not worse.any():
            break
        candidates = candidates.with_bounds(layers[worse], bounds[worse])
    return plan


class _Search:
    """The search for one plan among the candidate layers, given constraints and objective."""

    def __init__(
        self,
        mesh: Mesh,
        candidates: CandidateLayers,
        profile: Profile,
        constraints: list[Constraint],
        neighbours: NeighbourLimits | None,
    ) -> None:
        self._settings, self._neighbours = profile.dials, neighbours
        self._unlisted_factor, self._step_penalty = UNLISTED_FACTOR, _STEP_PENALTY
        self._mesh, self._thickest = mesh, profile.thickest
        self._candidates, self._constraints = candidates, constraints
        # Every plan of these layers violates the constraints as little as possible.
        self._kept = optimal_arcs(candidates.graph, [constraint.cost for constraint in constraints])
        self._graph = candidates.graph.with_arcs(self._kept)

    def find_best(self) -> Int | None:
        """Return the layers of the best plan; None if no plan reaches the top."""
        settings = self._settings
        if len(self._kept) == 0:
            return None
        if settings.max_layers:
            return self._minimize_with_max_layers(settings.max_layers)
        if settings.time_budget:
            return self._minimize_within_time(settings.time_budget)
        if settings.objective == "balanced":
            return self._minimize_balanced_cost()
        return self._minimize(self._layer_costs())

    def _minimize_balanced_cost(self) -> Int | None:
        """Find the plan with the lowest cost of time and volume error that no uniform plan dominates.

        No plan within the constraints can dominate it, because that plan would cost less. A uniform plan can, if it
        misses flats or ends with a large step or a height outside the list. In that case large steps next to flats and
        heights outside the list become free. If that does not help, the price is raised, then lowered, until no uniform
        plan is better.
        """
        candidates, settings = self._candidates, self._settings
        price = settings.error_price or settings.error_price_ratio * candidates.seconds_per_mm3

        def search(factor: float) -> Int | None:
            """Find the cheapest plan for `factor` times the price."""
            return self._minimize(candidates.seconds + price * factor * candidates.volume)

        first = found = search(1.0)
        self._unlisted_factor, self._step_penalty = 1.0, 0.0
        factors = iter(_PRICE_FACTORS)
        while found is not None and self._is_dominated(found):
            factor = next(factors, None)
            if factor is None:
                return first
            found = search(factor)
        return found

    def _is_dominated(self, layers: Int) -> bool:
        """Return whether a uniform plan is faster or more accurate than these layers, and not worse in the other."""
        mine = np.array([self._candidates.seconds[layers].sum(), self._candidates.volume[layers].sum()])
        slack = _MIN_DIFFERENCE * mine
        theirs = self._candidates.uniform
        return bool(((theirs <= mine + 1e-9).all(axis=1) & (theirs < mine - slack - 1e-9).any(axis=1)).any())

    def _layer_costs(self) -> Float:
        """Return the cost (A,) of every layer by the objective, without constraints."""
        candidates, kind = self._candidates, self._settings.objective
        # Upper bound of the volume error of any plan: all shadows times the thickest layer.
        surface = read_surface(self._mesh)
        most = (surface.up.area.sum() + surface.down.area.sum()) * self._thickest + 1e-9
        if kind == "time":
            return np.asarray(
                candidates.seconds
                + candidates.volume * (1e-3 * float(candidates.seconds.min(initial=1.0)) / most)
            )
        if kind == "layers":
            return np.asarray(1.0 + candidates.volume * (0.5 / most))
        return candidates.volume + _ERROR_PER_LAYER

    def _round_costs(self, objective: Float) -> Float:
        """Round the costs (A,) of an objective, so that rounding errors do not decide between equal plans."""
        worth = _largest_cost(objective)
        cost = np.round(objective / worth, _COST_DECIMALS) * worth + _COST_PER_LAYER * worth
        cost[~self._candidates.listed] *= self._unlisted_factor
        return np.asarray(cost)

    def _minimize(self, objective: Float) -> Int | None:
        """Return the layers of the plan with the lowest cost among those that meet the constraints best."""
        found = self._find_cheapest(
            self._graph, self._round_costs(objective)[self._kept], _largest_cost(objective)
        )
        return None if found is None else self._kept[found]

    def _find_cheapest(self, graph: ArcGraph, cost: Float, largest_cost: float) -> Int | None:
        """Find the cheapest plan; each pair of neighbours that is not allowed costs more than any plan."""
        neighbours, height = self._neighbours, graph.height
        if (
            neighbours is None
            or not len(height)
            or neighbours.allows_all_between(int(height.min()), int(height.max()))
        ):
            return cheapest_path(graph, cost)
        most_layers = graph.n / float(height.min()) + 1
        return cheapest_with_neighbours(
            graph, cost, neighbours, largest_cost * most_layers, self._step_penalty * median(cost)
        )

    def _minimize_with_max_layers(self, max_layers: int) -> Int | None:
        """Minimize the volume error with at most `max_layers` layers; with `max_step`, by a price on layers.

        Raises:
            PlanError: `max_layers` layers do not reach the top.
        """
        loss, graph, kept = self._candidates.volume + _ERROR_PER_LAYER, self._graph, self._kept
        worth, cost = _largest_cost(loss), self._round_costs(loss)
        fewest = cheapest_path(graph, np.ones(len(kept)))
        if fewest is None or len(fewest) > max_layers:
            # So few layers cannot meet the constraints, so these become weighted costs.
            graph, kept = self._candidates.graph, np.arange(len(loss))
            cost += worth * np.sum([one.weight * one.cost for one in self._constraints], axis=0)
            fewest = cheapest_path(graph, np.ones(len(kept)))
        if fewest is None or len(fewest) > max_layers:
            raise PlanError(
                f"{self._mesh.name}: no plan of {max_layers} layers reaches the top with the heights allowed",
                remedy=f"Set max_layers to {0 if fewest is None else len(fewest)} or more, or allow thicker layers",
            )
        if self._settings.max_step:
            found: Int | None = cheapest_within_budget(
                lambda charged: self._find_cheapest(graph, charged, worth),
                cost[kept],
                np.ones(len(kept)),
                max_layers,
                fewest,
            )[0]
        else:
            found = cheapest_with_max_layers(graph, cost[kept], max_layers)
        return None if found is None else kept[found]

    def _minimize_within_time(self, budget: float) -> Int | None:
        """Minimize the volume error within the time budget, by a price on time; if impossible, minimize time."""
        seconds, loss, graph = (
            self._candidates.seconds[self._kept],
            self._candidates.volume + _ERROR_PER_LAYER,
            self._graph,
        )
        worth = _largest_cost(self._candidates.seconds)
        quickest = self._find_cheapest(graph, self._round_costs(self._candidates.seconds)[self._kept], worth)
        if quickest is None or seconds[quickest].sum() >= budget:
            return None if quickest is None else self._kept[quickest]
        worth = _largest_cost(loss)
        found, _ = cheapest_within_budget(
            lambda charged: self._find_cheapest(graph, charged, worth),
            self._round_costs(loss)[self._kept],
            seconds,
            budget,
            quickest,
        )
        return self._kept[found]


def _largest_cost(objective: Float) -> float:
    """Return the largest cost of a layer, or 1 if all are 0."""
    return float(objective.max(initial=0.0)) or 1.0
