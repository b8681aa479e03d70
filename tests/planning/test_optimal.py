"""The optimal planner against every plan there is, and against what it promises."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import product
from typing import Any, Final

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.arrays import Bool
from printer_slicer.errors import PlanError
from printer_slicer.model import LayerPlan, Mesh
from printer_slicer.planning import plan_layers
from printer_slicer.planning.candidate_layers import CandidateLayers
from printer_slicer.planning.height_grid import HeightGrid
from printer_slicer.planning.z_steps import ZSteps
from printer_slicer.profile import Profile
from printer_slicer.slicing import cut
from printer_slicer.surface import Certificate, certify, find_flats, read_surface
from tests.effort import crossed
from tests.parts import (
    box,
    cone,
    joined,
    loft,
    profile,
    pyramid,
    sheared_prism,
    sphere,
    step_pyramid,
    turned,
    two_boxes,
    without,
)
from tests.planning.failure_solids import slot, two_wedges
from tests.planning.plans import frusta
from tests.surface.distances import distance_to_mesh, wrong_points

OBJECTIVES = ("balanced", "time", "layers", "volume")
ERROR_PRICE = 20.0  # s/mm³
LAYER_WORTH = 1e-4  # mm³ that a layer must gain where the volume error alone counts
ROUNDING = 1e-6  # mm

each_objective = pytest.mark.parametrize("objective", OBJECTIVES)


def optimal(**changes: Any) -> Profile:
    """All heights from 0.08 to 0.32 mm on a grid of 0.01 mm, the first layer free, all neighbours allowed."""
    usual: dict[str, Any] = {"z_step": 0.01, "first_layer_height": 0, "planner__kind": "optimal"}
    dials = {"planner__error_price": ERROR_PRICE, "planner__smooth": False}
    return profile(**(usual | (dials if "planner__kind" not in changes else {}) | changes))


def planned(mesh: Mesh, **changes: Any) -> LayerPlan:
    return plan_layers(mesh, optimal(**changes))


def proven(mesh: Mesh, plan: LayerPlan) -> Certificate:
    return certify(read_surface(mesh), plan)


def flats_missed(mesh: Mesh, plan: LayerPlan, within: float) -> list[float]:
    """The flats that no layer ends near enough to."""
    ends = np.append(plan.top, 0.0)
    return [float(z) for z in find_flats(mesh)[0] if np.abs(ends - z).min() > within + ROUNDING]


def modelled_seconds(mesh: Mesh, plan: LayerPlan, wanted: Profile) -> float:
    """What the planner's model takes a plan to last."""
    grid = HeightGrid.of(ZSteps(mesh, wanted))
    ends = np.rint(np.append(0.0, plan.top) / grid.unit).astype(np.int64)
    arcs = CandidateLayers.for_part(mesh, grid, ZSteps(mesh, wanted), wanted, everywhere=True)
    mine = np.isin(arcs.graph.start * (grid.n + 1) + arcs.graph.end, ends[:-1] * (grid.n + 1) + ends[1:])
    assert mine.sum() == plan.n_layers
    return float(arcs.seconds[mine].sum())


def spent(mesh: Mesh, plan: LayerPlan, wanted: Profile) -> Mapping[str, float]:
    """A plan by each objective."""
    seconds, volume = modelled_seconds(mesh, plan, wanted), proven(mesh, plan).volume_error
    return {
        "balanced": seconds + ERROR_PRICE * volume,
        "time": seconds,
        "layers": float(plan.n_layers),
        "volume": volume + LAYER_WORTH * plan.n_layers,
    }


# --- the tolerance ---

PARTS: Final[Mapping[str, Mesh]] = {
    "box": box((9, 9, 5)),
    "pyramid": pyramid(8, 4),
    "sphere": Mesh(sphere(2).triangles * [1, 1, 4 / sphere(2).height]),
    "cone": cone(3, 4, 12),
    "leaning": sheared_prism(5, 4, 3),
    "steps": step_pyramid([30, 20, 10, 4], [0.35, 2.06, 0.5, 1.2]),
    "frusta": frusta([10, 8, 9, 5], [1.3, 1.1, 0.7]),
    "waist": frusta([9, 3, 12, 11], [1.7, 0.6, 0.8]),
    "two boxes": two_boxes(),
    "two wedges": two_wedges(),
    "slot": slot(),
    "flat cone": cone(60, 2, 9),
}
each_part = pytest.mark.parametrize("name", PARTS)
unlike = pytest.mark.parametrize(
    "name",
    [
        name
        if name in ("sphere", "steps", "waist", "leaning", "slot", "flat cone")
        else pytest.param(name, marks=pytest.mark.thorough)
        for name in PARTS
    ],
)
"""Each part in the long run; in the check one of each kind."""


