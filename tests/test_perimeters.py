"""Loops lie one bead inside the contour, one spacing apart, whatever the height of the layer."""

from __future__ import annotations

import numpy as np
import pytest

from printer_slicer import bead
from printer_slicer.arrays import Float
from printer_slicer.geometry import Areas
from printer_slicer.geometry.engine import ENGINES, using_engine
from printer_slicer.model import LayerPlan, Mesh, Sections, Walls
from printer_slicer.perimeters import lay_walls
from printer_slicer.roles import Role
from printer_slicer.slicing import cut
from tests.parts import (
    box,
    box_with_hole,
    joined,
    plain,
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


def loops_of(walls: Walls, layer: int) -> list[Float]:
    """The paths of a layer, outermost first."""
    return [walls.paths.path(i) for i in np.flatnonzero(walls.paths.layer == layer)[::-1].tolist()]


@engines
@pytest.mark.parametrize("count", [0, 1, 2, 5])
def test_there_are_as_many_loops_as_asked_for(engine: str, count: int) -> None:
    with using_engine(engine):
        walls = lay_walls(sections_of(box()), plain(perimeters=count))

    assert np.bincount(walls.paths.layer, minlength=6).tolist() == [count] * 6


@engines
@pytest.mark.parametrize("angle", [30, 45, 58])
def test_loops_keep_the_points_of_corners_of_30_to_60_degrees(engine: str, angle: float) -> None:
    half = np.deg2rad(angle / 2)
    length = 30.0
    ring = np.array([[0, 0], [length, -length * np.tan(half)], [length, length * np.tan(half)]])
    sections = Sections(LayerPlan.from_tops(np.array([0.2])), Areas.from_rings([[ring]]))
    with using_engine(engine):
        walls = lay_walls(sections, plain(perimeters=2, varying_walls=False))

    gap = float(bead.spacing(0.45, 0.2))
    for depth, loop in enumerate(loops_of(walls, 0)):
        inset = 0.45 / 2 + depth * gap
        assert len(loop) == 3
        assert loop[:, 0].min() == pytest.approx(inset / np.sin(half), abs=1e-4)


@engines
def test_loops_of_a_box_lie_half_a_width_inside_and_one_spacing_apart_on_each_layer(engine: str) -> None:
    sections = sections_of(box())
    with using_engine(engine):
        walls = lay_walls(sections, plain(perimeters=4))

    for layer, height in enumerate(sections.plan.height):
        gap = float(bead.spacing(0.45, height))
        for depth, ring in enumerate(loops_of(walls, layer)):
            inset = 0.45 / 2 + depth * gap
            assert ring.min(axis=0) == pytest.approx([inset, inset], abs=2e-5)
            assert ring.max(axis=0) == pytest.approx([10 - inset, 10 - inset], abs=2e-5)
            assert len(ring) == 4


def test_uneven_layers_have_spacings_of_their_own() -> None:
    walls = lay_walls(sections_of(box()), plain(perimeters=2))

    pairs = [loops_of(walls, k) for k in range(6)]
    steps = [inner.min() - outer.min() for outer, inner in pairs]
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
    assert walls.paths.n_paths == 0


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

    for layer in range(6):
        room = shape(sections.solid, layer).buffer(-(0.45 / 2 - 1e-4), join_style="mitre")
        for ring in loops_of(walls, layer):
            assert shapely.within(shapely.LinearRing(ring), room)


@engines
@pytest.mark.parametrize("mesh", MESHES, ids=lambda mesh: mesh.name)
def test_loops_of_one_layer_keep_their_distance(engine: str, mesh: Mesh) -> None:
    sections = sections_of(mesh)
    with using_engine(engine):
        walls = lay_walls(sections, plain(perimeters=3))

    for layer, height in enumerate(sections.plan.height):
        gap = float(bead.spacing(0.45, height))
        rings = [shapely.LinearRing(ring) for ring in loops_of(walls, layer)]
        distances = [shapely.distance(a, b) for i, a in enumerate(rings) for b in rings[:i]]
        assert min(distances, default=1.0) > 0.59 * gap


def test_every_loop_becomes_one_closed_path_with_role_and_width() -> None:
    paths = lay_walls(sections_of(box_with_hole((20, 20, 2))), plain(perimeters=3)).paths

    assert paths.n_paths == 6 * 3 * 2
    assert paths.closed.all()
    outer = np.repeat(paths.role == Role.EXTERNAL_PERIMETER, np.diff(paths.start))
    assert (paths.width[outer] == 0.45).all()
    # Inner ones hold what the round sides of the outer ones leave empty.
    assert (paths.width[~outer] > 0.45).all()
    assert (paths.width[~outer] < 0.45 * 1.1).all()
    assert np.bincount(paths.role)[[Role.PERIMETER, Role.EXTERNAL_PERIMETER]].tolist() == [24, 12]
    assert (np.diff(paths.layer) >= 0).all()


def test_deeper_loops_come_first_within_a_layer() -> None:
    paths = lay_walls(sections_of(box()), plain(perimeters=3)).paths

    for layer in range(6):
        roles = paths.role[paths.layer == layer].tolist()
        lengths = [np.ptp(paths.path(i), axis=0).sum() for i in np.flatnonzero(paths.layer == layer).tolist()]
        assert roles == [Role.PERIMETER, Role.PERIMETER, Role.EXTERNAL_PERIMETER]
        assert lengths == sorted(lengths)


@pytest.mark.parametrize("diameter", [0.5, 0.55, 0.6, 1.3])
@pytest.mark.parametrize("longer", [0.0, 0.002, 0.02, 0.1, 0.15])
def test_small_islands_that_are_hardly_longer_than_wide_get_their_plastic(
    diameter: float, longer: float
) -> None:
    """Their last bead is nearly a dot: a line as short as that would hold hardly anything."""
    turn = np.arange(60) * (2 * np.pi / 60)
    ring = np.column_stack([np.cos(turn), np.sin(turn)]) * diameter / 2
    ring[:, 0] += np.where(np.cos(turn) > 0, longer, 0.0) + 100
    plan = LayerPlan.from_tops(np.array([0.2]))
    sections = Sections(plan, Areas.from_rings([[ring]]))

    walls = lay_walls(sections, plain(perimeters=2))

    paths = walls.paths
    area = bead.cross_section(paths.width, 0.2)
    laid = 0.0
    for i in range(paths.n_paths):
        one = np.concatenate([paths.path(i), paths.path(i)[:1]]) if paths.closed[i] else paths.path(i)
        laid += float(np.hypot(*np.diff(one, axis=0).T).sum() * area[paths.start[i]])
    assert 0.7 < laid / (sections.solid.area()[0] * 0.2) < 1.2


def test_a_hole_is_followed_the_other_way_round() -> None:
    walls = lay_walls(sections_of(box_with_hole((20, 20, 2))), plain(perimeters=2))

    for layer in range(6):
        turns = [shapely.is_ccw(shapely.LinearRing(ring)) for ring in loops_of(walls, layer)]
        assert sorted(turns) == [False, False, True, True]


# --- where nothing lies above, and where nothing lies below ---


def stairs() -> Mesh:
    """A step of 8 mm all around at half the height."""
    return step_pyramid([20, 12], [1.0, 1.0])


def test_only_the_outer_perimeter_goes_around_a_top_surface() -> None:
    plan = tuple(0.2 * np.arange(1, 11))
    usual = lay_walls(sections_of(stairs(), plan), plain(perimeters=3))
    single = lay_walls(sections_of(stairs(), plan), plain(perimeters=3, single_top_perimeter=True))

    for layer in range(10):
        roles = single.paths.role[single.paths.layer == layer]
        assert (roles == Role.EXTERNAL_PERIMETER).sum() == 1
        # The step keeps inner ones around what goes on above; the last layer has none.
        assert (roles == Role.PERIMETER).sum() == (0 if layer == 9 else 2)
    gap = bead.spacing(0.45, 0.2)
    wider = single.inside.area() - usual.inside.area()
    assert (wider > 1).tolist() == [layer in {4, 9} for layer in range(10)]
    assert single.inside.area()[9] == pytest.approx((12 - 0.45 - gap) ** 2, abs=1e-2)


@engines
def test_what_lies_inside_and_the_walls_together_are_the_section(engine: str) -> None:
    plan = tuple(0.2 * np.arange(1, 11))
    sections = sections_of(stairs(), plan)
    with using_engine(engine):
        walls = lay_walls(sections, plain(perimeters=3, single_top_perimeter=True))

    paths = walls.paths
    path = np.repeat(np.arange(paths.n_paths), np.diff(paths.start))
    length = np.hypot(*(paths.xy[paths.following] - paths.xy).T)
    laid = np.bincount(paths.layer[path], length * bead.spacing(paths.width, 0.2), minlength=10)
    room = sections.solid.area()
    room[9] -= sections.solid.ring_length()[9] * bead.compute_side_extension(
        0.2
    )  # no inner perimeter fills round sides there
    assert laid + walls.inside.area() == pytest.approx(room, rel=2e-3)


def overhang(step: float) -> Mesh:
    """Layers of 0.2 mm, each wider than the one below by a step on all sides."""
    return joined([box((10 + 2 * step * k,) * 2 + (0.2,), (-step * k,) * 2 + (0.2 * k,)) for k in range(5)])


def test_edges_that_hang_over_air_get_more_perimeters() -> None:
    plan = tuple(0.2 * np.arange(1, 6))
    sections = sections_of(overhang(1.8), plan)
    usual = lay_walls(sections, plain(perimeters=2))
    more = lay_walls(sections, plain(perimeters=2, extra_perimeters=True))

    added = np.bincount(more.paths.layer, minlength=5) - np.bincount(usual.paths.layer, minlength=5)
    assert added[0] == 0
    assert (added[1:] >= 1).all()
    assert (more.inside.area()[1:] < usual.inside.area()[1:] - 10).all()


def test_gentle_overhangs_and_bridges_get_none() -> None:
    plan = tuple(0.2 * np.arange(1, 6))
    table = joined([box((20, 4, 0.4)), box((20, 4, 0.4), (0, 5.2, 0)), box((20, 9.2, 0.6), (0, 0, 0.4))])
    for mesh in (overhang(0.3), table):
        sections = sections_of(mesh, plan)
        usual = lay_walls(sections, plain(perimeters=2))
        more = lay_walls(sections, plain(perimeters=2, extra_perimeters=True))

        assert more.paths.n_paths == usual.paths.n_paths


def test_repeated_layers_have_the_perimeters_that_they_have_alone() -> None:
    """Layers of five kinds, also with narrow places, repeated in any order; the first one and one other differ."""
    solid = sections_of(sphere(1.6), (0.1, 0.2, 0.4, 0.8, 1.2)).solid
    source = np.array([0, 1, 0, 2, 2, 4, 0, 3, 4, 1, 0])
    tops = np.cumsum([0.3, *[0.2] * 8, 0.25, 0.2])
    stack = solid.copy_layers(source)
    profile = plain(perimeters=3)
    walls = lay_walls(Sections(LayerPlan.from_tops(tops), stack), profile)

    for layer, height in enumerate(np.diff(tops, prepend=0)):
        below = [height] if layer == 0 else [tops[0], tops[0] + height]
        copies = stack.copy_layers(np.full(len(below), layer))
        alone = lay_walls(Sections(LayerPlan.from_tops(np.array(below)), copies), profile)
        own, other = (
            one.paths.take(np.flatnonzero(one.paths.layer == at))
            for one, at in ((walls, layer), (alone, len(below) - 1))
        )
        assert own.role.tolist() == other.role.tolist()
        assert own.start.tolist() == other.start.tolist()
        assert own.height.tolist() == pytest.approx(other.height.tolist(), abs=1e-9)
        assert own.width == pytest.approx(other.width, abs=1e-9)
        assert own.xy == pytest.approx(other.xy, abs=1e-9)
        assert walls.inside.area()[layer] == pytest.approx(alone.inside.area()[-1], abs=1e-9)
        assert walls.lost[layer] == pytest.approx(alone.lost[-1], abs=1e-9)
