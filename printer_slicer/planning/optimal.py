"""The best of all plans: the shortest path over the heights at which layers may end.

Every layer that the printer could print between two heights of its z lattice is an arc with a cost; the cheapest chain
of arcs from the bed to the top of the part is the plan. In this order of weight:

    list        only allowed heights; other ones only next to an event plane (a flat, a peak, the part's top, the end of
                a range), where they cost a tenth more, and outside of the list's range only to meet a flat or the
                tolerance
    tolerance   the certified error of every layer (see `surface`) is within the tolerance
    ranges      stretches of z with a layer height of their own have it
    flats       layers end on every flat, within the snap tolerance
    evenness    neighbours differ by no more than the greatest step
    objective   seconds and volume error at their price, seconds, layers, or volume error

What cannot be had, because the thinnest layer is too thick for it, is broken as little as possible; the certificate of
the plan tells where. Guarantee: no other chain of the tables is better by that order. The tables' bounds err upward by
less than a cell (0.0025 mm), so a layer that keeps the tolerance by less than that may be passed over. Cost: tables of
heights x ends, a tenth of a second for a part of 50 mm with z steps of 0.0025 mm; reading the surface is linear in
facets.

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
from printer_slicer.planning.steps import Steps, fill, tolerances
from printer_slicer.profile import HeightRange, OptimalPlanner, Profile
from printer_slicer.surface import find_flats, layer_bounds, read_surface

__all__ = ["plan_optimal"]

# What breaking a rule costs, in the cost of the dearest layer there is: more than any plan of ten thousand layers.
_UNEVEN: Final = 1e3  # for a pair of neighbours
_OUTSIDE: Final = 1e4  # for a layer next to an event plane that is thinner or thicker than all on the list
_MISSED: Final = 1e5  # for a flat, and up to twice that for a large one
_UNFORCED: Final = 1e7  # for a layer
_EXCESS: Final = 1e11  # for a mm of error over the tolerance
_UNLISTED: Final = 1e13  # for a layer, where the part can be divided in no other way

_ODD: Final = 1.1  # times its cost for a layer of a height that is not on the list, where that is free
# mm under the tolerance, tried in turn: tables take coordinates just below a border for being on it, and the exact
# bounds of contained layers count what they leave out beside their borders.
_SLACKS: Final = (0.0, 6e-5)
_ROUNDING: Final = 1e-9  # mm
_DIGITS: Final = 9  # of the dearest layer's cost
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
    steps, planner = Steps(mesh, profile), profile.quality.planner
    first, rest = steps.begin()
    if rest < steps.lowest or first != steps.first:  # too low for a choice
        heights = np.array([first, rest] if rest and first else [first or rest], np.int64)
        return steps.plan(heights, "optimal")
    ranges = planner.ranges if isinstance(planner, OptimalPlanner) else ()
    lattice = Lattice.of(steps, [stretch.layer_height for stretch in ranges])
    arcs = Arcs.over(read_surface(mesh), lattice, profile)
    for slack in _SLACKS:
        search = _Search(mesh, arcs, steps, profile, slack=slack)
        units = search.best()
        plan = steps.plan(units * lattice.steps, "optimal")
        if search.keeps(units, layer_bounds(read_surface(mesh), plan)):
            break
    return plan


class _Search:
    """The rules and the objective of one plan, over the tables of its part."""

    def __init__(self, mesh: Mesh, arcs: Arcs, steps: Steps, profile: Profile, *, slack: float) -> None:
        planner = profile.quality.planner
        self._settings = planner if isinstance(planner, OptimalPlanner) else OptimalPlanner()
        self._mesh, self._surface, self._profile = mesh, read_surface(mesh), profile
        self._arcs, self._steps, self._slack = arcs, steps, slack
        self._start, self._end = arcs.lattice.ends()
        self._fines, self._impossible = self._broken(), self._under_the_bed()
        self._listed, self._free = self._allowed()

    def keeps(self, heights: Int, bounds: Float) -> bool:
        """Whether the exact bounds of a plan are within the tolerance wherever the tables say so."""
        if heights.sum() > self._arcs.lattice.n:  # rises over the part, which no table knows
            return True
        place = (heights - self._arcs.lattice.heights[0], np.cumsum(heights))
        within, tolerance = self._fines[place] < _EXCESS * _ROUNDING, self._tolerances()[place]
        return bool((bounds[within] <= tolerance[within] + _ROUNDING).all())

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

    def _solved(self, objective: Float, worth: float = 0.0) -> Int:
        """The cheapest plan by the rules, then by the objective; `worth` is what rules are weighed with."""
        heights, settings = self._arcs.lattice.heights, self._settings
        change = int(settings.max_step / self._arcs.lattice.unit + 1e-6)
        worth = worth or float(objective.max())

        def search(cost: Float) -> Int | None:
            if settings.max_step:
                return cheapest_even(cost, heights, change, _UNEVEN * worth)
            return cheapest(cost, heights)

        found = self._by_rules(objective, worth, search)
        if found is None:
            # No layers that the printer can print have this sum: the last one rises over the part.
            first = self._steps.first // self._arcs.lattice.steps
            low, high = int(heights[0]), int(heights[-1])
            layers = fill(self._arcs.lattice.n - first, low, low, high)
            found = np.append([first] if first else [], layers).astype(np.int64)
        return found

    def _by_rules(self, objective: Float, worth: float, search: Callable[[Float], Int | None]) -> Int | None:
        """The plan that a search finds with the rules in force, and with the list of heights eased if it must be."""
        # Rounded, so that the dust of sums does not decide between equal plans.
        cost = np.round(objective / (worth or 1.0), _DIGITS) * (worth or 1.0)
        cost[~self._listed] *= _ODD
        cost += self._fines * worth
        cost[self._impossible] = np.inf
        for unlisted in (np.inf, _UNLISTED * worth):
            found = search(np.where(self._free, cost, cost + unlisted))
            if found is not None:
                return found
        return None

    def _few(self, most: int) -> Int:
        """The least volume error with at most so many layers.

        Raises:
            PlanError: so few do not reach the top.
        """
        volume, heights = self._arcs.volume, self._arcs.lattice.heights
        count, worth = np.ones_like(volume), float(volume.max()) + _TIE
        fewest = self._by_rules(count, 0.0, lambda cost: cheapest(cost, heights))
        if fewest is not None and len(fewest) > most:
            raise PlanError(
                f"{self._mesh.name}: no plan of {most} layers reaches the top with the heights allowed",
                remedy=f"set max_layers to {len(fewest)} or more, or allow thicker layers",
            )
        if self._settings.max_step:
            even = self._within(volume, count, most)
            if len(even) <= most:
                return even
        found = self._by_rules(volume, worth, lambda cost: cheapest_few(cost, heights, most))
        return self._solved(volume) if found is None else found

    def _within(self, loss: Float, spent: Float, budget: float) -> Int:
        """The plan of least loss that spends no more than the budget, or else the one that spends least.

        Spending is given a price; of all prices the lowest that keeps the budget is looked for by bisection.
        """
        worth = float(loss.max()) + _TIE
        kept = self._solved(loss + _TIE, worth)
        if self._sum(spent, kept) <= budget:
            return kept
        low, high = 0.0, worth / float(spent[:, -1].max())
        for _ in range(_BISECTIONS):
            kept = self._solved(loss + high * spent, worth)
            if self._sum(spent, kept) <= budget:
                break
            low, high = high, 10 * high
        for _ in range(_BISECTIONS if self._sum(spent, kept) <= budget else 0):
            price = np.sqrt(low * high) if low else high / 8
            found = self._solved(loss + price * spent, worth)
            if self._sum(spent, found) <= budget:
                high, kept = price, found
            else:
                low = price
        return kept

    def _sum(self, table: Float, heights: Int) -> float:
        """The total of a table over the layers of a plan."""
        end = np.minimum(np.cumsum(heights), self._arcs.lattice.n)
        return float(table[heights - self._arcs.lattice.heights[0], end].sum())

    def _under_the_bed(self) -> Bool:
        """(R, n + 1) layers that begin under the bed, or on it with another than the first height."""
        first = self._steps.first // self._arcs.lattice.steps
        heights = self._arcs.lattice.heights[:, None]
        wrong = (self._start == 0) & (heights != first) if first else np.zeros_like(self._start, np.bool_)
        return np.asarray((self._start < 0) | wrong)

    def _allowed(self) -> tuple[Bool, Bool]:
        """(R, n + 1) layers of an allowed height; and those with the ones that may have any, next to event planes."""
        lattice = self._arcs.lattice
        allowed = np.isin(lattice.heights * lattice.steps, self._steps.allowed)[:, None]
        listed = np.broadcast_to(allowed, self._start.shape).copy()
        for stretch in self._settings.ranges:
            if stretch.layer_height:
                listed |= self._in(stretch) & self._has(stretch.layer_height)
        planes = np.concatenate([self._surface.contacts.events(), self._borders()])
        events = np.append(lattice.nearest(planes), lattice.n)
        free = listed | touches(events[events > 0], self._start, self._end)
        if self._steps.first:
            free |= self._start == 0
        return listed, free

    def _borders(self) -> Float:
        """Where ranges begin and end."""
        ends = [z for stretch in self._settings.ranges for z in (stretch.low, stretch.high)]
        return np.array([z for z in ends if 0 < z < self._surface.height], np.float64)

    def _in(self, stretch: HeightRange) -> Bool:
        """(R, n + 1) layers that reach into a range."""
        low, high = self._ends(stretch)
        return np.asarray((self._end > low) & (self._start < high))

    def _has(self, height: float) -> Bool:
        """(R, 1) rows of a height in mm."""
        return np.asarray(self._arcs.lattice.heights == round(height / self._arcs.lattice.unit))[:, None]

    def _broken(self) -> Float:
        """(R, n + 1) what every layer breaks, in the cost of the dearest layer."""
        tolerance, lattice = self._tolerances(), self._arcs.lattice
        over = self._arcs.bound - tolerance
        over += self._slack
        # Half a layer that is no higher than the tolerance cannot be wrong by more, rounding or not.
        share = 0.5 if self._profile.quality.containment == "mid" else 1.0
        harmless = share * lattice.unit * lattice.heights[:, None] <= tolerance + _ROUNDING
        over[harmless | (over <= _ROUNDING)] = 0.0
        fines = over
        fines *= _EXCESS
        fines += _MISSED * self._missed()
        units = lattice.heights * lattice.steps
        outside = (units < self._steps.allowed[0]) | (units > self._steps.allowed[-1])
        fines += _OUTSIDE * (outside[:, None] & ~((self._start == 0) & (self._steps.first > 0)))
        for stretch in self._settings.ranges:
            if stretch.layer_height:
                fines += _UNFORCED * (self._in(stretch) & ~self._has(stretch.layer_height))
        return fines

    def _tolerances(self) -> Float:
        """(R, n + 1) the tolerance of every layer."""
        if not any(stretch.tolerance for stretch in self._settings.ranges):
            return np.broadcast_to(np.float64(self._profile.quality.tolerance), self._start.shape)
        bottom, top = np.broadcast_arrays(self._start, self._end)
        unit = self._arcs.lattice.unit
        return tolerances(self._profile, bottom * unit, top * unit)

    def _ends(self, stretch: HeightRange) -> tuple[int, int]:
        """The nodes at which a range begins and ends."""
        return round(stretch.low / self._arcs.lattice.unit), round(stretch.high / self._arcs.lattice.unit)

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