@pytest.mark.parametrize(("name", "asked"), crossed(PARTS, list(product(OBJECTIVES, [0.05, 0.12]))))
def test_the_certified_error_is_within_the_tolerance(name: str, asked: tuple[str, float]) -> None:
    mesh, (objective, tolerance) = PARTS[name], asked
    certificate = proven(mesh, planned(mesh, tolerance=tolerance, planner__objective=objective))

    assert certificate.max_error <= tolerance + ROUNDING
    assert certificate.ranges_above(tolerance) == []


@each_part
def test_no_point_that_is_tried_is_wrong_by_more_than_the_tolerance(name: str) -> None:
    mesh, rng = PARTS[name], np.random.default_rng(3)
    plan = planned(mesh, tolerance=0.07)
    points, _ = wrong_points(mesh, plan, 600, rng)

    assert distance_to_mesh(points, mesh, 0.5).max(initial=0.0) <= 0.07 + ROUNDING


sizes = st.floats(2, 20).map(lambda size: round(size, 3))


@given(
    sides=st.lists(sizes, min_size=2, max_size=5),
    seed=st.integers(0, 10**6),
    tolerance=st.sampled_from([0.05, 0.08, 0.12]),
    objective=st.sampled_from(OBJECTIVES),
    single=st.booleans(),
)
def test_any_frusta_are_planned_within_the_tolerance(
    sides: list[float], seed: int, tolerance: float, objective: str, single: bool
) -> None:
    """Levels lie anywhere, the top on the grid; with 32-bit coordinates as files have them, or without."""
    rng = np.random.default_rng(seed)
    levels = rng.uniform(0.35, 1.5, len(sides) - 1)
    levels[-1] = np.ceil(levels.sum() / 0.01) * 0.01 - levels[:-1].sum()
    mesh = frusta(sides, levels.tolist())
    if single:
        mesh = Mesh(mesh.triangles.astype(np.float32).astype(np.float64))
    certificate = proven(mesh, planned(mesh, tolerance=tolerance, planner__objective=objective))

    assert certificate.max_error <= tolerance + ROUNDING


@pytest.mark.parametrize("height", [1.9951, 1.9965, 2.0012, 2.0049])
@pytest.mark.parametrize("side", [4.0, 60.0])
def test_a_top_off_the_lattice_does_not_break_the_tolerance(side: float, height: float) -> None:
    """The layer that rises over the part is cut lower than its middle."""
    mesh = pyramid(side, height)
    for objective in OBJECTIVES:
        plan = planned(mesh, tolerance=0.05, planner__objective=objective)
        assert proven(mesh, plan).max_error <= 0.05 + ROUNDING


@pytest.mark.parametrize(
    ("shift", "height", "tolerance"), [(3.0, 4.0, 0.09), (4.0, 3.0, 0.08), (3.0, 4.0, 0.06)]
)
def test_an_error_of_exactly_the_tolerance_is_within_it(
    shift: float, height: float, tolerance: float
) -> None:
    """On a side of 3 in 4 layers of 0.3 mm are off by 0.09 mm, of 0.2 mm by 0.06 mm; on 4 in 3 0.2 mm by 0.08 mm."""
    mesh = sheared_prism(5, height, shift)
    thick = round(2 * tolerance / (shift / 5), 6)
    uniform = plan_layers(mesh, profile(layer_height=thick, first_layer_height=0, z_step=0.01))
    assert proven(mesh, uniform).ranges_above(tolerance) == []

    assert planned(mesh, tolerance=tolerance, planner__objective="layers").n_layers <= uniform.n_layers


