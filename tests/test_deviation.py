"""How far the surface is from the stacked layers: against formulas, against a dense brute force, and moved about."""

from __future__ import annotations

from importlib import import_module
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from printer_slicer.arrays import Float
from printer_slicer.deviation import Deviation, measure_deviation
from printer_slicer.errors import PartError
from printer_slicer.geometry import Areas
from printer_slicer.geometry.segment_index import OutlineIndex, distance_to_segments
from printer_slicer.model import LayerPlan, Mesh, Sections
from printer_slicer.slicing import cut
from tests.effort import examples
from tests.parts import (
    box,
    box_with_hole,
    joined,
    layers,
    loft,
    shape,
    shapely,
    sheared_prism,
    sphere,
    turned,
)
from tests.strategies import clean_areas

KDTree: Any = import_module("scipy.spatial").KDTree  # it has no types


def judged(mesh: Mesh, plan: LayerPlan, n_points: int = 4000, seed: int = 0) -> Deviation:
    return measure_deviation(mesh, cut(mesh, plan, 0.0), n_points, seed)


def wedge(run: float, rise: float, depth: float) -> Mesh:
    """A ramp: `run` long at the foot, `rise` high over its back wall, `depth` wide."""
    side = np.array([(0, 0, 0), (run, 0, 0), (0, 0, rise)], dtype=np.float64)
    other = side + np.array([0, depth, 0])
    walls = [
        facet
        for i, j in ((0, 2), (2, 1), (1, 0))
        for facet in ((side[i], side[j], other[j]), (side[i], other[j], other[i]))
    ]
    return Mesh(np.array([side, other[::-1], *walls]), "wedge")


# --- known answers ---


def test_a_cube_cut_into_whole_layers_is_printed_exactly() -> None:
    result = judged(box((10, 10, 10)), layers(50, 0.2))

    assert result.max == pytest.approx(0, abs=1e-9)


def test_a_missing_top_slab_is_as_far_off_as_it_is_thick() -> None:
    size, off = 10.0, 0.05
    result = judged(box((size, size, size)), layers(50, (size - off) / 50), 40_000)

    # The top face is `off` away all over; the walls only in the highest strip, where the distance falls to 0.
    surface = 6 * size**2
    mean = (size**2 * off + 4 * size * off**2 / 2) / surface
    assert result.max == pytest.approx(off, abs=1e-9)
    assert result.p95 == pytest.approx(off, abs=1e-9)
    assert result.mean == pytest.approx(mean, abs=4 * result.standard_error)


def test_a_last_layer_over_the_part_counts_as_much_as_a_missing_one() -> None:
    plan = LayerPlan(np.array([5.0, 10.05]), np.array([2.5, 7.5]))
    result = judged(box((10, 10, 10)), plan)

    top = result.points[:, 2] > 10 - 1e-9
    to_wall = 5 - np.abs(result.points[top, :2] - 5).max(axis=1)
    assert result.distance[top] == pytest.approx(np.minimum(to_wall, 0.05), abs=1e-9)
    assert result.distance[~top] == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize(("run", "rise"), [(20.0, 10.0), (10.0, 10.0), (4.0, 10.0)])
def test_a_ramp_with_even_layers_has_the_deviation_of_its_steps(run: float, rise: float) -> None:
    height, depth = 0.25, 50.0
    mesh = wedge(run, rise, depth)
    result = judged(mesh, layers(int(rise / height), height), 15_000)

    # The ramp meets the wall of each step at half its height; from there to either end of the layer it runs `tread`
    # sideways and `riser` up. A point that is a share s of the way from the wall is s * riser from the height of the
    # wall's middle and (1 - s) * riser from the tread, s * tread from the wall.
    tread, riser = run * height / rise / 2, height / 2
    share = np.linspace(0, 1, 200_001)
    profile = np.minimum(share * tread, (1 - share) * riser)
    ramp = result.points[:, 0] / run + result.points[:, 2] / rise > 1 - 1e-12
    # Away from the side walls, from the edge to the back wall, and from the foot, where no layer below has a tread.
    inner = ramp & (np.abs(result.points[:, 1] - depth / 2) < depth / 2 - height)
    inner &= np.abs(result.points[:, 2] - rise / 2) < rise / 2 - height
    found = result.distance[inner]
    assert inner.sum() > 3000
    assert found.max() == pytest.approx(tread * riser / (tread + riser), rel=5e-3)
    assert found.max() <= tread * riser / (tread + riser) + 1e-9
    assert found.mean() == pytest.approx(profile.mean(), abs=4 * found.std() / np.sqrt(len(found)))
    # Point by point: the share follows from the height alone.
    shares = np.abs(result.points[inner, 2] / height % 1 - 0.5) * 2
    assert found == pytest.approx(np.minimum(shares * tread, (1 - shares) * riser), abs=1e-6)


