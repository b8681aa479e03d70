"""Parts are turned so that they print well: the same way for any turn in the file, and safely."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import printer_slicer as ps
from printer_slicer.arrays import Float
from printer_slicer.deviation import measure_deviation
from printer_slicer.geometry.vectors import norm
from printer_slicer.orienting.cost_model import CostModel
from printer_slicer.orienting.directions import list_directions, spread_directions
from printer_slicer.orienting.part_shape import measure_shape
from printer_slicer.orienting.ratings import rate_frame
from printer_slicer.orienting.rough_ratings import rate_roughly
from printer_slicer.orienting.stability import is_stable, make_frame, may_stand, measure_standing
from printer_slicer.orienting.turning import find_angles, find_upright_frame, turn_for_infill, turn_mesh
from printer_slicer.profile import profile_with
from tests.parts import box, box_with_hole, cone, joined, pyramid, sheared_prism, sphere
from tests.supports.shapes import bracket, hook, mushroom, table, tee

PROFILE = ps.load_profile("marlin_220", quality="standard")
SLAB = measure_shape(box((30, 20, 5)).triangles)
SUPPORTED = profile_with(PROFILE, {"quality.support": "auto"})
BRACE = ps.Mesh(
    joined([box((40, 12, 4)), box((4, 12, 25)), box((9, 5, 9), at=(20, 2, 4))]).triangles, "brace"
)
SHAPES: list[Callable[[], ps.Mesh]] = [tee, hook, bracket, table, mushroom, lambda: BRACE]


def rotation(seed: int) -> Float:
    """A random rotation matrix."""
    matrix, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    return np.asarray(matrix * np.sign(np.linalg.det(matrix)))


def rotated(mesh: ps.Mesh, matrix: Float) -> ps.Mesh:
    return ps.Mesh(mesh.triangles @ matrix.T, mesh.name)


def matrix_of(angles: tuple[float, float, float]) -> Float:
    """The matrix by which `transform` rotates."""
    axes = ps.Mesh(np.eye(3)[None], "axes")
    return ps.transform(axes, rotate=angles).triangles[0].T


# Bodies


@pytest.mark.parametrize("mesh", [box((20, 10, 5)), BRACE, cone(), sphere(), sheared_prism()])
def test_a_body_has_the_area_volume_and_size_of_its_part(mesh: ps.Mesh) -> None:
    shape = measure_shape(mesh.triangles)
    a, b, c = mesh.triangles.transpose(1, 0, 2)

    assert shape.volume == pytest.approx(mesh.volume, rel=1e-4)
    assert shape.area == pytest.approx(norm(np.cross(b - a, c - a)).sum() / 2, rel=1e-4)
    assert shape.axes @ shape.axes.T == pytest.approx(np.eye(3), abs=1e-9)
    assert np.linalg.det(shape.axes) == pytest.approx(1)
    assert (shape.samples.normals * shape.samples.area).sum(axis=1) == pytest.approx(np.zeros(3), abs=0.1)
    assert np.ptp(shape.hull @ shape.axes, axis=0) == pytest.approx(mesh.size, rel=0.01)


@pytest.mark.parametrize("seed", range(4))
def test_a_turned_part_has_the_same_body(seed: int) -> None:
    one, other = (measure_shape(mesh.triangles) for mesh in (BRACE, rotated(BRACE, rotation(seed))))

    assert other.axes @ rotation(seed) == pytest.approx(one.axes, abs=1e-4)
    assert other.center == pytest.approx(one.center, abs=1e-3)


def test_inverted_facets_make_no_difference() -> None:
    one, other = (measure_shape(triangles) for triangles in (BRACE.triangles, BRACE.triangles[:, ::-1]))

    assert other.volume == pytest.approx(one.volume)
    assert (other.samples.normals[2] @ other.samples.area) == pytest.approx(0, abs=0.1)
    assert rate_frame(other, other.axes.T, PROFILE, CostModel(PROFILE)).overhang == pytest.approx(
        rate_frame(one, one.axes.T, PROFILE, CostModel(PROFILE)).overhang, rel=0.02
    )


# Directions and rotations


def test_directions_are_unit_vectors_that_include_all_flats() -> None:
    shape = measure_shape(BRACE.triangles)
    down = list_directions(shape)

    assert norm(down) == pytest.approx(1)
    assert len(down) > 200
    for flat in np.concatenate([np.eye(3), -np.eye(3)]):
        assert (down @ (shape.axes @ flat)).max() == pytest.approx(1, abs=1e-5)


def test_spread_directions_leave_no_gap() -> None:
    spread, anywhere = spread_directions(200), spread_directions(977)

    assert np.degrees(np.arccos((anywhere @ spread.T).max(axis=1))).max() < 12


@given(st.integers(0, 10_000))
def test_angles_give_the_rotation_back(seed: int) -> None:
    assert matrix_of(find_angles(rotation(seed))) == pytest.approx(rotation(seed), abs=1e-7)


@pytest.mark.parametrize(
    "angles", [(0, 90, 0), (0, -90, 0), (90, 90, 0), (180, 0, 0), (0, 0, 0), (0, 180, 45)]
)
def test_angles_of_quarter_turns_give_the_rotation_back(angles: tuple[float, float, float]) -> None:
    assert matrix_of(find_angles(matrix_of(angles))) == pytest.approx(matrix_of(angles), abs=1e-12)


@given(st.integers(0, 10_000))
def test_a_frame_is_a_rotation_with_the_longest_side_along_x(seed: int) -> None:
    shape, down = measure_shape(BRACE.triangles), rotation(seed)[0]
    frame = find_upright_frame(shape, down)
    size = np.ptp(shape.hull @ frame.T, axis=0)

    assert frame @ frame.T == pytest.approx(np.eye(3), abs=1e-9)
    assert np.linalg.det(frame) == pytest.approx(1)
    assert frame[2] == pytest.approx(-down)
    assert size[0] >= size[1] - 1e-6


# Standing


@pytest.mark.parametrize(
    ("mesh", "stands", "tilt"),
    [
        (box((20, 20, 20)), True, 45),
        (box((4, 4, 60)), False, 3.8),
        (sheared_prism(), False, -27),
        (rotated(pyramid(), np.diag([1.0, -1.0, -1.0])), False, 0),
        (
            ps.Mesh(
                joined(
                    [box((4, 4, 20)), box((4, 4, 20), at=(30, 0, 0)), box((34, 4, 4), at=(0, 0, 20))]
                ).triangles
            ),
            True,
            7,
        ),
    ],
    ids=["box", "post", "leaning", "on its tip", "bridge"],
)
def test_a_part_stands_by_the_hull_of_its_foot_and_its_centre_of_mass(
    mesh: ps.Mesh, stands: bool, tilt: float
) -> None:
    shape = measure_shape(mesh.triangles)
    found = measure_standing(shape, shape.axes.T, 0.0)

    assert found.is_stable == stands
    assert found.tilt_deg == pytest.approx(tilt, abs=2)


def test_a_brim_holds_a_slim_part() -> None:
    shape = measure_shape(box((4, 4, 60)).triangles)

    assert measure_standing(shape, shape.axes.T, 5.0).is_stable


@pytest.mark.parametrize("make", SHAPES)
def test_no_stable_direction_is_missed_by_the_check_of_all_at_once(make: Callable[[], ps.Mesh]) -> None:
    shape = measure_shape(make().triangles)
    down = list_directions(shape)
    may = may_stand(shape, down, 0.0)
    stable = np.array([is_stable(shape, one, 0.0) for one in down])

    assert stable.any()
    assert (may >= stable).all()
    assert may.sum() < len(down)


# Ratings


@pytest.mark.parametrize("make", [tee, bracket, mushroom, lambda: BRACE, lambda: cone(10, 20), box_with_hole])
def test_estimates_resemble_what_slicing_measures(make: Callable[[], ps.Mesh]) -> None:
    mesh = make()
    shape = measure_shape(mesh.triangles)
    rated = rate_frame(shape, shape.axes.T, PROFILE, CostModel(PROFILE))
    stages = ps.slice_stages(mesh, SUPPORTED)
    minutes = ps.move_seconds(stages.program, SUPPORTED).sum() / 60

    assert rated.minutes == pytest.approx(minutes, rel=0.35)
    assert stages.overhangs is not None
    assert rated.overhang == pytest.approx(float(stages.overhangs.area.area().sum()), rel=0.3, abs=20)


def test_the_deviation_of_slopes_is_that_of_their_stairs() -> None:
    part = pyramid(20, 20)
    stages = ps.slice_stages(part, PROFILE)
    shape = measure_shape(part.triangles)
    rated = rate_frame(shape, shape.axes.T, PROFILE, CostModel(PROFILE))

    assert rated.deviation == pytest.approx(
        measure_deviation(stages.part, stages.sections, 8000).mean, rel=0.15
    )


def test_supports_land_on_the_part_and_bridges_need_none() -> None:
    def rate(mesh: ps.Mesh) -> ps.Orientation:
        shape = measure_shape(mesh.triangles)
        return rate_frame(shape, shape.axes.T, PROFILE, CostModel(PROFILE))

    def roofed(span: float) -> ps.Mesh:
        walls = [box((4, 30, 40)), box((4, 30, 40), at=(4 + span, 0, 0))]
        return ps.Mesh(joined([*walls, box((8 + span, 30, 2), at=(0, 0, 40))]).triangles)

    over_the_bed, over_a_step = (
        ps.Mesh(joined([box((4, 30, 40)), box((34, 30, 2), at=(0, 0, 40)), *more]).triangles)
        for more in ([], [box((30, 30, 30), at=(4, 0, 0))])
    )

    assert rate(roofed(8)).support_g == 0
    assert rate(roofed(30)).support_g > 1
    assert rate(over_a_step).support_g < 0.4 * rate(over_the_bed).support_g


@pytest.mark.parametrize("make", SHAPES)
def test_rough_ratings_rank_directions_nearly_as_better_ones(make: Callable[[], ps.Mesh]) -> None:
    shape, cost_model = measure_shape(make().triangles), CostModel(PROFILE)
    down = list_directions(shape)
    down = down[may_stand(shape, down, 0.0)]
    rough = rate_roughly(shape, down, cost_model)
    better = np.array(
        [rate_frame(shape, find_upright_frame(shape, one), PROFILE, cost_model).cost for one in down]
    )

    assert better[np.argsort(rough)[:12]].min() <= 1.01 * better.min()


# Answers


@pytest.mark.parametrize(
    ("make", "height"),
    [(lambda: box((40, 20, 6)), 6), (lambda: box((6, 20, 40)), 6), (tee, 10), (bracket, 40)],
    ids=["tile", "upright tile", "tee", "bracket"],
)
def test_obvious_parts_are_turned_as_everyone_would(make: Callable[[], ps.Mesh], height: float) -> None:
    assert ps.orient(make(), PROFILE).height <= height + 1e-6


@pytest.mark.parametrize("make", [table, mushroom])
def test_a_part_with_a_wide_top_is_printed_upside_down(make: Callable[[], ps.Mesh]) -> None:
    found = ps.find_orientations(make(), PROFILE).chosen

    assert matrix_of(found.rotate)[2, 2] == pytest.approx(-1)
    assert found.support_g == pytest.approx(0, abs=0.05)


@pytest.mark.parametrize("make", SHAPES)
@pytest.mark.parametrize("seed", range(3))
def test_the_answer_does_not_depend_on_the_turn_in_the_file(make: Callable[[], ps.Mesh], seed: int) -> None:
    mesh = make()
    usual = ps.find_orientations(mesh, PROFILE).rows[0]
    found = ps.find_orientations(rotated(mesh, rotation(seed)), PROFILE).chosen

    # Turns about z with equally many ends of infill lines differ by a percent; rounding decides between them.
    assert found.cost == pytest.approx(usual.cost, rel=0.02)
    assert found.height == pytest.approx(usual.height, abs=0.05)
    assert found.contact_area == pytest.approx(usual.contact_area, rel=0.02)


@pytest.mark.parametrize("seed", range(4))
def test_a_part_without_symmetry_gets_the_same_place_from_any_turn(seed: int) -> None:
    usual = ps.orient(rotated(BRACE, rotation(99)), PROFILE)
    found = ps.orient(rotated(BRACE, rotation(seed)), PROFILE)
    corners = [mesh.triangles.reshape(-1, 3) - mesh.bounds[0] for mesh in (usual, found)]

    assert corners[1] == pytest.approx(corners[0], abs=0.02)


def test_a_part_that_is_almost_right_stays_as_it_is() -> None:
    part = box((20, 20, 20), at=(5, 6, 7))
    found = ps.find_orientations(part, PROFILE)

    assert found.chosen is found.original
    assert ps.orient(part, PROFILE) is part


def test_a_turned_part_stands_on_the_bed_above_the_same_place() -> None:
    part = tee().moved((30, 40, 5))
    turned = ps.orient(part, PROFILE)

    assert turned.bounds[0, 2] == pytest.approx(0, abs=1e-9)
    assert turned.bounds.mean(axis=0)[:2] == pytest.approx(part.bounds.mean(axis=0)[:2])
    assert turned.volume == pytest.approx(part.volume)


@pytest.mark.parametrize("keep_up", [0, 30, 95])
def test_the_upper_side_stays_up(keep_up: float) -> None:
    found = ps.find_orientations(table(), PROFILE, keep_up=keep_up)
    tilts = [np.degrees(np.arccos(np.clip(matrix_of(row.rotate)[2, 2], -1, 1))) for row in found.rows]

    assert max(tilts) <= keep_up + 0.01


def test_a_part_that_falls_over_is_turned_although_that_costs_more() -> None:
    part = rotated(pyramid(), np.diag([1.0, -1.0, -1.0]))
    found = ps.find_orientations(part, PROFILE)

    assert not found.original.is_usable
    assert found.chosen.is_usable
    assert all(row.is_stable for row in found.rows if row.is_usable)


def test_a_part_that_is_too_long_for_the_bed_is_set_upright() -> None:
    part = box((245, 80, 70))
    found = ps.find_orientations(part, PROFILE)

    assert not found.original.fits
    assert found.chosen.fits
    assert ps.orient(part, PROFILE).height == pytest.approx(245)


def test_a_part_longer_than_the_bed_lies_across_it() -> None:
    turned = ps.orient(box((230, 70, 60)), PROFILE)
    assert turned.height == pytest.approx(60)
    assert turned.size[:2] == pytest.approx(300 / np.sqrt(2))


def test_walls_are_turned_to_lie_along_or_across_lines_of_infill() -> None:
    for angle, size in ((45.0, 50 / np.sqrt(2)), (0.0, 30.0), (90.0, 30.0)):
        own = profile_with(PROFILE, {"infill_angle_deg": angle})
        frame = find_upright_frame(SLAB, np.array([0.0, 0.0, -1.0]))
        turned = turn_for_infill(SLAB, frame, own.quality.infill_angle_deg)
        assert np.ptp(SLAB.hull @ turned.T, axis=0)[0] == pytest.approx(size)


def test_the_estimate_does_not_depend_on_the_turn_about_z() -> None:
    shape = measure_shape(BRACE.triangles)
    frame, cost_model = np.eye(3), CostModel(PROFILE)
    c, s = np.sqrt([0.3, 0.7])
    turned = np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) @ frame
    costs = [rate_frame(shape, one, PROFILE, cost_model).cost for one in (frame, turned)]
    assert costs[1] == pytest.approx(costs[0], rel=0.01)


def test_prices_decide_between_support_and_surface() -> None:
    part = cone(12, 30, 96)
    smooth = profile_with(PROFILE, {"quality.surface_price": 1000})
    rows = ps.find_orientations(rotated(part, rotation(1)), smooth).rows

    assert rows[0].deviation == min(row.deviation for row in rows if row.is_usable)


def test_objects_are_turned_together() -> None:
    plate = ps.join([box((30, 8, 20)), box((10, 10, 20), at=(40, 0, 0))])
    turned = turn_mesh(plate, (90.0, 0.0, 0.0))

    assert [one.name for one in turned.objects] == [one.name for one in plate.objects]
    assert turned.objects[0].high[2] == pytest.approx(8)


def test_a_frame_of_any_direction_points_up() -> None:
    for down in spread_directions(50):
        frame = make_frame(down)
        assert frame @ frame.T == pytest.approx(np.eye(3), abs=1e-12)
        assert np.linalg.det(frame) == pytest.approx(1)
