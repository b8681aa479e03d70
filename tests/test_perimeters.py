"""Loops lie one bead inside the contour, one spacing apart, whatever the height of the layer."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from printer_slicer import bead
from printer_slicer.geometry.engine import ENGINES, using_engine
from printer_slicer.model import Areas, LayerPlan, Mesh, Role, Sections
from printer_slicer.perimeters import lay_walls, perimeter_paths
from printer_slicer.slicing import cut
from tests.parts import (
    box,
    box_with_hole,
    plain,
    prism,
    pyramid,
    shape,
    shapely,
    sphere,
    step_pyramid,
    two_boxes,
)

UNEVEN = (0.1, 0.42, 0.5, 0.82, 1.0, 1.32)
engines = pytest.mark.parametrize("engine", list(ENGINES))


def sections_of(mesh: Mesh, tops: tuple[float, ...] = UNEVEN) -> Sections:
    return cut(mesh, LayerPlan.from_tops(np.array(tops)), 0.0125)


def ring_of(loop: Areas, layer: int) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    (ring,) = loop.rings(layer)
    return ring


@engines
@pytest.mark.parametrize("count", [0, 1, 2, 5])
def test_there_are_as_many_loops_as_asked_for(engine: str, count: int) -> None:
    with using_engine(engine):
        walls = lay_walls(sections_of(box()), plain(perimeters=count))

    assert len(walls.loops) == count
    assert all(loop.n_rings == 6 for loop in walls.loops)


@engines
def test_loops_of_a_box_lie_half_a_width_inside_and_one_spacing_apart_on_each_layer(engine: str) -> None:
    sections = sections_of(box())
    with using_engine(engine):
        walls = lay_walls(sections, plain(perimeters=4))

    for layer, height in enumerate(sections.plan.height):
        gap = float(bead.spacing(0.45, height))
        for depth, loop in enumerate(walls.loops):
            inset = 0.45 / 2 + depth * gap
            ring = ring_of(loop, layer)
            assert ring.min(axis=0) == pytest.approx([inset, inset], abs=2e-5)
            assert ring.max(axis=0) == pytest.approx([10 - inset, 10 - inset], abs=2e-5)
            assert len(ring) == 4


def test_uneven_layers_have_spacings_of_their_own() -> None:
    walls = lay_walls(sections_of(box()), plain(perimeters=2))

    steps = [ring_of(walls.loops[1], k).min() - ring_of(walls.loops[0], k).min() for k in range(6)]
    assert steps == pytest.approx(bead.spacing(0.45, np.array([0.1, 0.32, 0.08, 0.32, 0.18, 0.32])), abs=2e-5)


@engines
def test_what_is_left_inside_begins_half_a_spacing_within_the_last_loop(engine: str) -> None:
    sections = sections_of(box())
    with using_engine(engine):
        walls = lay_walls(sections, plain(perimeters=3))

    gap = bead.spacing(0.45, sections.plan.height)
    side = 10 - 0.45 - 5 * gap
    assert walls.inside.area() == pytest.approx(side**2, abs=1e-3)


def test_without_perimeters_everything_is_inside() -> None:
    sections = sections_of(box())
    walls = lay_walls(sections, plain(perimeters=0))

    assert walls.inside.area() == pytest.approx([100] * 6)
    assert perimeter_paths(walls).n_paths == 0


MESHES = [
    box((6, 9, 2)),
    box_with_hole((20, 20, 2)),
    pyramid(12, 5),
    sphere(4),
    two_boxes(),
    step_pyramid([12, 8, 5], [0.5, 0.4, 3]),
]


@engines
@pytest.mark.parametrize("mesh", MESHES, ids=lambda mesh: mesh.name)
def test_no_bead_leaves_the_section(engine: str, mesh: Mesh) -> None:
    sections = sections_of(mesh)
    with using_engine(engine):
        walls = lay_walls(sections, plain(perimeters=3))

    for loop in walls.loops:
        for layer in range(6):
            room = shape(sections.solid, layer).buffer(-(0.45 / 2 - 1e-4), join_style="mitre")
            for ring in loop.rings(layer):
                assert shapely.within(shapely.LinearRing(ring), room)


@engines
@pytest.mark.parametrize("mesh", MESHES, ids=lambda mesh: mesh.name)
def test_loops_of_one_layer_keep_their_distance(engine: str, mesh: Mesh) -> None:
    sections = sections_of(mesh)
    with using_engine(engine):
        walls = lay_walls(sections, plain(perimeters=3))

    for layer, height in enumerate(sections.plan.height):
        gap = float(bead.spacing(0.45, height))
        rings = [shapely.LinearRing(ring) for loop in walls.loops for ring in loop.rings(layer)]
        distances = [shapely.distance(a, b) for i, a in enumerate(rings) for b in rings[:i]]
        assert min(distances, default=1.0) > 0.59 * gap


@settings(deadline=None, max_examples=25)
@given(
    corners=st.lists(st.tuples(st.floats(1.5, 9), st.floats(0, 0.9)), min_size=3, max_size=7),
    perimeters=st.integers(1, 4),
)
def test_beads_of_any_convex_outline_stay_inside(corners: list[tuple[float, float]], perimeters: int) -> None:
    turns = 2 * np.pi * (np.arange(len(corners)) + [share for _, share in corners]) / len(corners)
    radii = np.array([radius for radius, _ in corners])
    hull = shapely.convex_hull(
        shapely.MultiPoint(np.column_stack([radii * np.cos(turns), radii * np.sin(turns)]))
    )
    if hull.geom_type != "Polygon" or hull.area < 1:
        return
    outline = np.asarray(shapely.orient_polygons(hull).exterior.coords)[:-1]

    walls = lay_walls(sections_of(prism(outline, 1.32)), plain(perimeters=perimeters))

    room = hull.buffer(-(0.45 / 2 - 0.013), join_style="mitre")
    for loop in walls.loops:
        assert all(shapely.within(shapely.LinearRing(ring), room) for ring in loop.rings(0))


def test_loops_where_two_sides_would_meet_are_left_out() -> None:
    """A wall of 0.6 has room for one bead but not for a loop of two."""
    walls = lay_walls(sections_of(box((10, 0.6, 2))), plain(perimeters=2))

    assert walls.loops[0].n_rings == 0
    assert walls.lost == pytest.approx([6.0] * 6)


def test_walls_wide_enough_for_their_loops_lose_nothing() -> None:
    for wide, perimeters in ((0.8, 1), (1.0, 1), (2.0, 2), (10.0, 2)):
        walls = lay_walls(sections_of(box((10, wide, 2))), plain(perimeters=perimeters))

        assert walls.loops[-1].n_rings == 6
        assert walls.lost == pytest.approx([0] * 6, abs=1e-3)


def test_a_strip_too_narrow_for_the_next_loop_is_counted_as_lost() -> None:
    # Two beads of 0.45 mm leave a strip of about 0.34 mm between them.
    walls = lay_walls(sections_of(box((30, 1.2, 2))), plain(perimeters=2))

    gap = bead.spacing(0.45, walls.plan.height)
    assert walls.lost == pytest.approx((1.2 - 0.45 - gap) * (30 - 0.45 - gap), rel=1e-3)


def test_every_loop_becomes_one_closed_path_with_role_and_width() -> None:
    walls = lay_walls(sections_of(box_with_hole((20, 20, 2))), plain(perimeters=3))
    paths = perimeter_paths(walls)

    assert paths.n_paths == 6 * 3 * 2
    assert paths.closed.all()
    assert (paths.width == 0.45).all()
    assert np.bincount(paths.role)[[Role.INNER_PERIMETER, Role.OUTER_PERIMETER]].tolist() == [24, 12]
    assert (np.diff(paths.layer) >= 0).all()


def test_deeper_loops_come_first_within_a_layer() -> None:
    paths = perimeter_paths(lay_walls(sections_of(box()), plain(perimeters=3)))

    for layer in range(6):
        roles = paths.role[paths.layer == layer].tolist()
        lengths = [np.ptp(paths.path(i), axis=0).sum() for i in np.flatnonzero(paths.layer == layer).tolist()]
        assert roles == [Role.INNER_PERIMETER, Role.INNER_PERIMETER, Role.OUTER_PERIMETER]
        assert lengths == sorted(lengths)


def test_a_hole_is_followed_the_other_way_round() -> None:
    walls = lay_walls(sections_of(box_with_hole((20, 20, 2))), plain(perimeters=2))

    for loop in walls.loops:
        assert sorted(np.sign(loop.ring_area()).tolist()) == [-1] * 6 + [1] * 6