def test_the_tolerance_comes_before_the_flats() -> None:
    """The only layer that ends on the flat at 0.15 mm is 0.00008 mm over the tolerance."""
    rise = 0.05008 / 0.075  # of the side that leans; half of the layer times this is its error
    ring = np.array([(0.0, 0.0), (20.0, 0.0), (20.0, 20.0), (0.0, 20.0)])
    rings = [ring - [[0, 0], [x, 0], [x, 0], [0, 0]] for x in (0.0, 0.15 * rise / np.sqrt(1 - rise**2))]
    rings += [rings[1] - [[0, 0], [5, 0], [5, 0], [0, 0]]] * 2
    mesh = Mesh(loft(rings, [0.0, 0.15, 0.15, 2.15]))
    limits = {"min_layer": 0.1, "max_layer": 0.2, "tolerance": 0.05}
    certificate = proven(mesh, planned(mesh, **limits))

    assert certificate.max_error <= 0.05 + ROUNDING


# --- flats, top, list ---


@pytest.mark.parametrize(("name", "asked"), crossed(PARTS, list(product(OBJECTIVES, [0.01, 0.0025]))))
def test_layers_end_on_every_flat_and_on_the_top(name: str, asked: tuple[str, float]) -> None:
    mesh, (objective, z_step) = PARTS[name], asked
    plan = planned(mesh, z_step=z_step, planner__objective=objective)

    assert flats_missed(mesh, plan, z_step / 2) == []
    assert abs(plan.top[-1] - mesh.height) <= z_step / 2 + ROUNDING


@given(st.lists(st.floats(0.17, 2), min_size=2, max_size=5), st.sampled_from(OBJECTIVES), st.booleans())
def test_flats_anywhere_are_met_within_half_a_step(
    heights: list[float], objective: str, single: bool
) -> None:
    mesh = step_pyramid([30, 20, 14, 9, 5][: len(heights)], heights)
    if single:
        mesh = Mesh(mesh.triangles.astype(np.float32).astype(np.float64))
    plan = planned(mesh, tolerance=0.05, planner__objective=objective)

    assert flats_missed(mesh, plan, 0.005) == []
    assert abs(plan.top[-1] - mesh.height) <= 0.005 + ROUNDING


@pytest.mark.parametrize("noise", ["tilted", "rough"])
def test_flats_that_rounding_has_tilted_or_roughened_are_met_with_few_heights(noise: str) -> None:
    exact = step_pyramid([30, 20, 10], [1.37, 2.05, 1.58])
    triangles = exact.triangles.copy()
    up = triangles[:, :, 2] > 0
    if noise == "tilted":
        triangles[:, :, 2] += np.where(up, 1e-6 * triangles[:, :, 0], 0)
    else:
        triangles[:, :, 2] += np.where(up, 1e-6 * np.sin(50 * triangles[:, :, 0] + 3 * triangles[:, :, 1]), 0)
    mesh = Mesh(triangles)
    plan = planned(mesh, layer_heights=(0.1, 0.3))

    assert flats_missed(mesh, plan, 0.0051) == []


def between(planes: list[float], plan: LayerPlan) -> Bool:
    """(L,) the layers that neither begin nor end at one of the planes."""
    ends = np.array(planes)[:, None]
    return np.asarray((np.abs(ends - plan.bottom) > 0.006).all(0) & (np.abs(ends - plan.top) > 0.006).all(0))


@pytest.mark.parametrize(
    ("objective", "listed"), crossed(OBJECTIVES, [(0.1, 0.2, 0.3), (0.1, 0.3), (0.15,), (0.08, 0.32)])
)
def test_between_events_only_listed_heights_are_used(objective: str, listed: tuple[float, ...]) -> None:
    for mesh, planes in (
        (box((9, 9, 10.04)), [0, 10.04]),
        (step_pyramid([30, 20, 10], [1.37, 4.4, 2.92]), [0, 1.37, 5.77, 8.69]),
        (frusta([10, 8, 9, 5], [1.3, 2.1, 1.7]), [0, 5.1]),
        (pyramid(8, 4.07), [0, 4.07]),
    ):
        plan = planned(mesh, layer_heights=listed, planner__objective=objective)
        assert set(np.round(plan.height[between([float(z) for z in planes], plan)], 6)) <= set(listed)


@each_objective
def test_no_layer_is_thicker_or_thinner_than_allowed_where_allowed_ones_fit(objective: str) -> None:
    """A box of 10 mm is 50 layers of 0.2 mm; steps of 3 mm are 15 each."""
    for mesh in (box(), step_pyramid([30, 20, 10], [3, 3, 3]), pyramid(8, 4)):
        plan = planned(mesh, thinnest_layer=0.1, thickest_layer=0.2, planner__objective=objective)
        assert plan.height.max() <= 0.2 + ROUNDING
        assert plan.height.min() >= 0.1 - ROUNDING


