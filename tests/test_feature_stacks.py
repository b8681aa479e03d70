"""Features of a part with layer plans of their own (`quality.planner.stacks = features`)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import printer_slicer as ps
from printer_slicer.errors import ProfileError
from printer_slicer.extrusion import move_seconds
from printer_slicer.feature_ranges import find_feature_ranges
from printer_slicer.feature_stacks import prepare_feature_plans
from printer_slicer.gcode_text import gcode_of
from printer_slicer.geometry import Areas, find_enclosing_rings
from printer_slicer.geometry.facet_clipping import clip_facets
from printer_slicer.model import ObjectStack
from printer_slicer.pipeline import plan_objects, slice_stages
from printer_slicer.surface import certify_stacks
from tests.cli.command_line import typed
from tests.contoured_parts import dome, wedge
from tests.mesh_io.tiny_files import binary_stl
from tests.parts import box, joined, plain, sphere
from tests.surface.distances import distance_to_mesh, wrong_points
from tests.towers import optimal, towers

ROUNDING = 1e-6


def test_towers_stand_apart_between_base_and_roof() -> None:
    [place] = find_feature_ranges(towers(roof=2.0), 0.01, 1.5)

    assert place.low == pytest.approx(2.0)
    assert place.high == pytest.approx(13.5)
    assert place.outlines.n_layers == 2
    assert place.outlines.area() == pytest.approx([17 * 15, np.pi * 5.5**2], rel=0.05)


def test_a_part_without_towers_has_no_features() -> None:
    assert find_feature_ranges(sphere(6.0), 0.01, 1.5) == []
    assert len(plan_objects(box((8.0, 8.0, 5.0)), optimal())) == 1


def test_parts_that_stand_apart_from_bed_to_top_are_planned() -> None:
    """Nothing is below, between or above them."""
    part = joined([wedge(10.0), dome(12.0, 2.0).moved((30.0, 0.0, 0.0))])

    assert max(one.plan.top[-1] for one in plan_objects(part, optimal())) == pytest.approx(
        part.height, abs=0.1
    )


def test_clips_of_consecutive_ranges_are_the_whole_surface() -> None:
    part = towers(roof=2.0)
    clips = [
        clip_facets(part.triangles, low, high)
        for low, high in [(0.0, 2.0), (2.0, 7.3), (7.3, 13.5), (13.5, 20.0)]
    ]

    assert sum(_area(clip) for clip in clips) == pytest.approx(_area(part.triangles))
    assert [clip[:, :, 2].max() for clip in clips] == pytest.approx([2.0, 7.3, 13.5, 16.0])


def _area(triangles: np.ndarray) -> float:
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    return float(np.linalg.norm(normal, axis=1).sum() / 2)


@pytest.fixture(scope="module", params=[0.0, 2.0])
def sliced(request: pytest.FixtureRequest) -> ps.Stages:
    """Towers without and with a roof."""
    part = slice_stages(towers(request.param), plain()).part
    plan_features = prepare_feature_plans(part, optimal())
    assert plan_features
    return slice_stages(part, optimal(), plan=plan_features({}))


def test_features_have_layers_of_their_own_between_planes(sliced: ps.Stages) -> None:
    features = [one for one in sliced.stacks if one.outline]
    common = [one for one in sliced.stacks if not one.outline]

    assert len(features) == 2
    assert features[0].plan.n_layers < features[1].plan.n_layers
    assert all(one.plan.bottom[0] == pytest.approx(2.0) for one in features)
    assert common[0].plan.top[-1] == pytest.approx(2.0)
    if len(common) > 1:
        assert all(one.plan.top[-1] == pytest.approx(13.5) for one in features)
        assert common[1].plan.bottom[0] == pytest.approx(13.5)


def test_the_certificate_holds_at_sampled_points(sliced: ps.Stages) -> None:
    part, rng = sliced.part, np.random.default_rng(1)
    for one in sliced.stacks:
        certificate = certify_stacks([one])
        points = _select_printed(*wrong_points(part, one.whole_plan, 2000, rng), one)
        assert distance_to_mesh(points, part, 0.5).max(initial=0.0) <= certificate.max_error + ROUNDING
    assert certify_stacks(sliced.stacks).max_error <= 0.12 + ROUNDING


def _select_printed(points: np.ndarray, layer: np.ndarray, stack: ObjectStack) -> np.ndarray:
    """Points in the layers and the outline of a stack."""
    top = np.append(stack.whole_plan.top, np.inf)[layer]
    points = points[(top >= stack.plan.top[0] - ROUNDING) & (top <= stack.plan.top[-1] + ROUNDING)]
    if stack.outline is None:
        return points
    areas: Areas = stack.outline
    return points[find_enclosing_rings(areas, points[:, :2], np.zeros(len(points), np.int64)) >= 0]


def test_the_certificates_cover_the_whole_surface(sliced: ps.Stages) -> None:
    assert certify_stacks(sliced.stacks).area == pytest.approx(_area(sliced.part.triangles))


def test_the_part_is_filled_once(sliced: ps.Stages) -> None:
    single = slice_stages(sliced.part, optimal(planner__stacks="one"))

    assert sliced.program.filament_used == pytest.approx(single.program.filament_used, rel=0.01)
    assert (np.diff(sliced.program.xyz[sliced.program.filament > 0, 2]) >= -ROUNDING).all()


def test_features_do_not_cost_more_than_a_single_plan(sliced: ps.Stages) -> None:
    price = 20.0
    wanted = [optimal(planner__stacks=stacks, planner__error_price=price) for stacks in ("features", "one")]
    costs = []
    for one in wanted:
        stages = slice_stages(sliced.part, one)
        seconds = float(move_seconds(stages.program, one).sum())
        costs.append(seconds + price * certify_stacks(stages.stacks).volume_error)

    assert costs[0] <= costs[1] + ROUNDING


def test_parts_without_features_are_printed_as_with_one_plan() -> None:
    first, second = (
        gcode_of(slice_stages(sphere(5.0), optimal(planner__stacks=stacks)).program, plain())
        for stacks in ("one", "features")
    )

    assert first == second


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"support": "columns"}, "features with layers of their own cannot have supports"),
        ({"spiral": True}, "a spiral has no layers of its own for features"),
        ({"planner__max_layers": 100}, "the number of layers cannot be limited for features"),
    ],
)
def test_what_features_cannot_have_is_refused(changes: dict[str, Any], problem: str) -> None:
    with pytest.raises(ProfileError, match=problem):
        optimal(**changes)


RANGES = "4:6:tolerance=0.04; 9:20:tolerance=0.3"


def test_features_keep_height_ranges_of_the_profile() -> None:
    part, profile = slice_stages(towers(), plain()).part, optimal(planner__ranges=RANGES)
    plan_features = prepare_feature_plans(part, profile)
    assert plan_features
    stacks = plan_features({})
    assert len(stacks) == 3
    for one in stacks:
        inside = (one.plan.bottom >= 4 - ROUNDING) & (one.plan.top <= 6 + ROUNDING)
        certificate = certify_stacks([one])
        assert (certificate.bound[inside] <= 0.04 + ROUNDING).all()
        if one.outline:
            assert all(np.abs(one.plan.top - z).min() < ROUNDING for z in (4, 6, 9))


def test_a_range_with_a_layer_height_has_no_ends_of_features() -> None:
    part = slice_stages(towers(), plain()).part
    for low, is_kept in ((1.0, False), (2.0, True), (3.0, True)):
        profile = optimal(planner__ranges=f"{low}:6:layer_height=0.2")
        assert (prepare_feature_plans(part, profile) is not None) == is_kept


def test_features_are_printed_with_the_settings_of_their_object() -> None:
    part = slice_stages(towers(), plain()).part
    profile = optimal(overrides="towers:perimeters=3")
    plan_features = prepare_feature_plans(part, profile)
    assert plan_features
    stages = slice_stages(part, profile, plan=plan_features({}))
    three = slice_stages(part, optimal(perimeters=3), plan=stages.stacks)
    assert stages.program.filament.sum() == pytest.approx(three.program.filament.sum())


def test_a_warning_says_why_there_are_no_features(tmp_path: Path) -> None:
    (tmp_path / "towers.stl").write_bytes(binary_stl(towers().triangles))
    (tmp_path / "box.stl").write_bytes(binary_stl(box((5, 5, 5), at=(25, 25, 4)).triangles))
    options = ("--planner", "optimal", "--set", "planner.stacks=features")
    for command, out in (("slice", ("-o", "out.gcode")), ("plan", ())):
        several = typed(command, "towers.stl", "box.stl", "--arrange", *options, *out, cwd=tmp_path)
        modified = typed(command, "towers.stl", "--modifier", "box.stl", *options, *out, cwd=tmp_path)
        assert "planner.stacks = features has no effect on a plate with several objects" in several.err
        assert "planner.stacks = features has no effect on a part with modifiers" in modified.err


def test_slice_reports_features_and_check_compares_each_on_its_own_layers(tmp_path: Path) -> None:
    (tmp_path / "towers.stl").write_bytes(binary_stl(towers(roof=2.0).triangles))
    options = ("--planner", "optimal", "--set", "planner.stacks=features", "--set", "planner.error_price=200")
    sliced = typed("slice", "towers.stl", *options, "-o", "out.gcode", cwd=tmp_path)
    checked = typed("check", "out.gcode", "--model", "towers.stl", cwd=tmp_path)
    planned = typed("plan", "towers.stl", *options, "--picture", "out.svg", cwd=tmp_path)
    simulated = typed("dry-run", "out.gcode", "--allow", "unsupported", cwd=tmp_path)

    assert "towers, z 2 to 13.5, feature 2: " in sliced.out
    assert "towers, z 2 to 13.5, feature 2 " in planned.out
    assert "flat surface" not in sliced.out
    assert [sliced.code, planned.code, simulated.code] == [0, 0, 0]
    assert "features have layers of their own" in checked.out
    assert "not reliable" not in checked.out