def test_a_lost_flange_is_as_far_off_as_it_stands_out() -> None:
    flange = box((30, 30, 0.08), (-10, -10, 5.01))
    plan = layers(50, 0.2)  # cuts at 4.9 and 5.1 pass under and over the flange
    result = judged(joined([box((10, 10, 10)), flange]), plan)

    out = np.abs(result.points[:, :2] - 5).max(axis=1) > 5 + 1e-9
    square = shapely.LinearRing([(0, 0), (10, 0), (10, 10), (0, 10)])
    expected = shapely.distance(square, shapely.points(result.points[out, :2]))
    assert result.distance[out] == pytest.approx(expected, abs=1e-9)
    assert 13 < result.max < np.hypot(10, 10) + 1e-9


def test_a_doubled_flange_is_off_by_the_layer_it_was_rounded_to() -> None:
    flange = box((30, 30, 0.08), (-10, -10, 5.06))
    result = judged(joined([box((10, 10, 10)), flange]), layers(50, 0.2))

    out = np.abs(result.points[:, :2] - 5).max(axis=1) > 6
    face = out & (np.abs(result.points[:, :2] - 5).max(axis=1) < 14.5)
    z = result.points[face, 2]
    assert set(np.round(z, 6)) == {5.06, 5.14}
    assert result.distance[face] == pytest.approx(0.06, abs=1e-9)


def test_a_lost_hole_is_as_far_off_as_its_middle_is_from_the_layers_around_it() -> None:
    solid, hollow = box((10, 10, 10)), box((4, 4, 0.1), (3, 3, 5.02))
    mesh = Mesh(np.concatenate([solid.triangles, hollow.triangles[:, ::-1]]))
    plan = layers(25, 0.4)  # 4.8 to 5.2 is cut at 5.0
    result = judged(mesh, plan)

    assert result.max == pytest.approx(5, abs=0.2)  # from the middle of the hole to the walls of the box
    assert (result.distance > 2.9).sum() == (np.abs(result.points - 5).max(axis=1) < 4.9).sum()


# --- against brute force ---


def boundary(sections: Sections, spacing: float) -> Float:
    """(n, 3) points all over the boundary of the stack, about `spacing` apart."""
    plan = sections.plan
    planes = np.concatenate([[0.0], plan.top])
    shapes = [shapely.Polygon(), *(shape(sections.solid, k) for k in range(plan.n_layers)), shapely.Polygon()]
    found = []
    for k in range(plan.n_layers):
        outline = shapely.segmentize(shapes[k + 1], spacing)
        xy = shapely.get_coordinates(outline)
        levels = np.linspace(planes[k], planes[k + 1], 2 + int(plan.height[k] / spacing))
        found.append(np.column_stack([np.tile(xy, (len(levels), 1)), np.repeat(levels, len(xy))]))
    low, high = sections.solid.xy.min(axis=0), sections.solid.xy.max(axis=0)
    x, y = np.meshgrid(*(np.arange(a, b, spacing) for a, b in zip(low, high, strict=True)))
    for j, z in enumerate(planes):
        tread = shapely.symmetric_difference(shapes[j], shapes[j + 1])
        on = shapely.contains_xy(tread, x, y)
        found.append(np.column_stack([x[on], y[on], np.full(int(on.sum()), z)]))
    return np.concatenate(found)


def twisted() -> Mesh:
    """A square that turns and shrinks as it rises, its sides between the rings folded."""
    turn = np.linspace(0, 1.2, 6)
    rings = [
        (3 - 0.3 * i)
        * np.column_stack([np.cos(a + np.arange(4) * np.pi / 2), np.sin(a + np.arange(4) * np.pi / 2)])
        for i, a in enumerate(turn)
    ]
    return Mesh(loft(rings, list(np.linspace(0, 4, 6))), "twisted")


BODIES = [twisted(), sheared_prism(3, 4, 6), sphere(2), box_with_hole((6, 6, 4), (2, 3))]


@pytest.mark.parametrize("mesh", BODIES, ids=lambda mesh: mesh.name)
@pytest.mark.parametrize("tops", [(0.9, 2.0, 3.6), (0.35, 0.8, 1.7, 2.3, 3.3, 4.1)])
def test_distances_agree_with_a_dense_sample_of_the_boundary(mesh: Mesh, tops: tuple[float, ...]) -> None:
    spacing = 0.06
    sections = cut(mesh, LayerPlan.from_tops(np.array(tops)), 0.0)
    result = measure_deviation(mesh, sections, 500, seed=3)
    sampled = KDTree(boundary(sections, spacing)).query(result.points)[0]

    assert (result.distance <= sampled + 1e-4).all()  # shapely and the stack round alike, not the same
    assert (sampled <= result.distance + 1.5 * spacing).all()


