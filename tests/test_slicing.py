"""Sections of known bodies: against formulas, against trimesh, at awkward heights, with faults in the mesh."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.arrays import Float
from printer_slicer.errors import MeshError, PartError
from printer_slicer.geometry.engine import ENGINES, using_engine
from printer_slicer.geometry.plane_sections import section_areas
from printer_slicer.model import LayerPlan, Mesh, Sections
from printer_slicer.placing import transform
from printer_slicer.slicing import contours, cut, find_gaps
from tests.parts import (
    box,
    box_with_hole,
    case_study,
    cone,
    fin_on_a_box,
    joined,
    layers,
    prism,
    pyramid,
    shape,
    shapely,
    sheared_prism,
    sphere,
    sphere_area,
    step_pyramid,
    two_boxes,
    without,
)

BODIES = [
    box(),
    pyramid(),
    cone(),
    sphere(),
    case_study(),
    sheared_prism(),
    box_with_hole(),
    two_boxes(),
    step_pyramid([20, 12, 5], [3, 2, 4]),
]
each_body = pytest.mark.parametrize("mesh", BODIES, ids=lambda mesh: mesh.name)
engines = pytest.mark.parametrize("engine", list(ENGINES))


def planes(*cuts: float) -> LayerPlan:
    """A plan that cuts the mesh at these heights; where its layers end does not matter here."""
    heights = np.array(cuts)
    return LayerPlan(heights + 1e-3, heights)


def even(mesh: Mesh, n_layers: int) -> LayerPlan:
    return LayerPlan.from_tops(mesh.height * np.arange(1, n_layers + 1) / n_layers)


def areas_at(mesh: Mesh, *cuts: float) -> Float:
    return cut(mesh, planes(*cuts), 0.0).solid.area()


# --- against formulas ---


def test_every_section_of_a_box_is_its_foot() -> None:
    assert areas_at(box((7, 9, 4)), 0.001, 1, 2.5, 3.999) == pytest.approx([63] * 4, abs=1e-9)


def test_sections_of_a_pyramid_shrink_with_the_square_of_the_distance_to_the_tip() -> None:
    heights = np.linspace(0.1, 19.5, 50)

    assert areas_at(pyramid(), *heights) == pytest.approx((20 - heights) ** 2, abs=1e-3)


def test_sections_of_a_sphere_are_polygons_of_the_radius_between_its_parallels() -> None:
    heights = np.linspace(0.05, 19.9, 60)

    assert areas_at(sphere(), *heights) == pytest.approx([sphere_area(z) for z in heights], abs=2e-3)


@each_body
def test_areas_without_contours_are_the_areas_of_the_contours(mesh: Mesh) -> None:
    plan = even(mesh, 37)

    assert section_areas(mesh.triangles, plan.cut) == pytest.approx(
        cut(mesh, plan, 0.0).solid.area(), abs=2e-3
    )


@each_body
def test_slabs_have_the_volume_of_the_mesh(mesh: Mesh) -> None:
    """Between two levels of corners the area is a quadratic in z, which two points a slab integrate exactly."""
    levels = np.unique(mesh.triangles[:, :, 2])
    low, high = levels[:-1], levels[1:]
    middle, reach = (low + high) / 2, (high - low) / 2 / np.sqrt(3)

    areas = section_areas(mesh.triangles, np.column_stack([middle - reach, middle + reach]).ravel())

    assert areas.reshape(-1, 2).mean(axis=1) @ (high - low) == pytest.approx(mesh.volume, rel=1e-9)


@each_body
def test_the_sum_of_layers_approaches_the_volume(mesh: Mesh) -> None:
    plan = even(mesh, 120)

    assert cut(mesh, plan, 0.0125).solid.area() @ plan.height == pytest.approx(mesh.volume, rel=5e-3)


# --- against trimesh ---


def trimesh_area(mesh: Mesh, z: float) -> float:
    corners, index = np.unique(mesh.triangles.reshape(-1, 3), axis=0, return_inverse=True)
    body: Any = trimesh.Trimesh(corners, index.reshape(-1, 3), process=False)
    section = body.section(plane_origin=[0, 0, z], plane_normal=[0, 0, 1])
    if section is None:
        return 0.0
    outlines = [shapely.Polygon(np.asarray(line)[:, :2]) for line in section.discrete]
    result = shapely.Polygon()
    for outline in outlines:
        result = shapely.symmetric_difference(result, outline)
    return float(shapely.area(result))


@each_body
def test_areas_are_those_of_trimesh(mesh: Mesh) -> None:
    heights = (np.arange(7) + 0.4321) / 7 * mesh.height

    assert areas_at(mesh, *heights) == pytest.approx([trimesh_area(mesh, z) for z in heights], abs=2e-3)


angles = st.floats(0, 6.28)


def rotation(a: float, b: float, c: float) -> Float:
    def about(axis: int, angle: float) -> Float:
        turn = np.eye(3)
        i, j = [(1, 2), (2, 0), (0, 1)][axis]
        turn[i, i] = turn[j, j] = np.cos(angle)
        turn[i, j], turn[j, i] = -np.sin(angle), np.sin(angle)
        return turn

    return about(2, a) @ about(0, b) @ about(2, c)


def on_bed(triangles: Float) -> Mesh:
    return Mesh(triangles - np.array([0, 0, triangles[:, :, 2].min()]))


@given(
    body=st.sampled_from([0, 2, 3, 6, 8]), turn=st.tuples(angles, angles, angles), shift=st.floats(-300, 300)
)
def test_turned_and_shifted_bodies_have_the_areas_that_trimesh_finds(
    body: int, turn: tuple[float, float, float], shift: float
) -> None:
    mesh = on_bed(BODIES[body].triangles @ rotation(*turn).T + shift)
    heights = (np.arange(3) + 0.4321) / 3 * mesh.height

    assert section_areas(mesh.triangles, heights) == pytest.approx(
        [trimesh_area(mesh, z) for z in heights], abs=1e-5 * mesh.size.max()
    )
    assert areas_at(mesh, *heights) == pytest.approx(section_areas(mesh.triangles, heights), abs=5e-3)


@given(turn=angles, x=st.floats(-1000, 1000), y=st.floats(-1000, 1000))
def test_sections_do_not_change_when_the_part_is_turned_about_z_and_shifted(
    turn: float, x: float, y: float
) -> None:
    plan = even(box_with_hole(), 5)
    moved = Mesh(box_with_hole().triangles @ rotation(turn, 0, 0).T).moved((x, y, 0))

    assert cut(moved, plan, 0.0).solid.area() == pytest.approx(
        cut(box_with_hole(), plan, 0.0).solid.area(), abs=5e-3
    )


@given(seed=st.integers(0, 1000))
def test_the_order_of_facets_and_of_their_corners_does_not_matter(seed: int) -> None:
    rng = np.random.default_rng(seed)
    mesh = BODIES[seed % len(BODIES)]
    shuffled = mesh.triangles[rng.permutation(mesh.n_facets)]
    rolled = np.stack([np.roll(facet, rng.integers(3), axis=0) for facet in shuffled])
    plan = even(mesh, 9)

    first, second = cut(mesh, plan, 0.0), cut(Mesh(rolled), plan, 0.0)

    assert second.solid.n_rings == first.solid.n_rings
    assert second.solid.area() == pytest.approx(first.solid.area(), abs=1e-6)


# --- planes at awkward heights ---


def test_a_plane_through_a_flat_takes_the_section_below_it() -> None:
    mesh = step_pyramid([20, 12, 5], [3, 2, 4])

    assert areas_at(mesh, 1, 3, 4, 5, 6, 9) == pytest.approx([400, 400, 144, 144, 25, 25])


def test_a_plane_through_corners_and_edges_gives_closed_contours() -> None:
    mesh = case_study()

    crossed = cut(mesh, planes(30.0, 52.5, 82.5), 0.0)

    assert crossed.solid.area() == pytest.approx([2500, 25, 25])
    assert crossed.open_edges == 0
    assert crossed.gaps == ()


def test_planes_on_every_parallel_of_a_sphere_meet_its_corners() -> None:
    levels = np.unique(sphere().triangles[:, :, 2])[1:]

    assert areas_at(sphere(), *levels) == pytest.approx([sphere_area(z) for z in levels], abs=1e-3)


def test_there_is_nothing_at_the_foot_and_over_the_top() -> None:
    assert section_areas(box().triangles, np.array([-1.0, 0.0, 10.0, 10.1])).tolist() == [0, 0, 100, 0]


def test_a_tip_in_a_plane_adds_no_area() -> None:
    heights = np.array([19.999999, 20.0, 20.1])

    assert section_areas(pyramid().triangles, heights) == pytest.approx([0, 0, 0], abs=1e-9)


def test_an_edge_in_a_plane_adds_no_area() -> None:
    """A roof: its ridge is one edge, and its eaves lie in a plane."""
    roof = Mesh(_roof())

    assert section_areas(roof.triangles, np.array([5.0, 10.0])) == pytest.approx([50, 0])
    assert areas_at(roof, 5.0) == pytest.approx([50])


def _roof() -> Float:
    foot = [(0, 0, 0), (10, 0, 0), (10, 10, 0), (0, 10, 0)]
    ridge = [(0, 5, 10), (10, 5, 10)]
    a, b, c, d = foot
    left, right = ridge
    facets = [
        (a, c, b),
        (a, d, c),
        (a, b, right),
        (a, right, left),
        (c, d, left),
        (c, left, right),
        (b, c, right),
        (d, a, left),
    ]
    return np.array(facets, dtype=np.float64)


def test_minus_zero_is_zero() -> None:
    """Mirrored parts have -0.0 in some corners and 0.0 in others."""
    triangles = box().triangles.copy()
    corners = triangles[::2]
    corners[corners == 0] = -0.0

    section = cut(Mesh(triangles), planes(2.0), 0.0)

    assert section.open_edges == 0
    assert section.solid.area() == pytest.approx([100])


# --- shells ---


@engines
@pytest.mark.parametrize(
    ("parts", "area", "n_rings"),
    [
        ([box(), box()], 100, 1),
        ([box(), box(at=(10, 0, 0))], 200, 1),
        ([box(), box(at=(5, 5, 0))], 175, 1),
        ([box(), box((4, 4, 10), (3, 3, 0))], 100, 1),
        ([box(), box(at=(10, 10, 0))], 200, None),
        ([box(), box(at=(30, 0, 0))], 200, 2),
    ],
    ids=["coincident", "side by side", "overlapping", "one in the other", "corner to corner", "apart"],
)
def test_shells_count_once_where_they_meet(
    engine: str, parts: list[Mesh], area: float, n_rings: int | None
) -> None:
    with using_engine(engine):
        section = cut(joined(parts), planes(3.0, 7.0), 0.0125)

    assert section.solid.area() == pytest.approx([area, area], abs=1e-3)
    assert section.open_edges == 0
    if n_rings is not None:
        assert section.solid.n_rings == 2 * n_rings


def stem_and_slab(gap: float = 0.0) -> Mesh:
    """A slab on a thinner stem, `gap` apart: two bodies."""
    return joined([box((6.0, 6.0, 10.0), (7.0, 2.0, 0.0)), box((20.0, 10.0, 4.0), (0.0, 0.0, 10.0 + gap))])


@pytest.mark.parametrize("seed", range(6))
def test_touching_bodies_have_no_slits_between_them_in_any_turn(seed: int) -> None:
    angles = np.random.default_rng(seed).uniform(-180, 180, 3)
    turned = transform(stem_and_slab(), rotate=(angles[0], angles[1], angles[2]))
    stored = turned.triangles.astype(np.float32).astype(np.float64)  # as in an STL file
    mesh = Mesh(stored - (0.0, 0.0, turned.bounds[0, 2]), "turned")

    solid = cut(mesh, even(mesh, 60), 0.0125).solid

    for layer in range(solid.n_layers):
        found = shape(solid, layer)
        closed = found.buffer(0.02, join_style="mitre").buffer(-0.02, join_style="mitre")
        assert found.length <= closed.length + 0.5


def test_bodies_that_do_not_touch_stay_apart() -> None:
    mesh = transform(stem_and_slab(0.05), rotate=(90.0, 0.0, 0.0))
    solid = cut(mesh, even(mesh, 20), 0.0125).solid

    assert np.bincount(solid.ring_layer).max() == 2


def test_a_shell_turned_inside_out_within_another_is_a_hole() -> None:
    inner = box((4, 4, 8), (3, 3, 1))
    hollow = joined([box(), Mesh(inner.triangles[:, ::-1])])

    section = cut(hollow, planes(0.5, 5.0, 9.5), 0.0125)

    assert section.solid.area() == pytest.approx([100, 84, 100])
    assert section.solid.ring_area() == pytest.approx([100, 100, -16, 100])


@engines
@each_body
def test_outer_rings_run_counter_clockwise_and_holes_clockwise(engine: str, mesh: Mesh) -> None:
    with using_engine(engine):
        solid = cut(mesh, even(mesh, 11), 0.0125).solid

    for layer in range(solid.n_layers):
        exact = shape(solid, layer)
        holes = sum(len(part.interiors) for part in shapely.get_parts(exact))
        signs = np.sign(
            [area for area, k in zip(solid.ring_area(), solid.ring_layer, strict=True) if k == layer]
        )
        assert (signs < 0).sum() == holes
        assert shapely.area(exact) == pytest.approx(solid.area()[layer])


def test_simplified_contours_stay_within_the_resolution() -> None:
    fine = cone(10.0, 20.0, 720)
    plan = even(fine, 6)
    exact, coarse = cut(fine, plan, 0.0), cut(fine, plan, 0.05)

    assert len(coarse.solid.xy) < 0.3 * len(exact.solid.xy)
    for layer in range(5):
        assert (
            shapely.hausdorff_distance(shape(exact.solid, layer), shape(coarse.solid, layer)) <= 0.05 + 1e-4
        )


# --- the paper's contours ---


def test_the_raw_contour_of_the_case_study_at_9_mm_has_one_segment_for_each_facet_of_the_walls() -> None:
    raw = contours(case_study(), planes(9.0))

    assert raw.segments.shape == (8, 2, 2)
    assert raw.segment_layer.tolist() == [0] * 8
    assert np.hypot(*(raw.segments[:, 1] - raw.segments[:, 0]).T).sum() == pytest.approx(200)


def test_segments_have_the_solid_on_their_left() -> None:
    raw = contours(case_study(), planes(9.0))

    tail, head = raw.segments[:, 0], raw.segments[:, 1]
    assert (tail[:, 0] * head[:, 1] - tail[:, 1] * head[:, 0] > 0).all()
    assert (tail[:, 0] * head[:, 1] - tail[:, 1] * head[:, 0]).sum() / 2 == pytest.approx(2500)


def test_the_joined_contour_keeps_every_point_and_the_repaired_one_only_corners() -> None:
    paper = contours(case_study(), planes(9.0))

    assert len(paper.joined.xy) == 8
    assert paper.joined.area() == pytest.approx([2500])
    assert sorted(paper.repaired.xy.tolist()) == [[-25, -25], [-25, 25], [25, -25], [25, 25]]
    assert paper.repaired.area() == pytest.approx([2500])


@each_body
def test_all_stages_of_the_contours_have_one_area_and_length(mesh: Mesh) -> None:
    plan = even(mesh, 13)
    paper = contours(mesh, plan)
    tail, head = paper.segments[:, 0], paper.segments[:, 1]

    signed = (tail[:, 0] * head[:, 1] - tail[:, 1] * head[:, 0]) / 2
    assert np.bincount(paper.segment_layer, signed, minlength=13) == pytest.approx(
        paper.joined.area(), abs=1e-9
    )
    assert paper.joined.area() == pytest.approx(paper.repaired.area(), abs=1e-6)
    assert np.hypot(*(head - tail).T).sum() == pytest.approx(paper.joined.ring_length().sum())
    assert paper.joined.ring_length().sum() == pytest.approx(paper.repaired.ring_length().sum())
    assert len(paper.joined.xy) == len(paper.segments)


@each_body
def test_every_segment_is_a_side_of_its_joined_ring(mesh: Mesh) -> None:
    paper = contours(mesh, even(mesh, 3))
    following = np.roll(np.arange(len(paper.joined.xy)), -1)
    following[paper.joined.ring_start[1:] - 1] = paper.joined.ring_start[:-1]
    sides = np.stack([paper.joined.xy, paper.joined.xy[following]], axis=1)

    assert sorted(sides.reshape(-1, 4).tolist()) == sorted(paper.segments.reshape(-1, 4).tolist())


# --- faults in the mesh ---


def test_a_missing_facet_of_a_closed_part_is_counted_and_placed() -> None:
    mesh = sphere(1.5)
    facet = mesh.n_facets // 2
    low, high = np.sort(mesh.triangles[facet, :, 2])[[0, 2]]
    middle = mesh.triangles[facet].mean(axis=0)

    edges, gaps = find_gaps(without(mesh, facet), layers(59, 0.05))

    assert edges == len(np.unique(np.round(mesh.triangles[facet, :, 2], 9)))
    assert gaps
    assert all(low <= gap.z <= high for gap in gaps)
    assert all(np.hypot(gap.x - middle[0], gap.y - middle[1]) < 0.5 for gap in gaps)
    assert [gap.width for gap in gaps] == sorted((gap.width for gap in gaps), reverse=True)
    assert gaps[0].width <= 0.5


def test_a_crack_is_closed_and_told() -> None:
    mesh = sphere(1.5)
    plan = layers(59, 0.05)
    whole, cracked = cut(mesh, plan, 0.0), cut(without(mesh, mesh.n_facets // 2), plan, 0.0)

    assert whole.open_edges == 0
    assert whole.gaps == ()
    assert cracked.open_edges > 0
    assert len(cracked.gaps) > 0
    assert cracked.solid.area() == pytest.approx(whole.solid.area(), abs=0.03)


def test_a_contour_of_which_a_third_is_missing_is_closed_and_more_is_refused_with_its_place() -> None:
    def opened(depth: float) -> Mesh:
        mesh = box((depth, 20, 10))
        return without(mesh, *np.flatnonzero((mesh.triangles[:, :, 0] == depth).all(axis=1)).tolist())

    section = cut(opened(10), layers(50, 0.2), 0.0125)
    with pytest.raises(MeshError, match=r"surface is open.*mm at x 9\.00 y 10\.00 z \d+\.\d+") as caught:
        cut(opened(9), layers(50, 0.2), 0.0125)

    assert section.solid.area() == pytest.approx([200] * 50)
    assert len(section.gaps) == 50
    assert section.gaps[0].width == pytest.approx(20)
    assert "20 mm" in str(caught.value)
    assert "Close the mesh" in caught.value.remedy


def test_a_missing_top_does_not_matter_for_sections() -> None:
    """No plane crosses a horizontal facet, so contours close without it."""
    mesh = box()
    top = np.flatnonzero((mesh.triangles[:, :, 2] == 10).all(axis=1))

    assert areas_at(without(mesh, *top.tolist()), 1.0, 9.0) == pytest.approx([100, 100])


def test_a_facet_that_faces_the_wrong_way_is_counted() -> None:
    mesh = box((0.9, 0.9, 0.9))
    flipped = mesh.triangles.copy()
    wall = int(np.flatnonzero((flipped[:, :, 0] == 0.9).all(axis=1))[0])
    flipped[wall] = flipped[wall, ::-1]

    section = cut(Mesh(flipped), planes(0.2, 0.5, 0.8), 0.0)

    assert section.open_edges > 0


def test_corners_that_differ_by_rounding_are_joined() -> None:
    """An STL file in which each facet was rounded on its own: no edge has a neighbour, every contour still closes."""
    rng = np.random.default_rng(1)
    mesh = sphere()
    rough = Mesh(mesh.triangles + rng.uniform(-2e-5, 2e-5, mesh.triangles.shape))
    heights = np.linspace(0.3, 19.5, 8)

    section = cut(rough, planes(*heights), 0.0125)

    assert section.open_edges > 0
    assert section.solid.n_rings == 8
    assert section.solid.area() == pytest.approx([sphere_area(z) for z in heights], rel=2e-3)


def test_an_edge_split_on_one_side_only_leaves_no_gap() -> None:
    """A T-junction: the facet on one side of an edge has a corner in the middle of it."""
    mesh = box()
    facet = int(np.flatnonzero((mesh.triangles[:, :, 0] == 10).all(axis=1))[0])
    a, b, c = mesh.triangles[facet]
    middle = (a + b) / 2
    split = np.concatenate([np.delete(mesh.triangles, facet, axis=0), [[a, middle, c], [middle, b, c]]])

    section = cut(Mesh(split), planes(1.3, 5.0, 8.7), 0.0)

    assert section.solid.area() == pytest.approx([100] * 3, abs=1e-3)
    assert all(gap.width < 1e-9 for gap in section.gaps)


def test_a_sheet_without_thickness_adds_nothing() -> None:
    for resolution in (0.0, 0.0125):
        assert cut(fin_on_a_box(), planes(2.0, 5.0), resolution).solid.area() == pytest.approx([100, 100])


def test_a_part_inside_out_has_no_material_and_this_is_said() -> None:
    with pytest.raises(PartError, match="no layer contains any material") as caught:
        cut(Mesh(box().triangles[:, ::-1]), planes(5.0), 0.0)

    assert "inside out" in caught.value.remedy


def test_planes_beside_the_part_meet_no_material() -> None:
    with pytest.raises(PartError, match="no layer contains any material"):
        cut(box(), planes(11.0, 12.0), 0.0)


def test_layers_without_material_are_empty_and_keep_their_place() -> None:
    floating = joined([box((5, 5, 1)), box((5, 5, 1), (0, 0, 3))])

    section: Sections = cut(floating, planes(0.5, 2.0, 3.5), 0.0)

    assert section.solid.area() == pytest.approx([25, 0, 25])
    assert section.solid.ring_layer.tolist() == [0, 2]


def test_uneven_planes_are_cut_where_they_are() -> None:
    uneven = planes(0.07, 0.08, 0.5, 3.0, 3.0001, 17.3)

    assert cut(pyramid(), uneven, 0.0).solid.area() == pytest.approx((20 - uneven.cut) ** 2, abs=1e-3)


def test_prisms_over_any_convex_outline_keep_their_outline() -> None:
    outline = [(0.0, 0.0), (4.0, 1.0), (5.0, 4.0), (2.0, 6.0), (-1.0, 3.0)]

    solid = cut(prism(outline, 3.0), planes(1.5), 0.0).solid

    assert sorted(solid.xy.tolist()) == sorted([list(point) for point in outline])
