"""A genetic algorithm that searches for the plan with the fewest layers.

Source: Xu et al. optimize layer heights within a cusp height with a genetic algorithm. Here a plan is a row of layer
heights in z steps. The first population consists of random walks from the bed up. In each generation parents are
chosen by tournament. A child has the lower layers of one parent and the upper layers of the other, joined by one more
layer if their tops differ. Then random layer tops are shifted, and random layers are divided among their neighbours.
The best of parents and children survive. Fewer layers are better; a violation of the cusp height by one z step weighs
more than any number of layers. All operations work on the whole population, in arrays (plans, layers).

Guarantee: the plan is within the machine's limits and meets the flats and the top. The cusp height of each facet is
within the limit in every layer thicker than the thinnest, unless no such layers end on the next flat. The same seed
gives the same plan. The plan never has more layers than the best one of the first population, but it need not be the
optimum; the planner exists to compare both. It ignores edges and peaks. Cost: generations * population * layers, by far
the slowest of the planners.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from printer_slicer.arrays import Bool, Int
from printer_slicer.model import LayerPlan, Mesh
from printer_slicer.planning.reachable_heights import (
    find_event_planes,
    find_next_planes,
    find_reachable_layers,
)
from printer_slicer.planning.slopes import Slopes, cusp_height, find_thickest_layers
from printer_slicer.planning.z_steps import ZSteps
from printer_slicer.profile import GeneticPlanner, Profile

__all__ = ["plan_genetic"]

_MUTATED_FRACTION: Final = 0.15  # fraction of a child's layers that are selected for mutation


class _Rules(NamedTuple):
    """Limits for the layers of a part.

    Attributes:
        bottom: bottom of the lowest layer that may be chosen, z steps.
        limit: (part + 1,) maximum layer height at each z step, in steps.
        reachable: (part + 1,) at each z step a layer height from whose top the next event plane can be met; 0: none.
        plane: (part + 1,) the next event plane above each z step.
        allowed: (n,) allowed heights, in steps, ascending.
        listed: (highest * 2 + 1,) whether a height in steps is allowed.
    """

    bottom: int
    limit: Int
    reachable: Int
    plane: Int
    allowed: Int
    listed: Bool

    @property
    def part(self) -> int:
        """Height of the part in z steps."""
        return len(self.limit) - 1

    def can_fill(self, height: Int, bottom: Int, top: Int) -> Bool:
        """Return whether a layer of this height is allowed on z step `bottom`, with no event plane below its `top`."""
        at = np.clip(bottom, 0, self.part)
        size = np.clip(height, 0, len(self.listed) - 1)
        listed = self.listed[size] & (size == height)
        return np.asarray(listed & (height <= self.limit[at]) & (top <= self.plane[at]))


def plan_genetic(mesh: Mesh, profile: Profile) -> LayerPlan:
    """Plan as few layers as possible with a genetic algorithm.

    Args:
        mesh: the part, standing on z = 0.
        profile: `quality.planner` has seed, population and generations; `quality.tolerance` the allowed deviation.

    Raises:
        PlanError: the part is thinner than the thinnest layer.
    """
    settings = profile.quality.planner
    if not isinstance(settings, GeneticPlanner):
        settings = GeneticPlanner()
    steps = ZSteps(mesh, profile)
    first, rest = steps.split_first_layer()
    heights = np.array([first] if first else [], np.int64)
    if rest:
        best = _evolve(_compute_rules(mesh, steps, cusp_height(profile), first), settings)
        heights = np.append(heights, best[best > 0])
    return steps.make_plan(heights, "genetic")


def _compute_rules(mesh: Mesh, steps: ZSteps, cusp: float, bottom: int) -> _Rules:
    """Compute the limits for the layers of a part."""
    limit = find_thickest_layers(Slopes(mesh, steps), steps, lambda slope: cusp / np.maximum(slope, 1e-12))
    planes = find_event_planes(mesh, steps, bottom)
    reachable = find_reachable_layers(limit, planes, bottom, steps)
    listed = np.zeros(2 * steps.highest + 1, np.bool_)
    listed[steps.allowed] = True
    above, nothing = steps.allowed[:1], np.zeros(1, np.int64)
    return _Rules(
        bottom,
        np.append(limit, above),
        np.append(reachable, nothing),
        find_next_planes(planes, steps),
        steps.allowed,
        listed,
    )


def _evolve(rules: _Rules, settings: GeneticPlanner) -> Int:
    """Run the algorithm; return the layer heights (n,) of the best plan."""
    rng = np.random.default_rng(settings.seed)
    alive = _build_first_population(rules, settings.population, rng)
    alive = alive[np.argsort(_compute_costs(alive, rules), kind="stable")]
    for _ in range(settings.generations):
        parents = rng.integers(settings.population, size=(2, 2, settings.population)).min(axis=0)
        children = _cross_over(alive[parents[0]], alive[parents[1]], rules, rng)
        children = _remove_layers(_shift_tops(children, rules, rng), rules, rng)
        candidates = np.concatenate([alive, children])
        best = np.argsort(_compute_costs(candidates, rules), kind="stable")[: settings.population]
        alive = candidates[best]
        alive = alive[:, : int((alive > 0).sum(axis=1).max())]
    return np.asarray(alive[0])


def _build_first_population(rules: _Rules, size: int, rng: np.random.Generator) -> Int:
    """Build random plans (size, layers) from the bottom up, within the limits; heights after the last layer are 0."""
    part = rules.part
    choices = np.searchsorted(rules.allowed, rules.limit, side="right")
    here = np.full(size, rules.bottom, np.int64)
    columns: list[Int] = []
    while (here < part).any():
        at = np.minimum(here, part)
        height = rules.allowed[(rng.random(size) * choices[at]).astype(np.int64)]
        top = here + height
        leads_on = (top <= rules.plane[at]) & (
            (rules.reachable[np.minimum(top, part)] > 0) | (top == rules.plane[at])
        )
        height = np.where(here < part, np.where(leads_on, height, rules.reachable[at]), 0)
        columns.append(height)
        here = here + height
    return np.stack(columns, axis=1)


def _compute_costs(plans: Int, rules: _Rules) -> Int:
    """Return the cost (plans,): the number of layers, plus a larger penalty for each z step above the limit."""
    here = np.minimum(_layer_bottoms(plans, rules), rules.part)
    over = np.maximum(plans - rules.limit[here], 0).sum(axis=1)
    return np.asarray((plans > 0).sum(axis=1) + over * (plans.shape[1] + 1))


def _layer_tops(plans: Int, rules: _Rules) -> Int:
    """Return the top of each layer in z steps (plans, layers); entries after the last layer hold the plan's top."""
    return np.asarray(np.cumsum(plans, axis=1) + rules.bottom)


