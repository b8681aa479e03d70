"""What every planner promises, whatever it is called."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import product
from typing import Any, Final

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from printer_slicer.errors import PlanError, ProfileError
from printer_slicer.model import LayerPlan, Mesh
from printer_slicer.planning import PLANNERS, plan_layers
from printer_slicer.profile import Profile
from printer_slicer.slicing import cut
from tests.effort import crossed, examples
from tests.parts import (
    box,
    box_with_hole,
    case_study,
    cone,
    profile,
    pyramid,
    sheared_prism,
    sphere,
    step_pyramid,
    two_boxes,
)
from tests.planning.plans import away_from

VARIANTS: Final[Mapping[str, dict[str, Any]]] = {
    **{name: {"planner__kind": name} for name in PLANNERS},
    "area aligned": {"planner__kind": "area", "planner__aligned": True},
    "area guarded": {"planner__kind": "area", "planner__guarded": True},
    "area aligned and guarded": {"planner__kind": "area", "planner__aligned": True, "planner__guarded": True},
}
# The paper's march ends where its last step leads, up to a thick layer over the part; it says so.
MARCHES = {"area", "area guarded"}
PARTS = [
    box(),
    box((5, 5, 0.5)),
    box((7, 7, 12.345)),
    pyramid(),
    cone(3, 7.77, 12),
    sphere(),
    sphere(2.3),
    case_study(),
    sheared_prism(),
    box_with_hole(),
    two_boxes(),
    step_pyramid([30, 20, 10, 4], [0.35, 2.06, 0.1, 3.21]),
    step_pyramid([30, 20, 10], [0.021, 0.034, 1.0]),
]
each_planner = pytest.mark.parametrize("variant", VARIANTS)


def chosen(variant: str, **changes: Any) -> Profile:
    return profile(**(VARIANTS[variant] | changes))


def is_kept(plan: LayerPlan, mesh: Mesh, wanted: Profile, *, marches: bool) -> None:
    """All promises on one plan."""
    printer = wanted.printer
    assert (np.diff(plan.top, prepend=0.0) > 0).all()
    assert plan.height.min() >= printer.min_layer - 1e-7
    assert plan.height.max() <= printer.max_layer + 1e-7
    steps = plan.top / printer.z_step
    assert np.abs(steps - np.round(steps)).max() < 1e-4
    assert (plan.bottom < plan.cut).all()
    assert (plan.cut < plan.top).all()
    assert (plan.cut < mesh.height).all()
    assert plan.top[-1] >= mesh.height - printer.z_step * 0.501
    assert plan.top[-1] <= mesh.height + (printer.max_layer if marches else printer.z_step * 0.501)


@pytest.mark.parametrize(("mesh", "asked"), crossed(PARTS, list(product(VARIANTS, [0, 0.2]))))
def test_a_plan_increases_within_limits_and_covers_the_part(mesh: Mesh, asked: tuple[str, float]) -> None:
    variant, first = asked
    wanted = chosen(variant, first_layer_height=first)

    is_kept(plan_layers(mesh, wanted), mesh, wanted, marches=variant in MARCHES)


@each_planner
def test_the_same_part_and_profile_give_the_same_plan(variant: str) -> None:
    wanted = chosen(variant)
    first, second = plan_layers(sphere(), wanted), plan_layers(sphere(), wanted)

    assert np.array_equal(first.top, second.top)
    assert np.array_equal(first.cut, second.cut)


@each_planner
def test_the_plan_does_not_depend_on_where_the_part_stands_on_the_bed(variant: str) -> None:
    wanted = chosen(variant)
    here, there = sphere(), sphere().moved((123.4, -56.7, 0))

    assert plan_layers(here, wanted).runs() == plan_layers(there, wanted).runs()


@each_planner
def test_the_plan_does_not_depend_on_the_order_of_the_facets(variant: str) -> None:
    wanted = chosen(variant)
    order = np.random.default_rng(3).permutation(case_study().n_facets)
    shuffled = Mesh(case_study().triangles[order])

    assert plan_layers(shuffled, wanted).runs() == plan_layers(case_study(), wanted).runs()


@each_planner
def test_every_layer_of_the_plan_holds_material(variant: str) -> None:
    mesh = step_pyramid([12, 8, 3], [1.23, 0.4, 2.0])
    plan = plan_layers(mesh, chosen(variant))

    assert (cut(mesh, plan, 0.0).solid.area() > 0).all()


@each_planner
def test_a_first_layer_height_that_is_asked_for_is_given(variant: str) -> None:
    for first in (0.1, 0.2, 0.3):
        assert plan_layers(box(), chosen(variant, first_layer_height=first)).height[0] == pytest.approx(first)


@each_planner
def test_a_part_thinner_than_any_layer_is_refused(variant: str) -> None:
    with pytest.raises(PlanError, match="thinner than the thinnest layer"):
        plan_layers(box((5, 5, 0.03)), chosen(variant))


@each_planner
def test_variable_layers_use_only_the_heights_they_were_allowed(variant: str) -> None:
    """The ends of regions apart, where a height must fit."""
    wanted = chosen(variant, layer_height=0.1, layer_heights=(0.1, 0.3), first_layer_height=0)

    parts = [box((10, 10, 30)), case_study(), step_pyramid([30, 20, 10], [1.37, 4.4, 2.92]), sphere(5)]
    for mesh in parts[
        : 3 if "area" in variant else 4
    ]:  # the paper's rule sees a stretch of its own at the equator
        plan = plan_layers(mesh, wanted)
        levels = np.unique(mesh.triangles[:, :, 2])
        # Flats, ridges and the ends of prisms are event planes; of a ball only its poles are.
        planes = levels if len(levels) < 8 else levels[[0, -1]]
        over = np.abs(plan.bottom[:, None] - planes).min(axis=1) < 0.006
        free = away_from(planes, plan, wanted) & ~over

        assert set(np.round(plan.height[free], 6)) <= {0.1, 0.3}


heights = st.floats(0.02, 6.0).map(lambda z: round(z, 4))


@each_planner
@settings(max_examples=examples(10))
@given(
    levels=st.lists(heights, min_size=1, max_size=4),
    limits=st.tuples(st.integers(4, 20), st.integers(0, 20)),
    parts=st.tuples(*[st.floats(0, 1)] * 4),
)
def test_the_promises_hold_for_any_blocks_and_any_limits(
    variant: str, levels: list[float], limits: tuple[int, int], parts: tuple[float, ...]
) -> None:
    lowest, highest = limits[0], min(2 * limits[0] + limits[1], 40)
    first, thin, thick, layer = (lowest + round(part * (highest - lowest)) for part in parts)
    mesh = step_pyramid([20, 13, 8, 5][: len(levels)], levels)
    # A rest over the first layer that is thinner than any layer is another question, asked in test_uniform.
    assume(mesh.height > (first + lowest) * 0.01 + 0.005)
    try:
        wanted = chosen(
            variant,
            min_layer=lowest / 100,
            max_layer=highest / 100,
            first_layer_height=first / 100,
            thinnest_layer=min(thin, thick) / 100,
            thickest_layer=max(thin, thick) / 100,
            layer_height=layer / 100,
            extrusion_width=0.5,
        )
    except ProfileError:
        assume(False)

    is_kept(plan_layers(mesh, wanted), mesh, wanted, marches=variant in MARCHES)
