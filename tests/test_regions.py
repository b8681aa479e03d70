"""What is solid, what hangs in the air, what is sparse: by a second, slow reading of the definition."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from printer_slicer import bead
from printer_slicer.geometry import intersection, offset_open, split_connected
from printer_slicer.geometry.engine import ENGINES, using_engine
from printer_slicer.mesh_io import load_mesh
from printer_slicer.model import Areas, LayerPlan, Mesh, Regions, Sections, Walls
from printer_slicer.perimeters import lay_walls
from printer_slicer.profile import Profile
from printer_slicer.regions import classify
from printer_slicer.slicing import cut
from tests.effort import crossed, examples
from tests.parts import (
    box,
    box_with_hole,
    joined,
    layers,
    plain,
    pyramid,
    shape,
    shapely,
    sphere,
    step_pyramid,
    two_boxes,
)

WIDTH = 0.45
FIELDS = (
    "bottom_solid_infill",
    "bridge",
    "internal_bridge",
    "top_solid_infill",
    "solid_infill",
    "internal_infill",
)
engines = pytest.mark.parametrize("engine", list(ENGINES))


def uneven(height: float, seed: int = 0) -> LayerPlan:
    """Layers of 0.08 to 0.32 in no order."""
    rng = np.random.default_rng(seed)
    tops: list[float] = []
    z = 0.0
    while z < height - 0.4:
        z = round(z + int(rng.integers(8, 33)) / 100, 2)
        tops.append(z)
    tops.append(round((z + height) / 2, 3))
    return LayerPlan.from_tops(np.array([*tops, height]))


def table() -> Mesh:
    """A plate 20 x 20 x 2 on a post of 8 x 8, 4 high: its underside hangs in the air."""
    return joined([box((8, 8, 4), (6, 6, 0)), box((20, 20, 2), (0, 0, 4))], "table")


def classified(mesh: Mesh, plan: LayerPlan, wanted: Profile) -> tuple[Sections, Walls, Regions]:
    sections = cut(mesh, plan, 0.0125)
    walls = lay_walls(sections, wanted)
    return sections, walls, classify(sections, walls, wanted)


def regions_of(regions: Regions) -> list[Areas]:
    return [getattr(regions, name) for name in FIELDS]


PARTS = [
    (box(), 10.0),
    (table(), 6.0),
    (step_pyramid([20, 14, 8], [2.0, 1.5, 2.5]), 6.0),
    (pyramid(16, 6), 5.9),
    (sphere(4), 7.9),
    (box_with_hole((20, 20, 4)), 4.0),
    (two_boxes((10, 10, 3)), 3.0),
]


@cache
def usual(mesh: Mesh, height: float) -> tuple[Sections, Walls, Regions]:
    """With the usual settings, on uneven layers."""
    return classified(mesh, uneven(height), plain())


each_part = pytest.mark.parametrize(("mesh", "height"), PARTS, ids=lambda value: getattr(value, "name", ""))


# --- regions divide the inside ---


@engines
@each_part
def test_regions_do_not_overlap_and_cover_the_inside(engine: str, mesh: Mesh, height: float) -> None:
    with using_engine(engine):
        _, walls, regions = classified(mesh, uneven(height), plain())

    for layer in range(regions.plan.n_layers):
        shapes = [shape(areas, layer) for areas in regions_of(regions)]
        inside = shape(walls.inside, layer)
        # Engines round to 0.01 µm, so areas to a few times that by the length of outline.
        blur = 1e-4 * (1 + shapely.length(inside) + sum(shapely.length(one) for one in shapes))
        assert abs(sum(shapely.area(one) for one in shapes) - shapely.area(inside)) < blur
        assert shapely.area(shapely.difference(inside, shapely.union_all(shapes))) < blur
        for i, one in enumerate(shapes):
            assert all(shapely.area(shapely.intersection(one, other)) < blur for other in shapes[:i])


@each_part
def test_bottom_skins_lie_on_the_bed_and_bridges_do_not(mesh: Mesh, height: float) -> None:
    _, _, regions = usual(mesh, height)

    assert set(regions.bottom_solid_infill.ring_layer.tolist()) <= {0}
    assert 0 not in regions.bridge.ring_layer


def test_the_first_layer_is_bottom_skin_and_the_last_top_skin() -> None:
    _, walls, regions = classified(box(), uneven(10.0), plain())

    assert regions.bottom_solid_infill.area()[0] == pytest.approx(walls.inside.area()[0])
    assert regions.top_solid_infill.area()[-1] == pytest.approx(walls.inside.area()[-1])
    assert regions.bridge.n_rings == 0


def test_a_single_layer_is_bottom_skin_only() -> None:
    _, walls, regions = classified(box((10, 10, 0.2)), LayerPlan.from_tops(np.array([0.2])), plain())

    assert regions.bottom_solid_infill.area() == pytest.approx(walls.inside.area())
    assert sum(areas.area().sum() for areas in regions_of(regions)) == pytest.approx(
        walls.inside.area().sum()
    )


def test_full_density_leaves_nothing_sparse() -> None:
    _, walls, regions = classified(table(), uneven(6.0), plain(infill_density=1))

    assert regions.internal_infill.n_rings == 0
    assert sum(areas.area() for areas in regions_of(regions)) == pytest.approx(walls.inside.area(), abs=1e-2)


def test_without_skins_everything_is_sparse() -> None:
    _, walls, regions = classified(table(), uneven(6.0), plain(top_thickness=0, bottom_thickness=0))

    assert regions.internal_infill.area() == pytest.approx(walls.inside.area())
    assert all(areas.n_rings == 0 for areas in regions_of(regions)[:-1])


# --- thickness in mm, on layers of any height ---


def test_skins_of_a_box_are_as_thick_as_asked_for_and_no_thicker_than_the_layers_require() -> None:
    plan = LayerPlan.from_tops(np.array([0.3, 0.4, 0.5, 0.8, 1.1, 1.2, 1.5, 1.8, 1.9, 2.0]))
    _, _, regions = classified(box((10, 10, 2)), plan, plain(bottom_thickness=0.6, top_thickness=0.45))

    solid = np.flatnonzero(regions.internal_infill.area() < 1e-6).tolist()
    # Bottom: all that begins below 0.6. Top: all that ends above 1.55.
    assert solid == [0, 1, 2, 3, 7, 8, 9]


@pytest.mark.parametrize("thickness", [0.1, 0.2, 0.6, 0.79, 0.8, 0.81, 3.0])
def test_layers_are_solid_while_air_begins_within_the_thickness(thickness: float) -> None:
    plan = layers(50, 0.2)
    _, _, regions = classified(box(), plan, plain(bottom_thickness=thickness, top_thickness=thickness))

    n_layers = int(np.ceil(thickness / 0.2 - 1e-9))
    sparse = regions.internal_infill.area() > 1e-6
    assert sparse.tolist() == [False] * n_layers + [True] * (50 - 2 * n_layers) + [False] * n_layers


def in_reach(sections: Sections, walls: Walls, layer: int, top: float, bottom: float) -> Any:
    """What of the inside of a layer is not inside all layers within the thickness over and under it: by definition."""
    plan, inside = sections.plan, shape(walls.inside, layer)
    heights = plan.top[layer], plan.bottom[layer]
    covers = [
        shape(walls.inside, other)
        for other in range(plan.n_layers)
        if (other > layer and plan.bottom[other] < heights[0] + top - 1e-6)
        or (other < layer and plan.top[other] > heights[1] - bottom + 1e-6)
    ]
    if heights[0] + top > plan.top[-1] + 1e-6 or heights[1] - bottom < -1e-6:
        return inside
    return shapely.difference(inside, shapely.intersection_all(covers)) if covers else shapely.Polygon()


def check_shell(sections: Sections, walls: Walls, regions: Regions, top: float, bottom: float) -> None:
    rng = np.random.default_rng(7)
    for layer in range(sections.plan.n_layers):
        inside = shape(walls.inside, layer)
        if shapely.area(inside) < 0.1:
            continue
        exact = in_reach(sections, walls, layer, top, bottom)
        low_x, low_y, high_x, high_y = shapely.bounds(inside)
        points = shapely.points(rng.uniform((low_x, low_y), (high_x, high_y), (60, 2)))
        points = points[shapely.contains(inside, points)]
        sparse = shapely.contains(shape(regions.internal_infill, layer), points)
        # Strips beside walls that are thick enough are left out; none of them is wider than the walls are deep.
        core = shapely.contains(shapely.buffer(exact, -WIDTH), points)
        # Skins grow by two beads, bridges by their anchors, to end on something; corners reach farther.
        away = (
            shapely.distance(exact, points) > 2.05 * max(2 * WIDTH, 1.5)
            if not shapely.is_empty(exact)
            else np.ones(len(points), bool)
        )

        assert not (core & sparse).any()
        assert sparse[away].all()


@engines
@each_part
def test_points_near_a_surface_are_solid_and_points_far_from_all_are_not(
    engine: str, mesh: Mesh, height: float
) -> None:
    with using_engine(engine):
        sections, walls, regions = classified(
            mesh, uneven(height), plain(top_thickness=0.8, bottom_thickness=0.6, solid_infill_below_area=0)
        )

    check_shell(sections, walls, regions, 0.8, 0.6)


@settings(max_examples=examples(8))
@given(
    seed=st.integers(0, 999),
    top=st.integers(1, 150),
    bottom=st.integers(1, 150),
    sides=st.permutations([20, 13, 8]),
)
def test_the_shell_is_right_on_any_layers_for_any_thickness(
    seed: int, top: int, bottom: int, sides: Sequence[int]
) -> None:
    blocks = [box((side, side, 1.5), ((20 - side) / 2,) * 2 + (1.5 * i,)) for i, side in enumerate(sides)]
    wanted = plain(top_thickness=top / 100, bottom_thickness=bottom / 100, solid_infill_below_area=0)

    sections, walls, regions = classified(joined(blocks), uneven(4.5, seed), wanted)

    check_shell(sections, walls, regions, top / 100, bottom / 100)


# --- bridges and top skins ---


def test_the_underside_of_a_table_is_a_bridge_with_air_below() -> None:
    plan = LayerPlan.from_tops(np.array([1.0, 2.0, 3.0, 4.0, 4.3, 4.6, 5.0, 6.0]))
    sections, walls, regions = classified(table(), plan, plain())

    assert set(regions.bridge.ring_layer.tolist()) == {4}
    bridge, post = shape(regions.bridge, 4), shape(sections.solid, 3)
    # All that hangs, and as much of the post as the anchors hold on to, along lines that run across its corners.
    assert shapely.area(shapely.difference(shape(walls.inside, 4), shapely.union(bridge, post))) < 1e-3
    assert np.abs(np.sin(2 * regions.bridge_angle)) == pytest.approx(1)
    depth = WIDTH / 2 + 1.5 / np.sqrt(2)
    assert shapely.area(shapely.intersection(bridge, post)) == pytest.approx(
        64 - (8 - 2 * depth) ** 2, abs=1e-3
    )


def test_what_hangs_over_the_first_layer_is_a_bridge_on_the_second() -> None:
    mushroom = joined([box((8, 8, 0.2), (6, 6, 0)), box((20, 20, 1), (0, 0, 0.2))])
    _, walls, regions = classified(mushroom, layers(6, 0.2), plain())

    assert set(regions.bridge.ring_layer.tolist()) == {1}
    assert regions.bridge.area()[1] > 0.8 * walls.inside.area()[1]


@each_part
def test_every_bridge_has_air_below_but_for_its_anchors(mesh: Mesh, height: float) -> None:
    sections, _, regions = usual(mesh, height)

    for layer in np.unique(regions.bridge.ring_layer).tolist():
        air = shapely.difference(shape(sections.solid, layer), shape(sections.solid, layer - 1))
        for part in shapely.get_parts(shape(regions.bridge, layer)):
            assert shapely.distance(part, air) < 1e-4
            assert shapely.area(shapely.difference(part, air.buffer(4.1 * WIDTH))) < 1e-3


@each_part
def test_every_top_skin_has_air_above_but_for_its_anchors(mesh: Mesh, height: float) -> None:
    sections, _, regions = usual(mesh, height)

    for layer in np.unique(regions.top_solid_infill.ring_layer).tolist():
        if layer + 1 == regions.plan.n_layers:
            continue
        air = shapely.difference(shape(sections.solid, layer), shape(sections.solid, layer + 1))
        assert (
            shapely.area(shapely.difference(shape(regions.top_solid_infill, layer), air.buffer(4.1 * WIDTH)))
            < 1e-3
        )


def test_the_steps_of_a_pyramid_have_top_skins() -> None:
    plan = layers(30, 0.2)
    sections, walls, regions = classified(step_pyramid([20, 14, 8], [2.0, 1.6, 2.4]), plan, plain())

    assert sorted(set(regions.top_solid_infill.ring_layer.tolist())) == [9, 17, 29]
    step = shapely.difference(shape(walls.inside, 9), shape(sections.solid, 10))
    assert shapely.area(shapely.difference(step, shape(regions.top_solid_infill, 9))) < 1e-3


def test_walls_that_hardly_lean_have_no_skins_but_first_and_last() -> None:
    """A bead's width of slope over a layer is no surface: what is open is narrower than half a bead."""
    stump = pyramid(20.0, 400.0)
    plan = layers(20, 0.2)
    _, _, regions = classified(stump, plan, plain())

    assert set(regions.top_solid_infill.ring_layer.tolist()) == {19}
    assert regions.bridge.n_rings == 0


