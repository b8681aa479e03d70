"""The cheapest chain of layers against every chain there is: in tables of any costs, and of parts."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from itertools import pairwise
from typing import Any, Final, NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from printer_slicer.arrays import Float, Int
from printer_slicer.kernel import VARIABLE, load_kernel
from printer_slicer.model import Mesh
from printer_slicer.planning import plan_layers
from printer_slicer.planning.candidate_layers import CandidateLayers
from printer_slicer.planning.height_grid import HeightGrid
from printer_slicer.planning.z_steps import ZSteps
from printer_slicer.profile import OptimalPlanner, Profile
from printer_slicer.shortest_path import (
    ArcGraph,
    NeighbourLimits,
    _compute_neighbour_costs,
    cheapest_path,
    cheapest_with_max_layers,
    cheapest_with_neighbours,
    cheapest_within_budget,
)
from printer_slicer.surface import certify, find_flats, read_surface
from tests.effort import crossed, examples, few_of
from tests.kernels import needs_kernel
from tests.parts import profile, pyramid, sheared_prism, sphere, step_pyramid
from tests.planning.plans import frusta

OBJECTIVES = ("balanced", "time", "layers", "volume")
ERROR_PRICE = 20.0  # s/mm³
LAYER_WORTH = 1e-4  # mm³ that a layer must gain where the volume error alone counts
ROUNDING = 1e-9


class Table(NamedTuple):
    """What a search is asked: cost of every layer by its end, and the heights of its rows."""

    cost: Float
    heights: Int

    @property
    def n(self) -> int:
        return int(self.cost.shape[1]) - 1

    def arcs(self) -> tuple[ArcGraph, Float]:
        """The layers that lie over the bed, as arcs, and their costs."""
        end, row = np.nonzero(np.arange(self.n + 1)[:, None] >= self.heights)
        begin = np.append(0, np.cumsum(np.bincount(end, minlength=self.n + 1)))
        return ArcGraph(begin, end - self.heights[row]), self.cost[row, end]

    def found(self, search: Callable[..., Int | None], *more: Any) -> Int | None:
        """The heights of the layers that a search finds."""
        graph, cost = self.arcs()
        layers = search(graph, cost, *more)
        return None if layers is None else graph.height[layers]


def by_step(graph: ArcGraph, cost: Float, change: int, fine: float) -> Int | None:
    """The cheapest plan where neighbours that differ by more than `change` cost a fine."""
    highest = int(graph.height.max(initial=0))
    return cheapest_with_neighbours(graph, cost, NeighbourLimits.by_step(change, highest, graph.n), fine)


def all_plans(n: int, heights: tuple[int, ...]) -> Iterator[tuple[int, ...]]:
    """Every row of heights that adds up to n."""
    if n == 0:
        yield ()
    for height in heights:
        if height <= n:
            yield from ((*rest, height) for rest in all_plans(n - height, heights))


def price(plan: tuple[int, ...] | Int, table: Table, change: int | None = None, fine: float = 0.0) -> float:
    """The cost of a plan, with the fines for neighbours that differ by more than `change`."""
    rows = np.searchsorted(table.heights, plan)
    total = float(table.cost[rows, np.cumsum(plan).astype(np.int64)].sum())
    uneven = 0 if change is None else int((np.abs(np.diff(plan)) > change).sum())
    return total + fine * uneven if uneven else total


def least(table: Table, change: int | None = None, fine: float = 0.0, most: int | None = None) -> float:
    """The least price of all plans, infinite where there is none."""
    heights = tuple(table.heights.tolist())
    prices = [
        price(plan, table, change, fine)
        for plan in all_plans(table.n, heights)
        if most is None or len(plan) <= most
    ]
    return min(prices, default=np.inf)


@st.composite
def tables(draw: st.DrawFn, *, gaps: bool = False) -> Table:
    """Small tables: few whole costs make ties, infinite ones close ways, some close them all."""
    lowest = draw(st.integers(1, 4))
    heights = np.arange(lowest, lowest + draw(st.integers(1, 4)))
    if gaps:
        heights = np.unique(draw(st.lists(st.integers(1, 9), min_size=1, max_size=4)))
    n = draw(st.integers(1, 13))
    rng = np.random.default_rng(draw(st.integers(0, 10**6)))
    kind = draw(st.sampled_from(["ties", "any", "huge and tiny"]))
    cost = {
        "ties": lambda: rng.integers(0, 3, (len(heights), n + 1)).astype(np.float64),
        "any": lambda: rng.random((len(heights), n + 1)),
        "huge and tiny": lambda: 10.0 ** rng.uniform(-6, 6, (len(heights), n + 1)),
    }[kind]()
    cost[rng.random(cost.shape) < draw(st.sampled_from([0.0, 0.2, 0.5, 1.0]))] = np.inf
    return Table(cost, heights)


def is_a_plan(plan: Int, table: Table) -> bool:
    return int(plan.sum()) == table.n and bool(np.isin(plan, table.heights).all())


@settings(max_examples=examples(40))  # tables are small, and so is the search
@given(tables(gaps=True))
def test_the_cheapest_plan_costs_as_little_as_the_best_of_all(table: Table) -> None:
    plan, best = table.found(cheapest_path), least(table)

    assert (plan is None) == np.isinf(best)
    if plan is not None:
        assert is_a_plan(plan, table)
        assert price(plan, table) == pytest.approx(best, rel=ROUNDING)


@settings(max_examples=examples(40))  # tables are small, and so is the search
@given(tables(), st.integers(0, 5), st.sampled_from([0.0, 0.5, 1.0, 1e6]))
def test_the_cheapest_even_plan_pays_for_uneven_neighbours_and_no_more(
    table: Table, change: int, fine: float
) -> None:
    plan = table.found(by_step, change, fine)
    best = least(table, change, fine)

    assert (plan is None) == np.isinf(best)
    if plan is not None:
        assert is_a_plan(plan, table)
        assert price(plan, table, change, fine) == pytest.approx(best, rel=ROUNDING)


@settings(max_examples=examples(40))  # tables are small, and so is the search
@given(tables(), st.integers(0, 4), st.integers(0, 10**6), st.sampled_from([0.0, 0.7, 3.0]))
def test_beside_some_nodes_uneven_neighbours_cost_less(
    table: Table, change: int, seed: int, lesser: float
) -> None:
    graph, cost = table.arcs()
    spared, fine = np.random.default_rng(seed).random(graph.n + 1) < 0.2, 50.0
    height = np.arange(int(graph.height.max(initial=0)) + 1)
    even = NeighbourLimits(height - change, height + change, spared)

    def paid(plan: tuple[int, ...]) -> float:
        ends = np.cumsum([0, *plan])
        beside = spared[ends[:-2]] | spared[ends[1:-1]] | spared[ends[2:]]
        uneven = np.abs(np.diff(plan)) > change
        return price(np.array(plan), table) + float(np.where(beside, lesser, fine)[uneven].sum())

    layers = cheapest_with_neighbours(graph, cost, even, fine, lesser)
    best = min(map(paid, all_plans(table.n, tuple(table.heights.tolist()))), default=np.inf)

    assert (layers is None) == np.isinf(best)
    if layers is not None:
        assert paid(tuple(graph.height[layers].tolist())) == pytest.approx(best, rel=ROUNDING)


@needs_kernel
@settings(max_examples=examples(40))
@given(tables(gaps=True), st.integers(0, 6), st.integers(0, 2**32 - 1))
def test_the_kernel_finds_the_costs_that_the_python_code_finds(table: Table, change: int, seed: int) -> None:
    graph, cost = table.arcs()
    if not len(graph.start):
        return
    rng, height = np.random.default_rng(seed), np.arange(int(graph.height.max()) + 1)
    limits = NeighbourLimits(
        height - rng.integers(0, change + 1, len(height)), height + change, rng.random(graph.n + 1) < 0.2
    )
    found = []
    for kernel in ("required", "off"):
        with pytest.MonkeyPatch.context() as patched:
            patched.setenv(VARIABLE, kernel)
            found.append(_compute_neighbour_costs(graph, cost, limits, 50.0, 7.0))

    for with_kernel, without in zip(*found, strict=True):
        assert with_kernel.tobytes() == without.tobytes()


@needs_kernel
def test_the_kernel_rejects_graphs_that_do_not_match(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, "required")
    kernel = load_kernel()
    assert kernel

    def search(*, begin: list[int], start: list[int], first: int = 0, last: int = 0, low: int = 1) -> None:
        arcs = np.array(begin).data, np.array(start, np.int64).data, np.ones(len(start)).data
        rows = np.array([first]).data, np.array([last]).data
        kernel.neighbour_paths(arcs, (*rows, np.zeros(3, np.int64).data), low, 1.0, 0.0)

    search(begin=[0, 0, 1, 2], start=[0, 1])
    for wrong in (
        {"begin": [0, 0, 2, 1], "start": [0]},
        {"begin": [0, 0, 1, 2], "start": [0]},
        {"begin": [0, 0, 1], "start": [0]},
        {"begin": [0, 0, 1, 2], "start": [0, 0]},
        {"begin": [0, 0, 1, 2], "start": [0, -1]},
        {"begin": [0, 0, 1, 2], "start": [0, 1], "low": 2},
        {"begin": [0, 0, 1, 2], "start": [0, 1], "first": 1},
    ):
        with pytest.raises(ValueError, match=r"arc|array|window"):
            search(**wrong)


@settings(max_examples=examples(40))  # tables are small, and so is the search
@given(tables(gaps=True), st.integers(1, 15))
def test_the_cheapest_plan_of_few_layers_is_the_best_of_those_with_so_few(table: Table, most: int) -> None:
    plan, best = table.found(cheapest_with_max_layers, most), least(table, most=most)

    assert (plan is None) == np.isinf(best)
    if plan is not None:
        assert is_a_plan(plan, table)
        assert len(plan) <= most
        assert price(plan, table) == pytest.approx(best, rel=ROUNDING)


@settings(max_examples=examples(40))  # tables are small, and so is the search
@given(tables(gaps=True), st.integers(0, 10**6), st.floats(0, 1))
def test_within_a_budget_no_plan_is_better_at_the_price_that_is_found(
    table: Table, seed: int, share: float
) -> None:
    """And at that price a plan beyond the budget costs no less: a lower price would not keep it."""
    rng = np.random.default_rng(seed)
    use = Table(rng.integers(1, 9, table.cost.shape).astype(np.float64), table.heights)
    plans = [
        plan for plan in all_plans(table.n, tuple(table.heights.tolist())) if price(plan, table) < np.inf
    ]
    if not plans:
        return
    uses = [price(plan, use) for plan in plans]
    budget = min(uses) + share * (max(uses) - min(uses))
    graph, loss = table.arcs()
    spent = use.arcs()[1]
    thrifty = cheapest_path(graph, np.where(np.isfinite(loss), spent, np.inf))
    assert thrifty is not None
    layers, worth = cheapest_within_budget(
        lambda cost: cheapest_path(graph, cost), loss, spent, budget, thrifty
    )

    costs = [price(plan, table) + worth * used for plan, used in zip(plans, uses, strict=True)]
    assert spent[layers].sum() <= budget
    assert loss[layers].sum() + worth * spent[layers].sum() == pytest.approx(min(costs), rel=ROUNDING)
    if worth:
        beyond = [cost for cost, used in zip(costs, uses, strict=True) if used > budget]
        assert min(beyond) == pytest.approx(min(costs), rel=1e-6)


@given(tables())
def test_without_a_fine_or_with_layers_enough_all_three_cost_the_same(table: Table) -> None:
    found = (
        table.found(cheapest_path),
        table.found(by_step, 0, 0.0),
        table.found(by_step, len(table.heights), 1e9),
        table.found(cheapest_with_max_layers, table.n),
    )
    prices = [np.inf if plan is None else price(plan, table) for plan in found]

    assert prices == pytest.approx([prices[0]] * 4, rel=ROUNDING)


def test_ties_are_broken_the_same_way_every_time() -> None:
    cost, heights = np.zeros((3, 31)), np.arange(2, 5)
    searches: list[Callable[[], Int | None]] = [
        lambda: Table(cost, heights).found(cheapest_path),
        lambda: Table(cost, heights).found(by_step, 1, 5.0),
        lambda: Table(cost, heights).found(cheapest_with_max_layers, 12),
    ]
    for search in searches:
        first, second = search(), search()
        assert first is not None
        assert second is not None
        assert first.tolist() == second.tolist()


def test_of_two_plans_that_cost_the_same_any_number_of_layers_up_to_the_most_will_do() -> None:
    plan = Table(np.zeros((2, 13)), np.arange(2, 4)).found(cheapest_with_max_layers, 5)

    assert plan is not None
    assert len(plan) <= 5
    assert plan.sum() == 12


@pytest.mark.parametrize("n", [1, 4, 5])
def test_a_height_that_no_layers_add_up_to_is_not_reached(n: int) -> None:
    """Layers of 3 only; 1, 4 and 5 are no multiples of it."""
    cost, heights = np.ones((1, n + 1)), np.array([3])

    assert Table(cost, heights).found(cheapest_path) is None
    assert Table(cost, heights).found(by_step, 1, 1.0) is None
    assert Table(cost, heights).found(cheapest_with_max_layers, 9) is None


def test_too_few_layers_do_not_reach_the_top() -> None:
    cost, heights = np.ones((2, 21)), np.array([2, 3])

    assert Table(cost, heights).found(cheapest_with_max_layers, 6) is None
    plan = Table(cost, heights).found(cheapest_with_max_layers, 7)
    assert plan is not None
    assert len(plan) == 7
    assert Table(cost, heights).found(cheapest_with_max_layers, 0) is None


def test_an_uneven_pair_is_taken_only_where_it_is_worth_its_fine() -> None:
    """Heights 1 to 3; the only cheap plan is 3, 1, 3, which has two uneven pairs."""
    cost = np.full((3, 8), 10.0)
    cost[2, 3] = cost[0, 4] = cost[2, 7] = 1.0

    for fine, expected in ((1.0, [3, 1, 3]), (1e3, None)):
        plan = Table(cost, np.arange(1, 4)).found(by_step, 1, fine)
        assert plan is not None
        if expected:
            assert plan.tolist() == expected
        else:
            assert np.abs(np.diff(plan)).max() <= 1


def test_costs_of_any_size_keep_their_differences() -> None:
    """A fine of 1e10 in every layer does not hide what one layer costs more than another."""
    rng = np.random.default_rng(4)
    fair = rng.random((3, 61))
    heights = np.arange(4, 7)
    plain, fined = (Table(costs, heights).found(cheapest_path) for costs in (fair, fair + 1e10))

    assert plain is not None
    assert fined is not None
    fewest = [plan for plan in all_plans(60, (4, 5, 6)) if len(plan) == len(fined)]
    best = min(price(plan, Table(fair, heights)) for plan in fewest)
    assert len(fined) == 10
    assert price(fined, Table(fair, heights)) == pytest.approx(best, abs=1e-4)


# --- the plans of parts: no chain of layers is better by the rules that the planner goes by ---


def optimal(**changes: Any) -> Profile:
    """All heights from 0.08 to 0.32 mm on a grid of 0.01 mm, the first layer free, all neighbours allowed."""
    usual: dict[str, Any] = {"z_step": 0.01, "first_layer_height": 0, "planner__kind": "optimal"}
    if changes.get("planner__kind", "optimal") == "optimal":
        usual |= {"planner__error_price": ERROR_PRICE, "planner__smooth": False}
    return profile(**(usual | changes))


class Layer(NamedTuple):
    """What one layer does."""

    bound: float
    volume: float
    seconds: float


Layers = Mapping[tuple[int, int], Layer]


def every_layer(mesh: Mesh, wanted: Profile) -> Layers:
    """(first step, last step) -> what a layer between them does; bounds and volumes are the certificate's own."""
    steps, surface = ZSteps(mesh, wanted), read_surface(mesh)
    grid = HeightGrid.of(steps)
    arcs = CandidateLayers.for_part(mesh, grid, steps, wanted, everywhere=True)
    begin, end = arcs.graph.start * grid.steps, arcs.graph.end * grid.steps
    seconds = dict(zip(zip(begin.tolist(), end.tolist(), strict=True), arcs.seconds.tolist(), strict=True))
    found: dict[tuple[int, int], Layer] = {}
    for height in range(steps.lowest, steps.highest + 1):
        for phase in range(min(height, steps.part - height + 1)):
            ends = np.arange(phase, steps.part + 1, height)
            tops = np.unique(np.append(ends, steps.part))
            tops = tops[tops > 0]
            certificate = certify(surface, steps.make_plan(np.diff(tops, prepend=0), "all"))
            for i, (low, high) in enumerate(zip([0, *tops[:-1].tolist()], tops.tolist(), strict=True)):
                if (low, high) in seconds and high - low == height:
                    found[low, high] = Layer(
                        float(certificate.bound[i]), float(certificate.volume[i]), seconds[low, high]
                    )
    return found


