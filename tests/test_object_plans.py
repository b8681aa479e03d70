"""Objects of one part on layers of their own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from printer_slicer.errors import UsageError
from printer_slicer.extrusion import move_seconds
from printer_slicer.extrusion.acceleration import move_accelerations
from printer_slicer.gcode_text import gcode_of
from printer_slicer.inspection.coverage.gcode_extrusions import extrusions_and_moves_of_gcode
from printer_slicer.inspection.coverage.layer_extrusions import file_layers_of
from printer_slicer.inspection.coverage.model_check import check_gcode
from printer_slicer.inspection.coverage.stack import stack_extrusions
from printer_slicer.model import Heat, LayerPlan, Mesh, PlateObject, Program
from printer_slicer.object_plans import extract_objects
from printer_slicer.pipeline import slice_stages
from printer_slicer.placing import join
from printer_slicer.profile import Profile
from printer_slicer.roles import Role, roles_with
from printer_slicer.stages import Stages
from tests.parts import box, plain

SIDE = 12.0
PLANS = (
    LayerPlan.from_tops(np.round(np.arange(1, 31) * 0.2, 6)),
    LayerPlan.from_tops(np.round(np.arange(1, 21) * 0.3, 6)),
)


def two_objects() -> Mesh:
    """Two cubes 6 mm high side by side."""
    cubes = [box((SIDE, SIDE, 6.0), (20.0 * k, 0.0, 0.0)) for k in range(2)]
    items = tuple(
        PlateObject(name, cube.bounds[0], cube.bounds[1], 12 * k, 12)
        for k, (name, cube) in enumerate(zip(("thin", "thick"), cubes, strict=True))
    )
    return Mesh(np.concatenate([cube.triangles for cube in cubes]), "plate", items)


@pytest.fixture(scope="module")
def stages() -> Stages:
    return slice_stages(two_objects(), plain(skirt_loops=0), plan=PLANS)


def of_object(stages: Stages, k: int) -> np.ndarray:
    """(M,) the paths of one of the objects."""
    paths = stages.toolpaths
    middle = np.array([paths.path(i)[:, 0].mean() for i in range(paths.n_paths)])
    return np.flatnonzero((middle > np.mean(middle)) == bool(k))


def test_layers_are_printed_in_the_order_of_their_tops(stages: Stages) -> None:
    tops = np.unique(np.concatenate([plan.top for plan in PLANS]).round(6))

    assert stages.plan.top == pytest.approx(tops)
    assert (np.diff(stages.program.z_top) >= 0).all()


@pytest.mark.parametrize("k", [0, 1])
def test_each_object_has_the_heights_and_tops_of_its_own_plan(stages: Stages, k: int) -> None:
    own, paths = of_object(stages, k), stages.toolpaths
    walls = own[np.isin(paths.role[own], (Role.EXTERNAL_PERIMETER, Role.PERIMETER, Role.SOLID_INFILL))]

    assert np.unique(paths.z_top[own].round(6)) == pytest.approx(PLANS[k].top)
    assert paths.height[walls] == pytest.approx(np.full(len(walls), PLANS[k].height[0]))
    assert paths.z_top == pytest.approx(paths.plan.top[paths.layer])


@pytest.mark.parametrize("k", [0, 1])
def test_each_object_holds_the_plastic_that_it_holds_alone(stages: Stages, k: int) -> None:
    wanted = plain(skirt_loops=0)
    alone = slice_stages(box((SIDE, SIDE, 6.0)), wanted, plan=PLANS[k]).program
    program = stages.program
    here = (program.xyz[:, 0] > program.xyz[:, 0].mean()) == bool(k)
    laid = roles_with(is_part=True)[program.role]

    assert program.filament[here & laid].sum() == pytest.approx(
        alone.filament[roles_with(is_part=True)[alone.role]].sum(), rel=0.01
    )


def test_the_file_of_both_passes_the_check_against_the_model(stages: Stages) -> None:
    text = gcode_of(stages.program, plain(skirt_loops=0))
    found = check_gcode(text, two_objects())

    assert (found.findings, found.problems) == ((), ())
    assert found.coverage.stack.n_layers == sum(plan.n_layers for plan in PLANS)
    assert found.coverage.stack.number[-1] == stages.plan.n_layers


def test_an_object_of_which_a_layer_is_missing_does_not_pass(stages: Stages) -> None:
    program = stages.program
    second = program.xyz[:, 0] > program.xyz[:, 0].mean()
    gone = second & (np.abs(program.z_top - 3.3) < 1e-6)
    text = gcode_of(replace(program, filament=np.where(gone, 0.0, program.filament)), plain(skirt_loops=0))

    assert "uncovered" in {one.code for one in check_gcode(text, two_objects()).findings}


def test_the_file_names_the_heights_of_both(stages: Stages) -> None:
    text = gcode_of(stages.program, plain(skirt_loops=0))
    heights = {float(line[8:]) for line in text.decode().splitlines() if line.startswith(";HEIGHT:")}

    assert {0.2, 0.3} <= heights
    assert all(round(z, 6) > 0 for z in stages.program.height[stages.program.role != Role.TRAVEL])


def test_each_object_has_a_first_layer_of_its_own() -> None:
    changes = {
        "quality__speeds__first_layer": 11, "quality__speeds__first_layer_infill": 12, "skirt_loops": 0,
        "quality__accelerations__first_layer": 300, "quality__first_layer_flow": 0.9,
        "material__first_layer_nozzle_temperature": 225, "material__nozzle_temperature": 205,
    }  # fmt: skip
    program = slice_stages(two_objects(), plain(**changes), plan=PLANS).program
    laid = roles_with(is_part=True)[program.role]
    first = laid & (program.z_top - program.height < 1e-6)
    accelerations = move_accelerations(program, plain().printer, 0, program.n_moves)

    assert sorted(np.unique(program.z_top[first].round(6))) == pytest.approx([0.2, 0.3])
    assert program.speed[first].max() <= 12 < program.speed[laid & ~first].max()
    assert accelerations is not None
    assert (accelerations[first] == 300).all()
    assert (accelerations[laid & ~first] != 300).all()
    [heat] = [event for event in program.events if isinstance(event, Heat)]
    assert np.flatnonzero(first)[-1] < heat.index <= np.flatnonzero(laid & (program.z_top > 0.3 + 1e-6))[0]


def test_there_is_one_plan_for_each_object_or_one_for_all() -> None:
    with pytest.raises(UsageError, match="3 layer plans for 2 objects"):
        slice_stages(two_objects(), plain(), plan=(*PLANS, PLANS[0]))


def test_plans_that_are_equal_make_the_same_moves_as_one() -> None:
    wanted = plain()
    together = slice_stages(two_objects(), wanted, plan=PLANS[0]).program
    apart = slice_stages(
        two_objects(), wanted, plan=(PLANS[0], LayerPlan.from_tops(np.array(PLANS[0].top)))
    ).program

    assert apart.filament_used == pytest.approx(together.filament_used, rel=1e-6)
    assert np.array_equal(np.unique(apart.z_top), np.unique(together.z_top))


def _layer_seconds(program: Program, wanted: Profile, tops: Sequence[float]) -> float:
    """Time of all moves on the layers with these tops, s."""
    here = np.isin(program.z_top.round(6), np.round(tops, 6))
    return float(move_seconds(program, wanted)[here].sum())


def test_layers_of_different_objects_cool_together() -> None:
    wanted = plain(material__min_layer_time=12.0, material__min_speed=1.0, skirt_loops=0)
    program = slice_stages(two_objects(), wanted, plan=PLANS).program

    # Groups: tops at 2.6 (thin) and 2.7 (thick), 2.8 (thin), and 3.0 (both).
    for tops in ([2.6, 2.7], [2.8], [3.0]):
        assert _layer_seconds(program, wanted, tops) == pytest.approx(12.0, rel=0.03)


def test_copies_in_a_group_are_counted() -> None:
    cubes = [
        Mesh(box((4.0, 4.0, 2.0), (10.0 * k, 0.0, 0.0)).triangles, name) for k, name in enumerate("abaa")
    ]
    plate = join(cubes)
    assert extract_objects(plate, plate.objects).name == "3 x a, b"


def test_layers_read_from_the_file_are_as_high_as_they_were_planned(stages: Stages) -> None:
    gcode, _, _ = extrusions_and_moves_of_gcode(gcode_of(stages.program, plain()))
    layers = file_layers_of(gcode, stack_extrusions(gcode.beads))
    planned = {round(float(top), 3): 0.3 if round(float(top) / 0.2, 3) % 1 else 0.2 for top in layers.top}
    shared = {0.6 * k for k in range(1, 11)}  # layers of both objects end there
    for top, bottom in zip(layers.top.tolist(), layers.bottom.tolist(), strict=True):
        if not any(abs(top - z) < 0.01 for z in shared):
            assert top - bottom == pytest.approx(planned[round(top, 3)], abs=1e-3)
