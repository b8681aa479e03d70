"""The best of all plans: the shortest path over the heights at which layers may end.

Every layer that a plan may have between two heights of the z grid is an arc with a cost; the cheapest chain of arcs
from the bed to the top of the part is the plan. In this order of weight:

    list        only allowed heights; other ones only next to an event plane (a flat, a peak, the part's top, the end of
                a range), where they cost a tenth more
    ranges      stretches of z with a layer height of their own have it
    tolerance   the certified error of every layer (see `surface`) is within the tolerance
    flats       layers end on every flat, within the snap tolerance
    range       heights outside of the list's range only to meet a flat or the tolerance
    evenness    neighbours differ by no more than the greatest step, or are smooth (see `smoothness`)
    objective   seconds and volume error at their price, seconds, layers, or volume error

What cannot be had is broken as little as possible, see `levels`; `unkept` tells where and why. Guarantee: no other
chain of the arcs is better by that order; within `max_layers` none has less volume error by these rules, but with
`max_step` too, and within a time budget, none at the same price on what is limited. The arcs' bounds err upward where
contacts begin close to each other, by much less than a z step. Cost: heights of the list x ends; reading the surface is
linear in facets.

Sources: dynamic programming over layer ends after Alexa, Hildebrand and Lefebvre, "Optimal discrete slicing", 2017, and
Mao, Kwok, Chen and Wang, 2019; the certified bound, events and the order above are this project's.
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
    find_underrated,
    rank_constraints,
)
from printer_slicer.planning.height_grid import HeightGrid
from printer_slicer.planning.shortest_path import (
    ArcGraph,
    NeighbourLimits,
    cheapest_path,
    cheapest_with_max_layers,
    cheapest_with_neighbours,
    cheapest_within_budget,
    optimal_arcs,
)
from printer_slicer.planning.smoothness import neighbour_limits
from printer_slicer.planning.z_steps import ZSteps, fill_with_layers
from printer_slicer.profile import Profile
from printer_slicer.surface import layer_bounds, read_surface

__all__ = ["plan_optimal"]

# Tables take coordinates just below a border for being on it: where the exact bound of a layer in a plan turns out to
# break the tolerance, it is put into the table and a plan is looked for again, this many times at most.
_ROUNDS: Final = 20
_MOST_ARCS: Final = 50_000_000  # of about 70 bytes
_DIGITS: Final = 9  # of the dearest layer's cost
_LAYER: Final = 1e-6  # of the dearest layer: of plans that cost the same, the one of fewer layers
_FACTORS: Final = (
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
)  # factors of the price, in the order of trial
_BEATEN: Final = 1e-4  # relative difference of time or volume error; less is rounding
_JUMP: Final = 0.5  # typical layers that avoiding a large step next to a flat is worth
_TIE: Final = 1e-4  # mm³ that a layer must be worth where the volume error alone counts


def plan_optimal(mesh: Mesh, profile: Profile) -> LayerPlan:
    """The plan of least cost within the tolerance.

    Args:
        mesh: the part, standing on z = 0.
        profile: `quality.planner` holds the objective and the dials, `quality` tolerance and allowed heights.

    Raises:
        PlanError: the part is thinner than the thinnest layer, or cannot have so few layers.
    """
    steps = ZSteps(mesh, profile)
    first, rest = steps.begin()
    if rest < steps.lowest or first != steps.first:  # too low for a choice
        heights = np.array([first, rest] if rest and first else [first or rest], np.int64)
        return steps.plan(heights, "optimal")
    for everywhere in (False, True):
        plan = _search_plan(mesh, profile, steps, everywhere=everywhere)
        if plan is not None:
            return plan
    # No layers that the printer can print have this sum: the last one rises over the part.
    above = fill_with_layers(rest, steps.lowest, steps.lowest, steps.highest)
    return steps.plan(np.append([first] if first else [], above).astype(np.int64), "optimal")


def _search_plan(mesh: Mesh, profile: Profile, steps: ZSteps, *, everywhere: bool) -> LayerPlan | None:
    """The best plan of the layers that the list allows, or of all that the printer can print; None without one."""
    surface = read_surface(mesh)
    grid = HeightGrid.of(steps, [stretch.layer_height for stretch in profile.dials.ranges])
    if grid.n * len(steps.allowed) > _MOST_ARCS:
        raise PlanError(
            f"{mesh.name}: {grid.n} heights at which layers may end, and {len(steps.allowed)} heights of layers, are"
            " too many to choose from",
            remedy="a coarser layer_step, a list of heights, or a coarser printer.z_step",
        )
    candidates = CandidateLayers.for_part(mesh, grid, steps, profile, everywhere=everywhere)
    even = neighbour_limits(mesh, grid, steps, profile)
    for _ in range(_ROUNDS):
        layers = _Search(
            mesh, candidates, profile, rank_constraints(mesh, candidates, steps, profile), even
        ).best()
        if layers is None:
            return None
        plan = steps.plan(grid.steps_of(candidates.graph.height[layers]), "optimal")
        bounds = layer_bounds(surface, plan)
        worse = find_underrated(candidates, profile, layers, bounds)
        if not worse.any():
            break
        candidates = candidates.with_bounds(layers[worse], bounds[worse])
    return plan


class _Search:
    """The objective of one plan, over the layers that its part may have and what they break."""

    def __init__(
        self,
        mesh: Mesh,
        candidates: CandidateLayers,
        profile: Profile,
        levels: list[Constraint],
        even: NeighbourLimits | None,
    ) -> None:
        self._settings, self._even = profile.dials, even
        self._odd, self._jump = UNLISTED_FACTOR, _JUMP
        self._mesh, self._thickest = mesh, profile.thickest
        self._candidates, self._levels = candidates, levels
        # Any plan of these keeps the rules as well as they can be kept.
        self._kept = optimal_arcs(candidates.graph, [level.cost for level in levels])
        self._graph = candidates.graph.of(self._kept)

    def best(self) -> Int | None:
        """The layers of the best plan; None where none reaches the top."""
        settings = self._settings
        if len(self._kept) == 0:
            return None
        if settings.max_layers:
            return self._few(settings.max_layers)
        if settings.time_budget:
            return self._quick(settings.time_budget)
        if settings.objective == "balanced":
            return self._balanced()
        return self._search(self._objective())

    def _balanced(self) -> Int | None:
        """Find the plan with the lowest cost of time and volume error, not beaten by a uniform plan in both.

        No plan that keeps the rules can beat it, because that would cost less. A uniform plan that misses flats, or has
        a large step or a height outside the list at its end, can. In that case large steps next to flats and heights
        outside the list become free. If that does not help, the price is raised, then lowered, until none is better.
        """
        candidates, settings = self._candidates, self._settings
        price = settings.error_price or settings.error_price_ratio * candidates.per_mm3

        def searched(factor: float) -> Int | None:
            return self._search(candidates.seconds + price * factor * candidates.volume)

        first = found = searched(1.0)
        self._odd, self._jump = 1.0, 0.0
        factors = iter(_FACTORS)
        while found is not None and self._is_beaten(found):
            factor = next(factors, None)
            if factor is None:
                return first
            found = searched(factor)
        return found

    def _is_beaten(self, layers: Int) -> bool:
        """Whether a uniform plan is as fast and as accurate as this one, and better in one of them."""
        mine = np.array([self._candidates.seconds[layers].sum(), self._candidates.volume[layers].sum()])
        slack = _BEATEN * mine
        theirs = self._candidates.uniform
        return bool(((theirs <= mine + 1e-9).all(axis=1) & (theirs < mine - slack - 1e-9).any(axis=1)).any())

    def _objective(self) -> Float:
        """Cost of every layer, rules apart."""
        candidates, kind = self._candidates, self._settings.objective
        # No plan can be wrong by more than all shadows times the thickest layer.
        surface = read_surface(self._mesh)
        most = (surface.up.area.sum() + surface.down.area.sum()) * self._thickest + 1e-9
        if kind == "time":
            return np.asarray(
                candidates.seconds
                + candidates.volume * (1e-3 * float(candidates.seconds.min(initial=1.0)) / most)
            )
        if kind == "layers":
            return np.asarray(1.0 + candidates.volume * (0.5 / most))
        return candidates.volume + _TIE

    def _cost(self, objective: Float) -> Float:
        """(A,) an objective, rounded so that the dust of sums does not decide between equal plans."""
        worth = _largest_cost(objective)
        cost = np.round(objective / worth, _DIGITS) * worth + _LAYER * worth
        cost[~self._candidates.listed] *= self._odd
        return np.asarray(cost)

    def _search(self, objective: Float) -> Int | None:
        """The layers of the plan that is best by the rules, then by an objective."""
        found = self._cheapest(self._graph, self._cost(objective)[self._kept], _largest_cost(objective))
        return None if found is None else self._kept[found]

    def _cheapest(self, graph: ArcGraph, cost: Float, worth: float) -> Int | None:
        """Find the cheapest plan with as few disallowed neighbours as possible."""
        even, height = self._even, graph.height
        if even is None or not len(height) or even.holds_between(int(height.min()), int(height.max())):
            return cheapest_path(graph, cost)
        most_layers = graph.n / float(height.min()) + 1
        return cheapest_with_neighbours(graph, cost, even, worth * most_layers, self._jump * median(cost))

    def _few(self, most: int) -> Int | None:
        """The least volume error with at most so many layers; with a greatest step, at some price on layers.

        Raises:
            PlanError: so few do not reach the top.
        """
        loss, graph, kept = self._candidates.volume + _TIE, self._graph, self._kept
        worth, cost = _largest_cost(loss), self._cost(loss)
        fewest = cheapest_path(graph, np.ones(len(kept)))
        if fewest is None or len(fewest) > most:
            # So few cannot keep the rules: these are weighed against each other, all of them against the objective.
            graph, kept = self._candidates.graph, np.arange(len(loss))
            cost += worth * np.sum([level.weight * level.cost for level in self._levels], axis=0)
            fewest = cheapest_path(graph, np.ones(len(kept)))
        if fewest is None or len(fewest) > most:
            raise PlanError(
                f"{self._mesh.name}: no plan of {most} layers reaches the top with the heights allowed",
                remedy=f"set max_layers to {0 if fewest is None else len(fewest)} or more, or allow thicker layers",
            )
        if self._settings.max_step:
            found: Int | None = cheapest_within_budget(
                lambda charged: self._cheapest(graph, charged, worth),
                cost[kept],
                np.ones(len(kept)),
                most,
                fewest,
            )[0]
        else:
            found = cheapest_with_max_layers(graph, cost[kept], most)
        return None if found is None else kept[found]

    def _quick(self, budget: float) -> Int | None:
        """The least volume error, at some price on time, within the budget, or else the least time; rules first."""
        seconds, loss, graph = (
            self._candidates.seconds[self._kept],
            self._candidates.volume + _TIE,
            self._graph,
        )
        worth = _largest_cost(self._candidates.seconds)
        quickest = self._cheapest(graph, self._cost(self._candidates.seconds)[self._kept], worth)
        if quickest is None or seconds[quickest].sum() >= budget:
            return None if quickest is None else self._kept[quickest]
        worth = _largest_cost(loss)
        found, _ = cheapest_within_budget(
            lambda charged: self._cheapest(graph, charged, worth),
            self._cost(loss)[self._kept],
            seconds,
            budget,
            quickest,
        )
        return self._kept[found]


def _largest_cost(objective: Float) -> float:
    """What the dearest layer costs."""
    return float(objective.max(initial=0.0)) or 1.0