class Rules:
    """What a plan breaks, in the order in which it counts, and what it costs."""

    def __init__(self, mesh: Mesh, wanted: Profile) -> None:
        self.steps, self.layers, self.wanted = ZSteps(mesh, wanted), every_layer(mesh, wanted), wanted
        self.flats, areas = find_flats(mesh)
        self.weight = 1 + areas / max(areas.sum(initial=0), 1e-9)
        planes = [*read_surface(mesh).contacts.event_heights(), *self.flats, mesh.height]
        self.events = {round(z / self.steps.size) for z in planes} - {0}
        self.allowed = set(self.steps.allowed.tolist())

    def score(self, plan: tuple[int, ...]) -> tuple[float, ...]:
        """List, possible tolerance, flats, tolerance, heights beyond the list's, evenness, objective."""
        quality: Any = self.wanted.quality
        ends = [0, *np.cumsum(plan).tolist()]
        layers = [self.layers[pair] for pair in pairwise(ends)]
        odd = [high - low not in self.allowed for low, high in pairwise(ends)]
        unlisted = sum(
            odd[i] and not {low, high} & self.events for i, (low, high) in enumerate(pairwise(ends))
        )
        beyond = sum(not min(self.allowed) <= high - low <= max(self.allowed) for low, high in pairwise(ends))
        if quality.first_layer_height:
            unlisted -= odd[0] and ends[1] not in self.events
            beyond -= not min(self.allowed) <= plan[0] <= max(self.allowed)
        heights = np.diff(ends) * self.steps.size
        thinnest = min(self.allowed) * self.steps.size / 2  # what the thinnest layers can be wrong by
        possible = 2 * thinnest if quality.tolerance < thinnest else quality.tolerance
        hard, soft = (
            sum(
                height * max(layer.bound - limit - 1e-9, 0.0) ** 2
                for height, layer in zip(heights.tolist(), layers, strict=True)
            )
            for limit in (possible, quality.tolerance)
        )
        change = quality.planner.max_step / self.steps.size
        uneven = int((np.abs(np.diff(plan)) > change + 1e-6).sum()) if change else 0
        cost = sum(
            self._cost([layer]) * (1.1 if strange else 1.0)
            for layer, strange in zip(layers, odd, strict=True)
        )
        return unlisted, round(hard, 9), self._missed(ends), round(soft, 9), beyond, uneven, cost

    def _missed(self, ends: list[int]) -> float:
        off = np.abs(np.array(ends)[:, None] * self.steps.size - self.flats).min(axis=0)
        return float(self.weight[off > self.steps.size / 2 + 1e-6].sum())

    def _cost(self, layers: list[Layer]) -> float:
        seconds, volume = sum(layer.seconds for layer in layers), sum(layer.volume for layer in layers)
        planner = self.wanted.quality.planner
        objective = planner.objective if isinstance(planner, OptimalPlanner) else ""
        return {
            "balanced": seconds + ERROR_PRICE * volume,
            "time": seconds,
            "layers": float(len(layers)),
            "volume": volume + LAYER_WORTH * len(layers),
        }[objective]