def test_bridge_lines_run_from_support_to_support() -> None:
    """A deck between two walls along y: its lines run along x."""
    walls = [box((4, 12, 4)), box((4, 12, 4), (16, 0, 0)), box((20, 12, 1), (0, 0, 4))]
    plan = layers(25, 0.2)
    _, _, regions = classified(joined(walls), plan, plain())

    assert set(regions.bridge.ring_layer.tolist()) == {20}
    assert np.sin(regions.bridge_angle) == pytest.approx(0, abs=1e-9)


def test_every_bridge_of_a_layer_has_its_own_direction() -> None:
    """Two decks between walls, one turned by a right angle, one by 50 degrees: lines cross from wall to wall."""
    posts = [box((4, 12, 4)), box((4, 12, 4), (16, 0, 0)), box((20, 12, 1), (0, 0, 4))]
    turned = [
        post for angle, x in ((0, 0), (90, 60), (50, 120)) for post in (spun(one, angle, x) for one in posts)
    ]
    _, _, regions = classified(joined(turned), layers(25, 0.2), plain())

    angles = sorted(set(np.round(np.rad2deg(regions.bridge_angle) % 180, 6).tolist()))
    assert angles == [0, 50, 90]


def test_lines_under_a_balcony_run_out_from_the_wall_that_holds_it() -> None:
    part = joined([box((10, 20, 4)), box((16, 20, 1), (0, 0, 4))])
    _, _, regions = classified(part, layers(25, 0.2), plain())

    assert regions.bridge.n_rings == 1
    assert np.sin(regions.bridge_angle) == pytest.approx(0, abs=1e-9)