def _layer_bottoms(plans: Int, rules: _Rules) -> Int:
    """Return the bottom of each layer in z steps (plans, layers); entries after the last layer hold the plan's top."""
    return _layer_tops(plans, rules) - plans


def _cross_over(lower: Int, upper: Int, rules: _Rules, rng: np.random.Generator) -> Int:
    """Cross parents: children have the layers of `lower` up to a random height, and those of `upper` above it.

    If the parents cannot be joined, the child is the lower parent.
    """
    count, width = len(lower), lower.shape[1]
    rows, columns = np.arange(count), np.arange(width)
    seam = rng.integers(rules.bottom, rules.part, size=count)
    tops = _layer_tops(lower, rules)
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
    # A child with too many layers for the array has lost its top layers.
    joined &= rules.bottom + child.sum(axis=1) >= rules.part
    return np.where(joined[:, None], child, lower)


def _find_joint(here: Int, upper: Int, rules: _Rules) -> tuple[Int, Int, Bool]:
    """Find the layer that joins plans that end at z step `here` (n,) to the layers of `upper`.

    Returns:
        (n,) the height of the joining layer, 0 if `upper` has a top there; (n,) the index of the first layer of `upper`
        above it; (n,) whether they can be joined, by a layer to the next top of `upper` or to the one after that.
    """
    rows, last = np.arange(len(upper)), upper.shape[1] - 1
    tops = _layer_tops(upper, rules)
    met = (tops == here[:, None]).any(axis=1) | (here == rules.bottom)
    over = (tops <= here[:, None]).sum(axis=1)
    near, far = np.minimum(over, last), np.minimum(over + 1, last)
    short, long = tops[rows, near] - here, tops[rows, far] - here
    fits_short, fits_long = (rules.can_fill(gap, here, here + gap) for gap in (short, long))
    between = np.where(met, 0, np.where(fits_long, long, short))
    rest = np.where(met, over, np.where(fits_long, far, near) + 1)
    return between, rest, np.asarray(met | fits_short | fits_long)