@given(clean_areas(4), st.integers(0, 2**32))
def test_outlines_know_inside_from_outside_and_how_far(areas: Areas, seed: int) -> None:
    rng = np.random.default_rng(seed)
    corners = areas.xy[rng.integers(len(areas.xy), size=20)] if len(areas.xy) else np.zeros((0, 2))
    level = corners - rng.uniform(0, 5, (len(corners), 1)) * np.array([1.0, 0.0])
    points = np.concatenate([rng.uniform(-40, 40, (60, 2)), corners, level, corners + np.array([0.0, 1.0])])
    layer = rng.integers(4, size=len(points))
    outlines = OutlineIndex(areas, points.min(axis=0), points.max(axis=0))

    inside, distance = outlines.is_inside(points, layer), outlines.distance(points, layer)

    for k in range(4):
        here = layer == k
        solid = shape(areas, k)
        away = shapely.distance(shapely.boundary(solid), shapely.points(points[here]))
        empty = not list(areas.rings(k))
        assert np.isinf(distance[here]).all() if empty else distance[here] == pytest.approx(away, abs=1e-8)
        clear = (away > 1e-8) | empty
        assert (inside[here] == shapely.contains_xy(solid, *points[here].T))[clear].all()


@given(st.lists(st.integers(-5, 5), min_size=6, max_size=6))
def test_the_distance_to_a_segment_is_that_of_its_nearest_point(numbers: list[int]) -> None:
    point, begin, end = np.array(numbers, dtype=np.float64).reshape(3, 1, 2)
    along = np.linspace(0, 1, 2001)[:, None]
    nearest = np.hypot(*(point - (begin + along * (end - begin))).T).min()

    assert distance_to_segments(point, begin, end)[0] == pytest.approx(nearest, abs=2e-2)
    assert distance_to_segments(point, begin, end)[0] <= nearest + 1e-12


# --- moved about ---


@settings(max_examples=examples(15))
@given(st.sampled_from(BODIES), st.integers(0, 3), st.tuples(st.integers(-200, 200), st.integers(-200, 200)))
def test_moving_and_turning_the_part_changes_nothing(mesh: Mesh, quarters: int, by: tuple[int, int]) -> None:
    plan = LayerPlan.from_tops(np.array([0.35, 0.8, 1.7, 2.3, 3.3, 4.1]))
    here = judged(mesh, plan, 300)
    there = judged(turned(mesh, quarters).moved((*by, 0)), plan, 300)

    assert there.distance == pytest.approx(here.distance, abs=1e-4)  # contours are rounded to 0.01 µm
    assert there.mean == pytest.approx(here.mean, abs=1e-4)


# --- the points ---


def test_points_lie_on_the_surface_each_face_with_its_share() -> None:
    size = np.array([10.0, 6.0, 2.0])
    points = judged(box((10, 6, 2)), layers(10, 0.2), 20_000).points

    for axis in range(3):
        for end in (0.0, size[axis]):
            face = size.prod() / size[axis]
            share = face / (2 * (60 + 20 + 12))
            on = np.abs(points[:, axis] - end) < 1e-9
            assert on.mean() == pytest.approx(share, abs=4 * np.sqrt(share / 20_000))
    assert ((points > -1e-9) & (points < size + 1e-9)).all()


def test_points_spread_evenly_over_a_face() -> None:
    points = judged(box((10, 6, 2)), layers(10, 0.2), 20_000).points
    top = points[points[:, 2] > 2 - 1e-9]
    counts, _, _ = np.histogram2d(top[:, 0], top[:, 1], bins=(5, 3), range=((0, 10), (0, 6)))

    expected = len(top) / counts.size
    assert len(top) > 5000
    assert ((counts - expected) ** 2 / expected).sum() < 40  # chi-square, 14 degrees of freedom


def test_the_seed_decides_the_points_and_nothing_else_does() -> None:
    first, again, other = (judged(sphere(), layers(100, 0.2), 500, seed) for seed in (1, 1, 2))

    assert np.array_equal(first.points, again.points)
    assert np.array_equal(first.distance, again.distance)
    assert not np.array_equal(first.points, other.points)


def test_the_standard_error_tells_how_far_means_of_other_seeds_lie_apart() -> None:
    sections = cut(sphere(), layers(50, 0.4), 0.0)
    results = [measure_deviation(sphere(), sections, 400, seed) for seed in range(40)]

    spread = np.std([result.mean for result in results], ddof=1)
    assert results[0].standard_error == pytest.approx(spread, rel=0.5)
    assert measure_deviation(sphere(), sections, 1).standard_error == np.inf


def test_facets_without_area_get_no_points() -> None:
    body = box((10, 6, 2))
    needle = np.array([[(50.0, 50, 1), (60, 50, 1), (55, 50, 1)]])
    mesh = Mesh(np.concatenate([needle, body.triangles, needle]))
    sections = cut(body, layers(10, 0.2), 0.0)

    assert measure_deviation(mesh, sections, 1000).points.max() <= 10


def test_a_stack_without_material_is_refused() -> None:
    plan = layers(10, 0.2)
    with pytest.raises(PartError, match="no layer contains any material"):
        measure_deviation(box(), Sections(plan, Areas.empty(10)))


def test_a_judgement_without_points_is_refused() -> None:
    with pytest.raises(ValueError, match="at least one point"):
        judged(box(), layers(50, 0.2), 0)


def test_results_cannot_be_written_to() -> None:
    result = judged(box(), layers(50, 0.2), 10)
    with pytest.raises(ValueError, match="read-only"):
        result.distance[0] = 0.0