def spun(mesh: Mesh, degrees: float, x: float) -> Mesh:
    """The mesh turned about z and moved along x."""
    turn = np.deg2rad(degrees)
    around = np.array([(np.cos(turn), np.sin(turn), 0), (-np.sin(turn), np.cos(turn), 0), (0, 0, 1)])
    return Mesh(mesh.triangles @ around).moved((x, 0.0, 0.0))


# --- the shell on slopes ---


def depth_of_walls(plan: LayerPlan, perimeters: int) -> np.ndarray[Any, np.dtype[np.float64]]:
    return WIDTH / 2 + (perimeters - 0.5) * np.asarray(bead.spacing(WIDTH, plan.height))


@pytest.mark.parametrize(
    ("share", "degrees", "walls"),
    crossed(
        [0.0, 0.6, 0.9, 1.0],
        [8, 15, 25, 35, 45, 55, 62, 68, 74, 80, 86],
        list(product([0.4, 0.8, 1.2], [1, 2, 3])),
    ),
)
def test_slopes_of_every_angle_keep_walls_or_skins_across_them(
    share: float, degrees: float, walls: tuple[float, int]
) -> None:
    """On a pyramid and upside down: how near sparse infill comes to a face, measured square to it, and upright."""
    thickness, perimeters = walls
    slope = np.tan(np.deg2rad(degrees))
    base, height = 30.0, min(14 * slope, 6.0)
    top = base - 2 * height / slope
    wanted = plain(
        top_thickness=thickness,
        bottom_thickness=thickness,
        perimeters=perimeters,
        solid_infill_below_area=0,
        slope_shell_ratio=share,
    )
    plan = uneven(height, int(degrees))
    for mesh, half in ((frustum(base, top, height), base / 2), (frustum(top, base, height), top / 2)):
        _, _, regions = classified(mesh, plan, wanted)
        sparse = offset_open(regions.internal_infill, WIDTH / 4)  # what a bead might be laid in
        layer = np.repeat(sparse.ring_layer, np.diff(sparse.ring_start))
        depth = float(depth_of_walls(plan, perimeters).min())
        promised = share * min(thickness, depth) * np.cos(np.arctan(WIDTH / 2 / thickness))
        upright = min(thickness, (depth - WIDTH / 4) * slope)
        stairs = plan.height.max() / 2 * np.cos(np.deg2rad(degrees))  # by which they lie within the face
        for z in (plan.bottom, plan.top):
            reach = half - (z if mesh.name == "narrows" else -z) / slope
            distance = (reach[layer] - np.abs(sparse.xy).max(axis=1)) * np.sin(np.deg2rad(degrees))
            assert (distance >= promised - stairs - 0.02).all()
            assert (
                distance / np.cos(np.deg2rad(degrees))
                >= upright - plan.height.max() / 2 - WIDTH / 4 * slope - 0.02
            ).all()


