"""Random search for few layers: a population of plans that breed, change and are selected.

Source: Xu et al. search for layer thicknesses under a cusp height with a genetic algorithm. Here a plan is a row of
layer heights in z steps. The first population is made of random walks from the bed up. In each generation parents are
chosen by tournament; a child has the lower layers of one and the upper layers of the other, with one layer more where
their tops do not meet; then random layer tops are shifted, and random layers are given to their neighbours. The best
of parents and children live on. The fewest layers are best, and one z step over the cusp height weighs more than any
number of layers. All is done for the whole population at once, on arrays (plans, layers).

Guarantee: a plan within the machine's limits that meets the flats and the top, in which each facet's cusp height is
within the limit in every layer that is thicker than the thinnest, unless no such layers end on the next flat; the same
plan for the same seed; never more layers than the best of the first population. The number of layers is not the least:
how far it is from it is what this planner is for. It does not see edges and peaks. Cost: generations * population *
layers; linear in all three, and by far the dearest of the planners.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from printer_slicer.arrays import Bool, Int
from printer_slicer.model import LayerPlan, Mesh
from printer_slicer.planning.reachable_heights import event_planes, next_plane, reachable_layers
from printer_slicer.planning.slopes import Slopes, cusp_height, thickest_within
from printer_slicer.planning.z_steps import ZSteps
from printer_slicer.profile import GeneticPlanner, Profile

__all__ = ["plan_genetic"]

_MARKED: Final = 0.15  # share of the layers of a child that are tried to be changed


class _Rules(NamedTuple):
    """What a layer may be.

    Attributes:
        bottom: z step on which the lowest free layer stands.
        limit: (part + 1,) the thickest layer on each z step, in steps.
        ways: (part + 1,) a height on each z step from which the next event plane can be met; 0: none.
        plane: (part + 1,) the next event plane over each z step.
        allowed: (n,) heights that may be chosen, in steps, ascending.
        listed: (highest * 2 + 1,) whether a height in steps is allowed.
    """

    bottom: int
    limit: Int
    ways: Int
    plane: Int
    allowed: Int
    listed: Bool

    @property
    def part(self) -> int:
        """The top of the part in z steps."""
        return len(self.limit) - 1

    def may_be(self, height: Int, here: Int, top: Int) -> Bool:
        """Whether layers of this height, in the list and within the limit, may stand on `here` and end on `top`."""
        at = np.clip(here, 0, self.part)
        size = np.clip(height, 0, len(self.listed) - 1)
        listed = self.listed[size] & (size == height)
        return np.asarray(listed & (height <= self.limit[at]) & (top <= self.plane[at]))


def plan_genetic(mesh: Mesh, profile: Profile) -> LayerPlan:
    """The plan with the fewest layers that `generations` of `population` plans have found.

    Args:
        mesh: the part, standing on z = 0.
        profile: `quality.planner` holds seed, population and generations; `quality.tolerance` the error allowed.

    Raises:
        PlanError: the part is thinner than the thinnest layer.
    """
    settings = profile.quality.planner
    if not isinstance(settings, GeneticPlanner):
        settings = GeneticPlanner()
    steps = ZSteps(mesh, profile)
    first, rest = steps.begin()
    heights = np.array([first] if first else [], np.int64)
    if rest:
        best = _evolve(_rules(mesh, steps, cusp_height(profile), first), settings)
        heights = np.append(heights, best[best > 0])
    return steps.plan(heights, "genetic")


def _rules(mesh: Mesh, steps: ZSteps, cusp: float, bottom: int) -> _Rules:
    """The tables that say which layers a part permits."""
    limit = thickest_within(Slopes(mesh, steps), steps, lambda slope: cusp / np.maximum(slope, 1e-12))
    planes = event_planes(mesh, steps, bottom)
    ways = reachable_layers(limit, planes, bottom, steps)
    listed = np.zeros(2 * steps.highest + 1, np.bool_)
    listed[steps.allowed] = True
    above, nothing = steps.allowed[:1], np.zeros(1, np.int64)
    return _Rules(
        bottom,
        np.append(limit, above),
        np.append(ways, nothing),
        next_plane(planes, steps),
        steps.allowed,
        listed,
    )


def _evolve(rules: _Rules, settings: GeneticPlanner) -> Int:
    """The heights (n,) of the best plan of the last generation."""
    chance = np.random.default_rng(settings.seed)
    alive = _first_population(rules, settings.population, chance)
    alive = alive[np.argsort(_cost(alive, rules), kind="stable")]
    for _ in range(settings.generations):
        parents = chance.integers(settings.population, size=(2, 2, settings.population)).min(axis=0)
        children = _cross_over(alive[parents[0]], alive[parents[1]], rules, chance)
        children = _remove_layers(_shift_tops(children, rules, chance), rules, chance)
        everyone = np.concatenate([alive, children])
        best = np.argsort(_cost(everyone, rules), kind="stable")[: settings.population]
        alive = everyone[best]
        alive = alive[:, : int((alive > 0).sum(axis=1).max())]
    return np.asarray(alive[0])


def _first_population(rules: _Rules, size: int, chance: np.random.Generator) -> Int:
    """Random walks (size, layers) from the bottom up, each height within the limit; 0 after the last layer."""
    part = rules.part
    choices = np.searchsorted(rules.allowed, rules.limit, side="right")
    here = np.full(size, rules.bottom, np.int64)
    columns: list[Int] = []
    while (here < part).any():
        at = np.minimum(here, part)
        height = rules.allowed[(chance.random(size) * choices[at]).astype(np.int64)]
        top = here + height
        leads_on = (top <= rules.plane[at]) & (
            (rules.ways[np.minimum(top, part)] > 0) | (top == rules.plane[at])
        )
        height = np.where(here < part, np.where(leads_on, height, rules.ways[at]), 0)
        columns.append(height)
        here = here + height
    return np.stack(columns, axis=1)


def _cost(plans: Int, rules: _Rules) -> Int:
    """Number of layers (plans,), each z step over the limit counted as more than there are layers."""
    here = np.minimum(_bottoms(plans, rules), rules.part)
    over = np.maximum(plans - rules.limit[here], 0).sum(axis=1)
    return np.asarray((plans > 0).sum(axis=1) + over * (plans.shape[1] + 1))


def _tops(plans: Int, rules: _Rules) -> Int:
    """(plans, layers) the z step on which each layer ends; the top of the plan after the last one."""
    return np.asarray(np.cumsum(plans, axis=1) + rules.bottom)


def _bottoms(plans: Int, rules: _Rules) -> Int:
    """(plans, layers) the z step on which each layer stands; the top of the plan after the last one."""
    return _tops(plans, rules) - plans


def _cross_over(lower: Int, upper: Int, rules: _Rules, chance: np.random.Generator) -> Int:
    """Children with the layers of `lower` up to a random height and those of `upper` above it.

    A child whose parents cannot be joined is its lower parent.
    """
    count, width = len(lower), lower.shape[1]
    rows, columns = np.arange(count), np.arange(width)
    seam = chance.integers(rules.bottom, rules.part, size=count)
    tops = _tops(lower, rules)
    kept = (tops <= seam[:, None]).sum(axis=1)
    here = np.where(kept > 0, tops[rows, kept - 1], rules.bottom)
    between, rest, joined = _find_joint(here, upper, rules)
    child = np.where(columns < kept[:, None], lower, 0)
    child[rows, kept] = between
    # Column k of a child above the joint is column k + shift of its upper parent.
    shift = rest - kept - (between > 0)
    source = columns + shift[:, None]
    above = (source >= rest[:, None]) & (source < width)
    child = np.where(above, np.take_along_axis(upper, np.clip(source, 0, width - 1), axis=1), child)
    # One with more layers than there is room for has lost the uppermost ones.
    joined &= rules.bottom + child.sum(axis=1) >= rules.part
    return np.where(joined[:, None], child, lower)


def _find_joint(here: Int, upper: Int, rules: _Rules) -> tuple[Int, Int, Bool]:
    """What joins plans that end at z step `here` (n,) to the layers of `upper`.

    Returns:
        The layer in between (n,), 0 where a top of `upper` is met; the first layer of `upper` over it (n,); whether
        they can be joined at all (n,): by a layer up to the next top of `upper`, or to the one after it.
    """
    rows, last = np.arange(len(upper)), upper.shape[1] - 1
    tops = _tops(upper, rules)
    met = (tops == here[:, None]).any(axis=1) | (here == rules.bottom)
    over = (tops <= here[:, None]).sum(axis=1)
    near, far = np.minimum(over, last), np.minimum(over + 1, last)
    short, long = tops[rows, near] - here, tops[rows, far] - here
    fits_short, fits_long = (rules.may_be(gap, here, here + gap) for gap in (short, long))
    between = np.where(met, 0, np.where(fits_long, long, short))
    rest = np.where(met, over, np.where(fits_long, far, near) + 1)
    return between, rest, np.asarray(met | fits_short | fits_long)


def _shift_tops(plans: Int, rules: _Rules, chance: np.random.Generator) -> Int:
    """The same plans with some layer tops a little higher or lower."""
    unit, span = _unit(rules), int(rules.allowed[-1] - rules.allowed[0])
    farthest = max(span // (8 * unit), 1)
    marked = _pick_layers(plans, chance)[:, :-1]
    by = unit * chance.integers(-farthest, farthest + 1, size=marked.shape) * marked
    below, above = plans[:, :-1] + by, plans[:, 1:] - by
    here = _bottoms(plans, rules)[:, :-1]
    top = here + below
    fits = rules.may_be(below, here, top) & rules.may_be(above, top, top + above)
    # An event plane between the two must stay.
    fits &= (plans[:, 1:] > 0) & (top - by < rules.plane[np.minimum(here, rules.part)])
    by = np.where(fits, by, 0)
    changed = plans.copy()
    changed[:, :-1] += by
    changed[:, 1:] -= by
    return changed


def _remove_layers(plans: Int, rules: _Rules, chance: np.random.Generator) -> Int:
    """The same plans without some layers whose height their neighbours can take."""
    if plans.shape[1] < 3:
        return plans
    unit = _unit(rules)
    marked = _pick_layers(plans, chance)[:, 1:-1]
    gone, before, after = plans[:, 1:-1], plans[:, :-2], plans[:, 2:]
    bottoms = _bottoms(plans, rules)
    here, place, top = bottoms[:, :-2], bottoms[:, 1:-1], bottoms[:, 2:]
    down = np.minimum(unit * np.floor(chance.random(gone.shape) * (gone // unit + 1)).astype(np.int64), gone)
    # On an event plane a layer goes wholly to the neighbour on its side of the plane.
    down = np.where(place == rules.plane[np.minimum(here, rules.part)], 0, down)
    down = np.where(top == rules.plane[np.minimum(place, rules.part)], gone, down)
    up = gone - down
    fits = (down == 0) | rules.may_be(before + down, here, place + down)
    fits &= (up == 0) | rules.may_be(after + up, place + down, top + after)
    taken = marked & fits & (gone > 0)
    changed = plans.copy()
    changed[:, :-2] += down * taken
    changed[:, 2:] += up * taken
    changed[:, 1:-1] -= gone * taken
    order = np.argsort(changed == 0, axis=1, kind="stable")
    return np.take_along_axis(changed, order, axis=1)


def _unit(rules: _Rules) -> int:
    """All allowed heights are multiples of this many z steps."""
    return int(np.gcd.reduce(rules.allowed))


def _pick_layers(plans: Int, chance: np.random.Generator) -> Bool:
    """Random layers (plans, layers), no two of them within three of each other."""
    marked = chance.random(plans.shape) < _MARKED
    for apart in (1, 2, 3):
        marked[:, apart:] &= ~marked[:, :-apart]
    return marked