def better(one: tuple[float, ...], other: tuple[float, ...]) -> bool:
    """Whether one score comes before another by more than rounding and the planner's own tie-breaks."""
    for mine, theirs in zip(one, other, strict=True):
        if abs(mine - theirs) > 1e-8 + 1e-3 * abs(theirs):
            return mine < theirs
    return False


COARSE: Final[dict[str, Any]] = {"z_step": 0.05, "min_layer": 0.1, "max_layer": 0.3}
TINY: Final[Mapping[str, Mesh]] = {
    "frusta": frusta([10, 8, 9], [0.4, 0.35]),
    "steps": step_pyramid([10, 8, 5], [0.35, 0.2, 0.3]),
    "sphere": sphere(0.4),
    "pyramid": pyramid(6, 0.8),
    "leaning": sheared_prism(5, 0.85, 0.4),
    "waist": frusta([6, 3, 5], [0.3, 0.5]),
}
EXTRAS: Final[Mapping[str, dict[str, Any]]] = {
    "free": {},
    "first layer": {"first_layer_height": 0.2},
    "list": {"layer_heights": (0.1, 0.25)},
    "even": {"planner__max_step": 0.05},
    "fine": {"tolerance": 0.055},
}


@pytest.mark.parametrize(("name", "extra"), crossed(TINY, EXTRAS))
def test_no_plan_at_all_is_better(name: str, extra: str) -> None:
    mesh = TINY[name]
    changes = COARSE | {"tolerance": 0.08} | EXTRAS[extra]
    rules = Rules(mesh, optimal(**changes))
    heights = tuple(range(rules.steps.lowest, rules.steps.highest + 1))
    first = rules.steps.first
    everything = [plan for plan in all_plans(rules.steps.part, heights) if first in (0, plan[0])]
    for objective in OBJECTIVES:
        rules.wanted = optimal(**changes, planner__objective=objective)
        plan = plan_layers(mesh, rules.wanted)
        mine = rules.score(tuple(np.rint(plan.height / rules.steps.size).astype(int).tolist()))
        best = min(everything, key=rules.score)
        assert not better(rules.score(best), mine), (objective, best, plan.runs())