def test_layers_of_the_step_that_is_asked_for_are_used_between_events() -> None:
    plan = planned(
        pyramid(8, 4), thinnest_layer=0.1, thickest_layer=0.3, layer_step=0.04, planner__objective="balanced"
    )

    free = plan.height[between([0, 4], plan)]
    assert set(np.round(free, 6)) <= {0.1, 0.14, 0.18, 0.22, 0.26, 0.3}


# --- the same part, said differently ---


def shuffled(mesh: Mesh, seed: int) -> Mesh:
    return Mesh(mesh.triangles[np.random.default_rng(seed).permutation(mesh.n_facets)], mesh.name)


VARIANTS = ("sphere", "steps", "frusta", "leaning", "two boxes", "slot")


def variants(mesh: Mesh) -> list[Mesh]:
    """Moved, turned, its facets in another order, and each facet begun at another corner."""
    return [
        mesh.moved((123.4, -56.7, 0)),
        turned(mesh),
        shuffled(mesh, 1),
        shuffled(mesh, 2),
        Mesh(np.roll(mesh.triangles, 1, axis=1)),
    ]


@pytest.mark.parametrize(("name", "objective"), crossed(VARIANTS, ["balanced", "layers"]))
def test_a_part_that_is_moved_turned_or_shuffled_has_the_same_plan(name: str, objective: str) -> None:
    expected = planned(PARTS[name], planner__objective=objective).runs()

    for mesh in variants(PARTS[name]):
        assert planned(mesh, planner__objective=objective).runs() == expected


@pytest.mark.parametrize(("name", "objective"), crossed(VARIANTS, ["time", "volume"]))
def test_ties_do_not_depend_on_where_the_part_stands_or_on_the_order_of_its_facets(
    name: str, objective: str
) -> None:
    """Over upright walls all layers are as good; rounding must not choose among them."""
    expected = planned(PARTS[name], planner__objective=objective).runs()

    for mesh in variants(PARTS[name]):
        assert planned(mesh, planner__objective=objective).runs() == expected


@pytest.mark.parametrize("name", VARIANTS)
def test_a_part_that_is_turned_by_any_angle_has_a_plan_as_good(name: str) -> None:
    wanted, mesh = optimal(), PARTS[name]
    turn = np.array([[np.cos(0.7), np.sin(0.7), 0], [-np.sin(0.7), np.cos(0.7), 0], [0, 0, 1]])
    other = Mesh(mesh.triangles @ turn)
    costs = [spent(one, plan_layers(one, wanted), wanted)["balanced"] for one in (mesh, other)]

    # Contours are simplified from another point, and moves are held to the limits of other axes.
    assert costs[1] == pytest.approx(costs[0], rel=1e-2)


# --- dials that should do what they say in one direction ---


@unlike
def test_a_finer_tolerance_never_gives_fewer_layers(name: str) -> None:
    counts = [
        planned(PARTS[name], tolerance=tolerance, planner__objective="layers").n_layers
        for tolerance in (0.05, 0.06, 0.075, 0.09, 0.12, 0.16)
    ]

    assert counts == sorted(counts, reverse=True)


@unlike
def test_a_higher_price_never_gives_more_volume_error(name: str) -> None:
    mesh = PARTS[name]
    errors = [
        proven(mesh, planned(mesh, planner__error_price=price)).volume_error
        for price in (1e-3, 0.1, 1, 5, 20, 100, 1e4)
    ]

    for less, more in zip(errors[1:], errors[:-1], strict=True):
        assert less <= more * (1 + 1e-3) + 1e-3


@unlike
def test_each_objective_is_best_at_its_own(name: str) -> None:
    """Time is never slower, layers are never more, than with any other objective."""
    mesh = PARTS[name]
    costs = {}
    for objective in OBJECTIVES:
        wanted = optimal(planner__objective=objective)
        costs[objective] = spent(mesh, plan_layers(mesh, wanted), wanted)
    for objective in OBJECTIVES:
        least = min(cost[objective] for cost in costs.values())
        assert costs[objective][objective] <= least * (1 + 1e-3) + 1e-3


# --- against the other planners ---