def frustum(bottom: float, top: float, height: float) -> Mesh:
    """A square stump in the middle of x and y."""
    low, high = box((bottom, bottom, height), (-bottom / 2, -bottom / 2, 0)).triangles.copy(), top / bottom
    low[low[:, :, 2] > 0, :2] *= high
    return Mesh(low, "narrows" if top < bottom else "widens")


@pytest.mark.parametrize("thickness", [0.4, 0.8, 1.2])
def test_a_dome_keeps_walls_or_skins_everywhere(thickness: float) -> None:
    plan = uneven(15.9, 3)
    wanted = plain(top_thickness=thickness, bottom_thickness=thickness, solid_infill_below_area=0)
    _, _, regions = classified(sphere(8), plan, wanted)

    sparse = offset_open(regions.internal_infill, WIDTH / 4)
    layer = np.repeat(sparse.ring_layer, np.diff(sparse.ring_start))
    assert len(layer) > 100
    depth = np.minimum(thickness, depth_of_walls(plan, 2)) * np.cos(np.arctan(WIDTH / 2 / thickness))
    for z in (plan.bottom, plan.top):
        away = 8 - np.hypot(*(sparse.xy - sphere(8).bounds.mean(axis=0)[:2]).T, z[layer] - 8)
        # The ball is made of flat facets, which lie up to 0.1 mm within it.
        assert (away >= depth[layer] - plan.height[layer] / 2 - 0.1).all()


