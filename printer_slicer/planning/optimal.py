"""The best of all plans: the shortest path over the heights at which layers may end.

Every layer that the printer could print between two heights of its z lattice is an arc with a cost; the cheapest chain
of arcs from the bed to the top of the part is the plan. In this order of weight:

    list        only allowed heights, other ones only next to an event plane (a flat, a peak, the part's top, the end of
                a range), where anything within the printer's limits will do
    tolerance   the certified error of every layer (see `surface`) is within the tolerance
    ranges      stretches of z with a layer height of their own have it
    flats       layers end on every flat, within the snap tolerance
    evenness    neighbours differ by no more than the greatest step
    objective   seconds and volume error at their price, seconds, layers, or volume error

What cannot be had, because the thinnest layer is too thick for it, is broken as little as possible; the certificate of
the plan tells where. Guarantee: no other plan of these heights is better by that order. Cost: the tables take
heights x ends, some milliseconds for a part of 50 mm; reading the surface is linear in facets.

Sources: dynamic programming over layer ends after Alexa, Hildebrand and Lefebvre, "Optimal discrete slicing", 2017, and
Mao, Kwok, Chen and Wang, 2019; the certified bound, events and the order above are this project's.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from printer_slicer.errors import PlanError
from printer_slicer.model import Bool, Float, Int, LayerPlan, Mesh
from printer_slicer.planning.arcs import Arcs, Lattice, counted, touches
from printer_slicer.planning.path import cheapest, cheapest_even, cheapest_few
from printer_slicer.planning.steps import Steps
from printer_slicer.profile import HeightRange, OptimalPlanner, Profile
from printer_slicer.surface import find_flats, read_surface

__all__ = ["plan_optimal"]

# What breaking a rule costs, in the cost of the dearest layer there is: more than any plan of ten thousand layers.
_UNEVEN: Final = 1e3  # for a pair of neighbours
_MISSED: Final = 1e5  # for a flat, and up to twice that for a large one
_UNFORCED: Final = 1e8  # for a layer
_EXCESS: Final = 1e9  # for a mm of error over the tolerance
_UNLISTED: Final = 1e10  # for a layer, where the part can be divided in no other way

_ODD: Final = 1.1  # times its cost for a layer of a height that is not on the list, where that is free
_SLACK: Final = (
    1e-5  # mm under the tolerance: tables take coordinates a little below a border for being on it
)
_BISECTIONS: Final = 12
_TIE: Final = 1e-4  # mm³ that a layer must be worth where the volume error alone counts


def plan_optimal(mesh: Mesh, profile: Profile) -> LayerPlan:
    """The plan of least cost within the tolerance.

    Args:
        mesh: the part, standing on z = 0.
        profile: `quality.planner` holds the objective and the dials, `quality` tolerance and allowed heights.

    Raises:
        PlanError: the part is thinner than the thinnest layer, or cannot have so few layers.
    """
    settings = profile.quality.planner
    if not isinstance(settings, OptimalPlanner):
        settings = OptimalPlanner()
    steps = Steps(mesh, profile)
    first, rest = steps.begin()
    if rest < steps.lowest or first != steps.first:  # too low for a choice
        heights = np.array([first, rest] if rest and first else [first or rest], np.int64)
        return steps.plan(heights, "optimal")
    surface = read_surface(mesh)
    lattice = Lattice.of(steps)
    arcs = Arcs.over(surface, lattice, profile)
    units = _Search(mesh, arcs, steps, settings, profile).best()
    return steps.plan(units * lattice.steps, "optimal")


class _Search:
    """The rules and the objective of one plan, over the tables of its part."""

    def __init__(
        self, mesh: Mesh, arcs: Arcs, steps: Steps, settings: OptimalPlanner, profile: Profile
    ) -> None:
        self._mesh, self._surface = mesh, read_surface(mesh)
        self._arcs, self._steps = arcs, steps
        self._settings, self._profile = settings, profile
        self._start, self._end = arcs.lattice.ends()
        self._fines, self._impossible = self._broken(), self._under_the_bed()
        self._listed, self._free = self._allowed()

    def best(self) -> Int:
        """Heights in units of the best plan."""
        settings, arcs = self._settings, self._arcs
        if settings.max_layers:
            return self._few(settings.max_layers)
        if settings.time_budget:
            return self._within(arcs.volume, arcs.seconds, settings.time_budget)
        return self._solved(self._objective())

    def _objective(self) -> Float:
        """Cost of every layer, rules apart."""
        arcs, kind = self._arcs, self._settings.objective
        # No plan can be wrong by more than all shadows times the thickest layer.
        most = (self._surface.up.area.sum() + self._surface.down.area.sum()) * self._profile.thickest + 1e-9
        if kind == "balanced":
            return np.asarray(arcs.seconds + self._settings.error_price * arcs.volume)
        if kind == "time":
            return np.asarray(arcs.seconds + arcs.volume * (1e-3 * float(arcs.seconds[:, -1].min()) / most))
        if kind == "layers":
            return np.asarray(1.0 + arcs.volume * (0.5 / most))
        return arcs.volume + _TIE

    def _solved(self, objective: Float) -> Int:
        """The cheapest plan by the rules, then by the objective."""
        heights, settings = self._arcs.lattice.heights, self._settings
        change = round(settings.max_step / self._arcs.lattice.unit)
        worth = float(objective.max())

        def search(cost: Float) -> Int | None:
            return (
                cheapest_even(cost, heights, change, _UNEVEN * worth) if change else cheapest(cost, heights)
            )

        return self._by_rules(objective, worth, search)

    def _by_rules(self, objective: Float, worth: float, search: Callable[[Float], Int | None]) -> Int:
        """The plan that a search finds with the rules in force, and with the list of heights eased if it must be."""
        cost = self._fines * worth + np.where(self._listed, objective, _ODD * objective) + self._impossible
        for unlisted in (np.inf, _UNLISTED * worth):
            found = search(np.where(self._free, cost, cost + unlisted))
            if found is not None:
                return found
        raise PlanError(
            f"{self._mesh.name}: no plan of {self._settings.max_layers} layers reaches the top",
            remedy=f"allow at least {-(-self._arcs.lattice.n // int(self._arcs.lattice.heights[-1]))} layers",
        )

    def _few(self, most: int) -> Int:
        """The least volume error with at most so many layers."""
        volume, heights = self._arcs.volume, self._arcs.lattice.heights
        if self._settings.max_step:
            return self._within(volume, np.ones_like(volume), most)
        worth = float(volume.max()) + _TIE
        return self._by_rules(volume, worth, lambda cost: cheapest_few(cost, heights, most))

    def _within(self, loss: Float, spent: Float, budget: float) -> Int:
        """The plan of least loss that spends no more than the budget, or else the one that spends least.

        Spending is given a price; of all prices the lowest that keeps the budget is looked for by bisection.
        """
        free = self._solved(loss + _TIE)
        if self._sum(spent, free) <= budget:
            return free
        low, high = 0.0, float(loss.max() / spent[:, -1].min())
        kept = self._solved(loss + high * spent)
        while self._sum(spent, kept) > budget and high < 1e9:
            low, high = high, 10 * high
            kept = self._solved(loss + high * spent)
        for _ in range(_BISECTIONS):
            price = np.sqrt(low * high) if low else high / 8
            found = self._solved(loss + price * spent)
            if self._sum(spent, found) <= budget:
                high, kept = price, found
            else:
                low = price
        return kept

    def _sum(self, table: Float, heights: Int) -> float:
        """The total of a table over the layers of a plan."""
        return float(table[heights - self._arcs.lattice.heights[0], np.cumsum(heights)].sum())

    def _under_the_bed(self) -> Float:
        """(R, n + 1) infinite for layers that begin under the bed, or on it with another than the first height."""
        first = self._steps.first // self._arcs.lattice.steps
        heights = self._arcs.lattice.heights[:, None]
        wrong = (self._start == 0) & (heights != first) if first else np.zeros_like(self._start, np.bool_)
        return np.where((self._start < 0) | wrong, np.inf, 0.0)

    def _allowed(self) -> tuple[Bool, Bool]:
        """(R, n + 1) layers of an allowed height; and those with the ones that may have any, next to event planes."""
        lattice = self._arcs.lattice
        allowed = np.isin(lattice.heights * lattice.steps, self._steps.allowed)[:, None]
        listed = np.broadcast_to(allowed, self._start.shape).copy()
        for stretch in self._settings.ranges:
            if stretch.layer_height:
                listed |= self._in(stretch) & self._has(stretch.layer_height)
        planes = np.concatenate([self._surface.contacts.events(), self._borders()])
        free = listed | touches(np.append(lattice.nearest(planes), lattice.n), self._start, self._end)
        if self._steps.first:
            free |= self._start == 0
        return listed, free

    def _borders(self) -> Float:
        """Where ranges begin and end."""
        ends = [z for stretch in self._settings.ranges for z in (stretch.low, stretch.high)]
        return np.array([z for z in ends if 0 < z < self._surface.height], np.float64)

    def _in(self, stretch: HeightRange) -> Bool:
        """(R, n + 1) layers that reach into a range."""
        low, high = (round(z / self._arcs.lattice.unit) for z in (stretch.low, stretch.high))
        return np.asarray((self._end > low) & (self._start < high))

    def _has(self, height: float) -> Bool:
        """(R, 1) rows of a height in mm."""
        return np.asarray(self._arcs.lattice.heights == round(height / self._arcs.lattice.unit))[:, None]

    def _broken(self) -> Float:
        """(R, n + 1) what every layer breaks, in the cost of the dearest layer."""
        fines = _EXCESS * np.maximum(self._arcs.bound - (self._tolerances() - _SLACK), 0.0)
        # Half a layer that is no higher than the tolerance cannot be wrong by more, rounding or not.
        share = 0.5 if self._profile.quality.containment == "mid" else 1.0
        reach = share * self._arcs.lattice.unit * self._arcs.lattice.heights[:, None]
        fines[reach <= self._tolerances() + 1e-9] = 0.0
        fines += _MISSED * self._missed()
        for stretch in self._settings.ranges:
            if stretch.layer_height:
                fines += _UNFORCED * (self._in(stretch) & ~self._has(stretch.layer_height))
        return fines

    def _tolerances(self) -> Float:
        """(R, n + 1) the tolerance of every layer."""
        tolerance = np.full(self._start.shape, self._profile.quality.tolerance)
        for stretch in self._settings.ranges:
            if stretch.tolerance:
                np.minimum(tolerance, stretch.tolerance, out=tolerance, where=self._in(stretch))
        return tolerance

    def _missed(self) -> Float:
        """(R, n + 1) the flats and borders of ranges that lie within a layer, large flats twice."""
        lattice = self._arcs.lattice
        flats, areas = find_flats(self._mesh)
        borders = self._borders()
        planes = np.concatenate([flats, borders])
        weight = np.concatenate([1 + areas / max(areas.sum(initial=0.0), 1e-9), np.full(len(borders), 2.0)])
        # A contained flat belongs to the node over it or under it, whichever leaves the layer on its side.
        least = 0.5 if self._profile.quality.containment == "mid" else 1.0
        snap = max(self._settings.snap_tolerance / lattice.unit, least)
        place = planes / lattice.unit
        lowest, highest = (np.ceil(place - snap - 1e-6), np.floor(place + snap + 1e-6))
        inside = (lowest > 0) & (highest < lattice.n)
        return counted(
            (lowest[inside].astype(np.int64), highest[inside].astype(np.int64)),
            weight[inside],
            self._start,
            self._end,
        )