def cheapest_of_all(rules: Rules) -> tuple[float, ...]:
    """The best score there is, node by node; evenness apart."""
    best: dict[int, tuple[tuple[int, ...], tuple[float, ...]]] = {0: ((), (0.0,) * 7)}
    for end in range(1, rules.steps.part + 1):
        ways = [
            (*best[low][0], end - low)
            for low in range(end - rules.steps.highest, end - rules.steps.lowest + 1)
            if low in best and (low, end) in rules.layers
        ]
        if ways:
            scored = {way: rules.score(way) for way in ways}
            chosen = min(scored, key=lambda way: scored[way])
            best[end] = chosen, scored[chosen]
    return best[rules.steps.part][1]


@pytest.mark.parametrize("name", few_of(["frusta", "steps", "sphere"], 1))
def test_on_a_fine_lattice_no_chain_of_layers_is_better(name: str) -> None:
    mesh = TINY[name]
    rules = Rules(mesh, optimal(tolerance=0.06))
    for objective in OBJECTIVES:
        rules.wanted = optimal(tolerance=0.06, planner__objective=objective)
        plan = plan_layers(mesh, rules.wanted)
        mine = rules.score(tuple(np.rint(plan.height / rules.steps.size).astype(int).tolist()))
        assert not better(cheapest_of_all(rules), mine), objective


def test_on_a_coarse_lattice_no_plan_is_better_either() -> None:
    """Lead screws with an inch thread have steps of 0.04 mm; bounds of layers must not suffer from it."""
    mesh, changes = sphere(0.4), COARSE | {"tolerance": 0.05}
    rules = Rules(mesh, optimal(**changes))
    plan = plan_layers(mesh, rules.wanted)
    mine = rules.score(tuple(np.rint(plan.height / rules.steps.size).astype(int).tolist()))

    assert not better(cheapest_of_all(rules), mine)