def test_walls_that_are_thick_enough_get_no_solid_beside_them() -> None:
    """Over 70 degrees two walls are 0.8 mm thick across the slope: nothing but sparse between skins."""
    slope = np.tan(np.deg2rad(72))
    plan = layers(40, 0.2)
    _, walls, regions = classified(frustum(30.0, 30 - 16 / slope, 8.0), plan, plain())

    middle = slice(6, 34)
    assert regions.internal_infill.area()[middle] == pytest.approx(walls.inside.area()[middle])


# --- too small for sparse infill ---


def test_small_and_narrow_areas_are_solid() -> None:
    """Inside two walls: 3.5 x 4 mm, 10 x 10 mm, and a strip of 1 x 28 mm, which is over 15 mm² but narrow."""
    depth = float(depth_of_walls(layers(1, 0.2), 2)[0])
    sizes = [(3.5, 4), (10, 10), (1, 28)]
    parts = [box((x + 2 * depth, y + 2 * depth, 4), (25.0 * i, 0, 0)) for i, (x, y) in enumerate(sizes)]
    _, _, regions = classified(joined(parts), layers(20, 0.2), plain())
    _, walls, kept = classified(joined(parts), layers(20, 0.2), plain(solid_infill_below_area=0))

    assert regions.internal_infill.area()[10] == pytest.approx(100, abs=0.5)
    assert kept.internal_infill.area()[10] == pytest.approx(walls.inside.area()[10], abs=1e-3)


