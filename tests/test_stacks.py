"""Objects of a plate with layer plans of their own (`quality.planner.stacks = objects`)."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import printer_slicer as ps
from printer_slicer.errors import UsageError
from printer_slicer.extrusion import move_seconds
from printer_slicer.gcode_text import gcode_of
from printer_slicer.model import LayerPlan, Mesh, ObjectStack, Walls
from printer_slicer.object_plans import find_plan_groups
from printer_slicer.pipeline import plan_objects, slice_planned, slice_stages
from printer_slicer.profile import Profile
from printer_slicer.surface import certificate_comments, certify, certify_stacks, read_surface
from tests.cli.command_line import typed
from tests.mesh_io.tiny_files import binary_stl
from tests.parts import box, cone, plain, sphere
from tests.surface.distances import distance_to_mesh, wrong_points

ROUNDING = 1e-6
SHAPES = {"box": box((8.0, 8.0, 5.0)), "cone": cone(4.0, 6.0, 16), "sphere": sphere(3.0)}


def optimal(**changes: object) -> Profile:
    """The optimal planner with a plan for each object."""
    usual = {"planner__kind": "optimal", "planner__stacks": "objects", "tolerance": 0.12}
    return plain(**(usual | changes))


def plate(names: list[str], gap: float = 12.0, scale: float = 1.0) -> Mesh:
    """Shapes side by side, standing on the bed."""
    parts = []
    for index, name in enumerate(names):
        triangles = SHAPES[name].triangles * scale
        triangles -= [
            *triangles.reshape(-1, 3).mean(axis=0)[:2] - [gap * index, 0.0],
            triangles[..., 2].min(),
        ]
        parts.append(Mesh(triangles, f"{name}_{index}"))
    return ps.join(parts)


@given(
    names=st.lists(st.sampled_from(sorted(SHAPES)), min_size=2, max_size=3),
    scale=st.sampled_from([0.7, 1.0, 1.3]),
    tolerance=st.sampled_from([0.1, 0.12]),
)
def test_the_certificate_of_each_object_holds(names: list[str], scale: float, tolerance: float) -> None:
    part = plate(names, scale=scale)
    stacks = plan_objects(part, optimal(tolerance=tolerance))
    whole, rng = certify_stacks(stacks), np.random.default_rng(len(names))

    assert sorted(index for one in stacks for index in one.objects) == list(range(len(names)))
    assert whole.max_error <= tolerance + ROUNDING
    for one in stacks:
        points, _ = wrong_points(one.mesh, one.plan, 100, rng)
        assert distance_to_mesh(points, one.mesh, 0.5).max(initial=0.0) <= whole.max_error + ROUNDING


@pytest.fixture(scope="module")
def mixed() -> tuple[ps.Stages, Profile]:
    """A box and a cone, sliced."""
    wanted = optimal()
    return slice_stages(plate(["box", "cone"]), wanted), wanted


def test_unlike_objects_have_plans_of_their_own(mixed: tuple[ps.Stages, Profile]) -> None:
    stages, _ = mixed
    boxes, cones = stages.stacks

    assert (boxes.objects, cones.objects) == ((0,), (1,))
    assert boxes.plan.top[-1] == pytest.approx(5.0)
    assert cones.plan.top[-1] == pytest.approx(6.0)
    assert boxes.plan.n_layers < cones.plan.n_layers
    assert np.array_equal(stages.plan.top, LayerPlan.union([boxes.plan, cones.plan]).top)


def test_the_nozzle_never_goes_below_a_printed_layer(mixed: tuple[ps.Stages, Profile]) -> None:
    program = mixed[0].program

    assert (np.diff(program.z_top) >= 0).all()
    assert (np.diff(program.xyz[program.filament > 0, 2]) >= -ROUNDING).all()


def test_the_certificate_of_the_plate_combines_those_of_the_objects(mixed: tuple[ps.Stages, Profile]) -> None:
    whole = certify_stacks(mixed[0].stacks)
    boxes, cones = whole.parts

    assert [one.name for one in whole.parts] == ["box_0", "cone_1"]
    assert whole.max_error == max(boxes.max_error, cones.max_error)
    assert whole.volume_error == pytest.approx(boxes.volume_error + cones.volume_error)
    assert whole.area == pytest.approx(boxes.area + cones.area)
    assert whole.plan.top[whole.worst.layer - 1] == pytest.approx(cones.plan.top[cones.worst.layer - 1])
    assert (whole.missing, whole.overshoot) == (0.0, 0.0)


def test_comments_name_the_errors_of_each_object(mixed: tuple[ps.Stages, Profile]) -> None:
    stages, wanted = mixed
    certificate = certify_stacks(stages.stacks)
    text = gcode_of(stages.program, wanted, part=stages.part, certificate=certificate).decode()

    assert f"; certified errors of box_0 = 0.0000 mm, {certificate.parts[0].volume_error:.2f} mm3" in text
    assert "; certified errors of cone_1 = " in text
    assert not any("errors of" in line for line in certificate_comments(certificate.parts[0]))


def test_overlapping_layers_have_no_certificate_without_their_objects(
    mixed: tuple[ps.Stages, Profile],
) -> None:
    stages, _ = mixed

    with pytest.raises(UsageError, match="overlapping layers"):
        certify(read_surface(stages.part), stages.plan)


def test_equal_objects_are_printed_as_with_one_plan() -> None:
    part = plate(["cone", "cone", "cone"])
    texts = [
        gcode_of(slice_stages(part, optimal(planner__stacks=stacks)).program, optimal())
        for stacks in ("one", "objects")
    ]
    first, second = ([line for line in text.splitlines() if line[:1] != b";"] for text in texts)

    assert first == second


def test_the_part_has_one_stack_by_default() -> None:
    stages = slice_stages(plate(["box", "cone"]), optimal(planner__stacks="one"))
    [stack] = stages.stacks

    assert stack.mesh is stages.part
    assert stack.objects == (0, 1)
    assert certify_stacks(stages.stacks).parts == ()


def test_objects_that_almost_touch_have_the_same_plan() -> None:
    assert find_plan_groups(plate(["box", "box", "box"], gap=8.5), optimal()) == [(0, 1, 2)]
    assert find_plan_groups(plate(["box", "box"], gap=9.5), optimal()) == [(0,), (1,)]
    assert find_plan_groups(plate(["cone", "sphere", "box"], gap=7.5), optimal()) == [(0, 1, 2)]


@pytest.mark.parametrize("changes", [{"spiral": True}, {"planner__stacks": "one"}])
def test_one_plan_for_all(changes: dict[str, object]) -> None:
    assert find_plan_groups(plate(["box", "cone"]), optimal(**changes)) == [(0, 1)]
    assert find_plan_groups(plate(["box", "cone"]), plain()) == [(0, 1)]


def _minutes(part: Mesh, stacks: tuple[ObjectStack, ...], wanted: Profile) -> float:
    plans = {index: one.plan for one in stacks for index in one.objects}
    program = slice_planned(part, [plans[index] for index in sorted(plans)], wanted).program
    return float(move_seconds(program, wanted).sum()) / 60


def test_plans_of_all_objects_are_within_the_time_budget() -> None:
    part = slice_stages(plate(["sphere", "cone"]), plain()).part
    free = plan_objects(part, optimal())
    usual = _minutes(part, free, optimal())
    wanted = optimal(planner__time_budget=usual * 60 * 1.1)
    longer = plan_objects(part, wanted)

    assert usual < _minutes(part, longer, wanted) <= usual * 1.1
    assert certify_stacks(longer).volume_error < certify_stacks(free).volume_error


def test_too_short_a_time_budget_gives_the_fastest_plans() -> None:
    part = slice_stages(plate(["sphere", "cone"]), plain()).part
    hurried = plan_objects(part, optimal(planner__time_budget=60))
    fastest = plan_objects(part, optimal(planner__objective="time"))

    assert [one.plan.runs() for one in hurried] == [one.plan.runs() for one in fastest]


def test_areas_that_stay_empty_keep_their_volume_on_common_layers() -> None:
    thin, thick = LayerPlan.from_tops(np.array([0.2, 0.4])), LayerPlan.from_tops(np.array([0.4]))
    stages = [slice_stages(box((8.0, 8.0, 0.4)), plain(), plan=plan) for plan in (thin, thick)]
    lost = [np.array([3.0, 3.0]), np.array([1.0])]
    both = Walls.joined([replace(one.walls, lost=area) for one, area in zip(stages, lost, strict=True)])

    assert (both.lost * both.plan.height).sum() == pytest.approx(3.0 * 0.2 * 2 + 1.0 * 0.4)


def test_plan_and_slice_report_each_object(tmp_path: Path) -> None:
    for name in ("box", "cone"):
        (tmp_path / f"{name}.stl").write_bytes(binary_stl(SHAPES[name].triangles))
    options = ("box.stl", "cone.stl", "--planner", "optimal", "--set", "planner.stacks=objects")
    sliced = typed("slice", *options, "-o", "out.gcode", "--json", cwd=tmp_path)
    table = typed("plan", *options, cwd=tmp_path).out
    facts = json.loads(sliced.out)["certificate"]

    assert [one["objects"] for one in facts["stacks"]] == ["box", "cone"]
    assert facts["max_error_mm"] == max(one["max_error_mm"] for one in facts["stacks"])
    assert "\n    cone " in table
    assert "\n  box: " in table


def test_supports_have_owners_if_another_object_has_no_overhangs() -> None:
    top = box((16.0, 16.0, 1.0), (-4.0, -4.0, 4.0))
    table = Mesh(np.concatenate([box((8.0, 8.0, 4.5)).triangles, top.triangles]), "table")
    other = Mesh(SHAPES["cone"].moved((30.0, 0.0, -float(SHAPES["cone"].bounds[0, 2]))).triangles, "cone")
    plans = [LayerPlan.from_tops(np.round(np.arange(1, n + 1) * h, 6)) for n, h in ((25, 0.2), (20, 0.3))]
    stages = slice_stages(ps.join([table, other]), optimal(support="columns"), plan=plans)

    assert stages.supports is not None
    assert stages.supports.area.n_rings > 0