OTHERS: Final[tuple[dict[str, Any], ...]] = (
    *({"planner__kind": "uniform", "layer_height": height} for height in (0.1, 0.12, 0.16, 0.2, 0.24)),
    *({"planner__kind": "cusp", "planner__metric": metric} for metric in ("cusp", "wasserfall")),
    {"planner__kind": "area", "planner__aligned": True},
    {"planner__kind": "stepwise"},
    {"planner__kind": "genetic", "planner__generations": 20, "planner__population": 20},
)


def challengers(mesh: Mesh, tolerance: float, changes: dict[str, Any]) -> Iterator[tuple[str, LayerPlan]]:
    """What other planners make of the part, where it keeps the tolerance, the flats and the top."""
    for other in OTHERS:
        height, steps = other.get("layer_height", 0.0), changes.get("z_step", 0.01)
        if abs(height / steps - round(height / steps)) > 1e-6:
            continue
        wanted = profile(**({"tolerance": tolerance} | changes | other))
        plan, step = plan_layers(mesh, wanted), wanted.printer.z_step
        if proven(mesh, plan).max_error > tolerance + 1e-9 or flats_missed(mesh, plan, step / 2):
            continue
        if abs(plan.top[-1] - mesh.height) <= step / 2 + ROUNDING:
            yield str(other), plan


def beaten_by(mesh: Mesh, tolerance: float, changes: dict[str, Any]) -> list[str]:
    """The planners that do better than this one in its own objective."""
    best = {}
    for objective in OBJECTIVES:
        wanted = optimal(**({"tolerance": tolerance, "planner__objective": objective} | changes))
        best[objective] = spent(mesh, plan_layers(mesh, wanted), wanted)[objective]
    return [
        f"{objective}: {name}: {cost[objective]:.4f} < {best[objective]:.4f}"
        for name, plan in challengers(mesh, tolerance, changes)
        for cost in [spent(mesh, plan, wanted)]
        for objective in OBJECTIVES
        if cost[objective] < best[objective] * (1 - 1e-3) - 1e-3
    ]


@pytest.mark.parametrize(
    ("name", "first"),
    crossed(["sphere", "cone", "leaning", "frusta", "steps", "waist", "slot"], [0, 0.2]),
)
def test_no_other_planner_is_better_at_the_same_heights(name: str, first: float) -> None:
    changes = {"z_step": 0.01, "first_layer_height": first}

    assert beaten_by(PARTS[name], 0.0911, changes) == []


def test_no_other_planner_is_better_where_the_steps_are_coarse() -> None:
    """The top lies in the middle of a step of 0.04 mm."""
    mesh = frusta([10, 6, 6.5, 5], [1.3, 2.1, 1.7])
    for part in (mesh, frusta([10, 8, 9, 5], [1.3, 2.1, 1.7])):
        assert beaten_by(part, 0.12, {"z_step": 0.04, "first_layer_height": 0}) == []


# --- what cannot be had ---


def test_a_tolerance_that_cannot_be_kept_is_reported_where_it_is_broken() -> None:
    """Walls up to 2 mm, a slope of 45° up to 3 mm, walls again."""
    mesh = frusta([10, 10, 8, 8], [2, 1, 2])
    certificate = proven(mesh, planned(mesh, tolerance=0.02))
    over = certificate.ranges_above(0.02)

    assert len(over) == 1
    low, high, bound = over[0]
    assert 1.9 <= low <= 2.1
    assert 2.9 <= high <= 3.1
    assert bound == pytest.approx(certificate.max_error)
    assert 0.02 < bound <= 0.045  # the thinnest layers are 0.08 mm, some 0.09


def test_a_tolerance_that_can_be_kept_is_not_reported() -> None:
    mesh = frusta([10, 10, 8, 8], [2, 1, 2])

    assert proven(mesh, planned(mesh, tolerance=0.05)).ranges_above(0.05) == []


@pytest.mark.parametrize(("tolerance", "height"), crossed([0.001, 0.01, 0.02, 0.03], [2.0, 2.05, 3.17]))
def test_a_tolerance_that_cannot_be_kept_is_broken_no_more_than_by_the_thinnest_layers(
    tolerance: float, height: float
) -> None:
    mesh = pyramid(8, height)
    thin = plan_layers(
        mesh, profile(planner__kind="uniform", layer_height=0.08, z_step=0.01, first_layer_height=0)
    )
    for objective in OBJECTIVES:
        plan = planned(mesh, tolerance=tolerance, planner__objective=objective)
        assert proven(mesh, plan).max_error <= proven(mesh, thin).max_error + 0.006