def test_faceted_slopes_leave_no_solid_dots_beside_the_walls() -> None:
    """Where a slope gets too steep for a solid strip beside its walls, corners of facets would leave bits of it."""
    vase = load_mesh(Path(__file__).parents[1] / "sample_parts" / "vase.stl")
    _, _, regions = classified(vase, layers(300, 0.2), plain(slope_shell_ratio=1))

    pieces = split_connected(regions.solid_infill)
    below = regions.internal_infill.shift_layers(1).copy_layers(pieces.layer)
    hanging = intersection(pieces.areas, below).area() > 0.3 * pieces.areas.area()
    assert pieces.count > 200
    assert pieces.areas.area()[hanging].min() >= 5 * WIDTH**2


# --- over sparse infill ---


def test_the_first_solid_layer_over_sparse_infill_is_an_internal_bridge() -> None:
    plan = LayerPlan.from_tops(np.array([0.3, 0.6, 0.8, 1.0, 1.3, 1.6, 1.8, 2.0]))
    _, walls, regions = classified(box((20, 20, 2)), plan, plain(bottom_thickness=0.3, top_thickness=0.7))

    assert np.flatnonzero(regions.internal_infill.area() > 1).tolist() == [1, 2, 3, 4]
    assert set(regions.internal_bridge.ring_layer.tolist()) == {5}
    assert regions.internal_bridge.area()[5] == pytest.approx(walls.inside.area()[5])


def test_over_an_inside_that_stays_empty_solid_layers_are_bridges_with_a_direction() -> None:
    plan = layers(30, 0.2)
    _, walls, regions = classified(box((8, 30, 6)), plan, plain(infill_density=0))

    assert regions.internal_bridge.n_rings == 0
    assert set(regions.bridge.ring_layer.tolist()) == {26}
    assert regions.bridge.area()[26] == pytest.approx(walls.inside.area()[26])
    assert np.cos(regions.bridge_angle) == pytest.approx(
        1, abs=0.01
    )  # across the short way, from wall to wall


def test_what_no_line_can_bridge_is_solid_infill() -> None:
    """A disc on a smaller one: whatever the direction, lines over the edge end in the air."""
    plan = layers(2, 0.2)
    turn = 2 * np.pi * np.arange(64) / 64
    rings = [[radius * np.column_stack([np.cos(turn), np.sin(turn)])] for radius in (1.4, 2.6)]
    sections = Sections(plan, Areas.from_rings(rings))

    regions = classify(sections, lay_walls(sections, plain()), plain())

    assert regions.bridge.n_rings == 0
    inside = regions.inside.area()[1]
    assert regions.solid_infill.area()[1] > 0.9 * inside