def _shift_tops(plans: Int, rules: _Rules, rng: np.random.Generator) -> Int:
    """Shift some layer tops up or down."""
    unit, span = _common_divisor(rules), int(rules.allowed[-1] - rules.allowed[0])
    farthest = max(span // (8 * unit), 1)
    marked = _pick_layers(plans, rng)[:, :-1]
    by = unit * rng.integers(-farthest, farthest + 1, size=marked.shape) * marked
    below, above = plans[:, :-1] + by, plans[:, 1:] - by
    here = _layer_bottoms(plans, rules)[:, :-1]
    top = here + below
    fits = rules.can_fill(below, here, top) & rules.can_fill(above, top, top + above)
    # A top on an event plane must not move.
    fits &= (plans[:, 1:] > 0) & (top - by < rules.plane[np.minimum(here, rules.part)])
    by = np.where(fits, by, 0)
    changed = plans.copy()
    changed[:, :-1] += by
    changed[:, 1:] -= by
    return changed


def _remove_layers(plans: Int, rules: _Rules, rng: np.random.Generator) -> Int:
    """Remove some layers by dividing their height among their neighbours."""
    if plans.shape[1] < 3:
        return plans
    unit = _common_divisor(rules)
    marked = _pick_layers(plans, rng)[:, 1:-1]
    gone, before, after = plans[:, 1:-1], plans[:, :-2], plans[:, 2:]
    bottoms = _layer_bottoms(plans, rules)
    here, place, top = bottoms[:, :-2], bottoms[:, 1:-1], bottoms[:, 2:]
    down = np.minimum(unit * np.floor(rng.random(gone.shape) * (gone // unit + 1)).astype(np.int64), gone)
    # A layer beside an event plane goes wholly to the neighbour on the same side of the plane.
    down = np.where(place == rules.plane[np.minimum(here, rules.part)], 0, down)
    down = np.where(top == rules.plane[np.minimum(place, rules.part)], gone, down)
    up = gone - down
    fits = (down == 0) | rules.can_fill(before + down, here, place + down)
    fits &= (up == 0) | rules.can_fill(after + up, place + down, top + after)
    taken = marked & fits & (gone > 0)
    changed = plans.copy()
    changed[:, :-2] += down * taken
    changed[:, 2:] += up * taken
    changed[:, 1:-1] -= gone * taken
    order = np.argsort(changed == 0, axis=1, kind="stable")
    return np.take_along_axis(changed, order, axis=1)


def _common_divisor(rules: _Rules) -> int:
    """Return the greatest common divisor of the allowed heights, in z steps."""
    return int(np.gcd.reduce(rules.allowed))


def _pick_layers(plans: Int, rng: np.random.Generator) -> Bool:
    """Select random layers (plans, layers), at least four apart."""
    marked = rng.random(plans.shape) < _MUTATED_FRACTION
    for apart in (1, 2, 3):
        marked[:, apart:] &= ~marked[:, :-apart]
    return marked