# --- degenerate parts ---


@pytest.mark.parametrize(
    ("height", "asked"),
    crossed([0.08, 0.1, 0.15, 0.16, 0.25, 0.32, 0.33, 0.5], list(product(OBJECTIVES, [0, 0.2]))),
)
def test_low_parts_are_covered(height: float, asked: tuple[str, float]) -> None:
    objective, first = asked
    for mesh in (box((8, 8, height)), pyramid(8, height)):
        plan = planned(mesh, first_layer_height=first, planner__objective=objective)
        assert plan.top[-1] == pytest.approx(height)
        assert plan.height.min() >= 0.08 - ROUNDING
        assert plan.height.max() <= 0.32 + ROUNDING


@pytest.mark.parametrize("height", [0.35, 0.55])
@pytest.mark.parametrize("first", [0, 0.2])
def test_a_printer_with_a_narrow_range_covers_what_its_layers_do_not_add_up_to(
    height: float, first: float
) -> None:
    """Layers of 0.2 to 0.3 mm make up neither 0.35 nor, on a first one of 0.2 mm, 0.55 mm; uniform rises over it."""
    limits: dict[str, Any] = {"min_layer": 0.2, "max_layer": 0.3, "first_layer_height": first}
    mesh = box((9, 9, height))
    uniform = plan_layers(mesh, profile(**limits))

    assert planned(mesh, **limits).top[-1] == pytest.approx(uniform.top[-1])


@pytest.mark.parametrize("off", [0.0, 0.0012, 0.0049, 0.0051, 0.0099])
def test_tops_off_the_lattice_are_met_within_half_a_step(off: float) -> None:
    for mesh in (box((8, 8, 3 + off)), pyramid(8, 3 + off)):
        plan = planned(mesh)
        assert abs(plan.top[-1] - mesh.height) <= 0.005 + ROUNDING
        assert (plan.cut < mesh.height).all()
        assert (cut(mesh, plan, 0.0).solid.area() > 0).all()


@pytest.mark.parametrize("missing", [(0,), (3, 4), (20, 21, 22)])
def test_open_meshes_are_planned_like_closed_ones(missing: tuple[int, ...]) -> None:
    mesh = without(sphere(2), *missing)
    plan = planned(mesh, tolerance=0.08)

    assert abs(plan.top[-1] - mesh.height) <= 0.005 + ROUNDING
    assert proven(mesh, plan).max_error <= 0.08 + ROUNDING


def test_a_mesh_inside_out_is_planned() -> None:
    mesh = Mesh(sphere(2).triangles[:, ::-1])

    assert planned(mesh).n_layers == planned(sphere(2)).n_layers


def test_a_body_beside_another_is_looked_at_as_well() -> None:
    """The walls of the tall box allow thick layers where the small cone beside it does not."""
    tall, small = box((5, 5, 6)), cone(3, 2, 12).moved((12, 0, 0))
    both = joined([tall, small])
    plan = planned(both, tolerance=0.06, planner__objective="layers")

    assert proven(both, plan).max_error <= 0.06 + ROUNDING
    assert plan.height[plan.top < 1.9].max() < 0.2
    assert plan.height[plan.bottom > 2.0].min() > 0.2


@pytest.mark.parametrize("z_step", [0.04, 0.02, 0.0025, 0.00125])
def test_printers_with_coarse_and_fine_steps_get_plans_on_their_steps(z_step: float) -> None:
    mesh = pyramid(6, 2.4)
    plan = planned(mesh, z_step=z_step, tolerance=0.07)
    steps = plan.top / z_step

    assert np.abs(steps - np.round(steps)).max() < 1e-4
    assert plan.top[-1] == pytest.approx(2.4)
    assert proven(mesh, plan).max_error <= 0.07 + ROUNDING


def test_a_tall_part_of_fine_steps_is_planned_to_its_top() -> None:
    mesh = cone(10, 200, 6)
    plan = planned(mesh, z_step=0.0025, tolerance=0.1, planner__objective="layers")

    assert plan.top[-1] == pytest.approx(200)
    assert plan.n_layers == 625


def test_a_part_thinner_than_the_thinnest_layer_is_refused_with_a_remedy() -> None:
    with pytest.raises(PlanError) as caught:
        planned(box((9, 9, 0.05)))

    assert "0.05 mm" in str(caught.value)
    assert caught.value.remedy
