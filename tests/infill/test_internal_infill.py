"""Sparse regions hold as much plastic as the density says, in lines that stay inside and hold on to the walls."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from printer_slicer import bead
from printer_slicer.arrays import Float
from printer_slicer.geometry import Areas, offset
from printer_slicer.geometry.engine import ENGINES, using_engine
from printer_slicer.infill import PATTERNS, infill_paths
from printer_slicer.inspection.coverage.measurement import coverage_of
from printer_slicer.inspection.coverage.stack import stack_of_program
from printer_slicer.model import Mesh, Toolpaths
from printer_slicer.pipeline import slice_stages
from printer_slicer.profile import Profile
from printer_slicer.roles import Role
from tests.effort import crossed, examples
from tests.infill.stacks import UNEVEN, WIDTH, lengths, outside, rectangle, slots, sparse_only, volumes
from tests.parts import box, box_with_hole, layers, plain, prism, shape, sphere
from tests.strategies import clean_areas, star_rings

patterns = pytest.mark.parametrize("pattern", list(PATTERNS))
MEASURED = [name for name in PATTERNS if name != "lightning"]
measured = pytest.mark.parametrize("pattern", MEASURED)
UNEVENER = np.array([0.08, 0.40, 0.5, 0.82, 0.9, 1.02, 1.34])  # 0.08 to 0.32 mm
TURN = np.linspace(0, 2 * np.pi, 60, endpoint=False)
ROUND = prism(9 * np.stack([np.cos(TURN), np.sin(TURN)], axis=1), 4)


def large(density: float) -> float:
    """mm: a side many times as long as lines are apart."""
    return 32 * WIDTH / density


def sparse_with(pattern: str, density: float, **changes: object) -> Profile:
    return plain(infill=pattern, infill_density=density, **changes)


# --- density ---


@pytest.mark.parametrize(("pattern", "density"), crossed(MEASURED, [0.05, 0.15, 0.4, 0.9]))
def test_density_is_the_share_of_the_volume_at_every_layer_height(pattern: str, density: float) -> None:
    side = large(density)

    paths = infill_paths(sparse_only([rectangle(side, side)], UNEVENER), sparse_with(pattern, density))

    share = volumes(paths) / (side**2 * paths.plan.height)
    assert share == pytest.approx(
        density, rel=0.04
    )  # a wave more or less at the border counts on a single layer
    assert volumes(paths).sum() / (side**2 * UNEVENER[-1]) == pytest.approx(density, rel=0.002)


@pytest.mark.parametrize(("pattern", "engine", "height"), crossed(MEASURED, ENGINES, [0.08, 0.2, 0.32]))
def test_the_density_is_right_without_anchors_too(pattern: str, engine: str, height: float) -> None:
    side = large(0.2)
    wanted = sparse_with(pattern, 0.2, infill_anchor_max=0)
    with using_engine(engine):
        paths = infill_paths(sparse_only([rectangle(side, side)], layers(3, height).top), wanted)

    assert volumes(paths).sum() / (side**2 * 3 * height) == pytest.approx(0.2, rel=0.02)


@measured
@settings(max_examples=examples(4))
@given(x=st.floats(-200, 200), y=st.floats(-200, 200))
def test_the_pattern_belongs_to_the_bed_so_areas_may_lie_anywhere(pattern: str, x: float, y: float) -> None:
    paths = infill_paths(sparse_only([rectangle(60, 50, (x, y))]), sparse_with(pattern, 0.3))

    assert volumes(paths).sum() / (3000 * UNEVEN[-1]) == pytest.approx(0.3, rel=0.02)


@pytest.mark.parametrize("pattern", ["rectilinear", "grid", "triangles", "cubic", "gyroid"])
@settings(max_examples=examples(4))
@given(
    rings=star_rings(),
    density=st.sampled_from([0.12, 0.2, 0.4]),
    heights=st.lists(st.sampled_from([0.08, 0.2, 0.32]), min_size=2, max_size=3),
)
def test_small_rooms_keep_the_density_although_they_have_anchors(
    pattern: str, rings: list[Float], density: float, heights: list[float]
) -> None:
    stack = sparse_only([2 * ring for ring in rings], np.cumsum(heights))
    area = float(stack.internal_infill.area()[0])
    assume(area > (6 * WIDTH / density) ** 2)

    laid = volumes(infill_paths(stack, sparse_with(pattern, density))).sum()

    # A few lines more or less are a percent or two of a room this small; triangles come in threes.
    within = 0.04 if pattern == "triangles" else 0.03
    assert laid / (density * area * sum(heights)) == pytest.approx(1, abs=within)


@measured
def test_more_density_means_more_plastic(pattern: str) -> None:
    stack = sparse_only([rectangle(30, 20)])
    laid = [
        lengths(infill_paths(stack, sparse_with(pattern, d))).sum() for d in (0.05, 0.1, 0.2, 0.4, 0.8, 0.99)
    ]

    assert (np.diff(laid) > 0).all()


@patterns
def test_no_density_means_no_lines(pattern: str) -> None:
    assert infill_paths(sparse_only([rectangle(20, 20)]), sparse_with(pattern, 0)).n_paths == 0


@patterns
def test_full_density_leaves_nothing_sparse(pattern: str) -> None:
    stages = slice_stages(sphere(4), sparse_with(pattern, 1))

    assert stages.regions.internal_infill.n_rings == 0
    assert not (stages.toolpaths.role == Role.INTERNAL_INFILL).any()


@patterns
def test_beads_are_as_wide_as_asked_for_on_the_highest_layers_and_have_one_spacing_on_all(
    pattern: str,
) -> None:
    paths = infill_paths(sparse_only([rectangle(60, 60)]), sparse_with(pattern, 0.2))

    width = paths.width[paths.start[:-1]]
    spacing = bead.spacing(width, paths.height)
    wavy = 0.2 if pattern == "gyroid" else 0.03  # its lines are of different length at different z
    assert width.max() == pytest.approx(WIDTH, rel=wavy)
    assert spacing == pytest.approx(spacing.mean(), rel=wavy)
    assert (width >= paths.height).all()


# --- where ---


@pytest.mark.parametrize(
    ("pattern", "mesh"), crossed(PATTERNS, [box_with_hole((20, 20, 2)), sphere(3), slots(2, 12)])
)
def test_no_line_leaves_the_section(pattern: str, mesh: Mesh) -> None:
    length = outside(slice_stages(mesh, sparse_with(pattern, 0.3)))

    assert length < 1e-3


@patterns
def test_no_sparse_line_crosses_the_mouth_of_a_slot(pattern: str) -> None:
    wanted = sparse_with(pattern, 0.15, infill_angle_deg=90, top_thickness=0.2, bottom_thickness=0.2)

    assert outside(slice_stages(slots(1, 3), wanted)) < 1e-3


@pytest.mark.parametrize(("pattern", "engine"), crossed(PATTERNS, ENGINES))
@settings(max_examples=examples(4))
@given(area=clean_areas(4))
def test_lines_stay_where_centre_lines_may_lie(pattern: str, engine: str, area: Areas) -> None:
    regions = sparse_only([], layers(4, 0.2).top)
    regions = type(regions)(regions.plan, *[Areas.empty(4)] * 4, area, np.zeros(0))
    with using_engine(engine):
        paths = infill_paths(regions, sparse_with(pattern, 0.3, internal_infill_overlap=0))

    room_of = offset(area, float(-bead.spacing(WIDTH, 0.2) / 2))
    for layer in range(4):
        room = shape(room_of, layer).buffer(1e-3)
        for i in np.flatnonzero(paths.layer == layer):
            assert shapely.LineString(paths.path(int(i))).difference(room).length < 1e-3


@patterns
def test_paths_have_a_length_and_no_point_twice(pattern: str) -> None:
    paths = infill_paths(
        sparse_only([rectangle(20, 20), rectangle(4, 4, (8, 8))[::-1]]), sparse_with(pattern, 0.2)
    )

    assert (paths.role == Role.INTERNAL_INFILL).all()
    assert (np.diff(paths.start) >= 2).all()
    assert (np.diff(paths.layer) >= 0).all()
    assert min(float(np.hypot(*np.diff(paths.path(i), axis=0).T).min()) for i in range(paths.n_paths)) > 0


@patterns
def test_areas_too_small_for_a_line_get_none(pattern: str) -> None:
    assert infill_paths(sparse_only([rectangle(0.15, 5)]), sparse_with(pattern, 0.15)).n_paths == 0


@patterns
def test_many_islands_are_filled(pattern: str) -> None:
    side = 32 if pattern == "rectilinear" else 8
    islands = [rectangle(4, 4, (6.0 * x, 6.0 * y)) for x in range(side) for y in range(side)]

    paths = infill_paths(sparse_only(islands, layers(2, 0.2).top), sparse_with(pattern, 0.5))

    island = np.floor(paths.xy / 6).astype(np.int64)
    owner = np.repeat(np.arange(paths.n_paths), np.diff(paths.start))
    assert (island[1:][np.diff(owner) == 0] == island[:-1][np.diff(owner) == 0]).all()
    assert len(np.unique(island[:, 0] * side + island[:, 1])) == side**2


# --- anchors ---


def unanchored(paths: Toolpaths) -> int:
    return 2 * int((~paths.closed).sum())


def test_lines_are_joined_along_the_walls_instead_of_travelled_between() -> None:
    stack = sparse_only([rectangle(40, 40)])
    with_anchors, without = (
        infill_paths(stack, plain(infill_density=0.15, infill_anchor_max=longest)) for longest in (12, 0)
    )

    assert without.n_paths > 100
    assert with_anchors.n_paths < without.n_paths / 8


def test_no_way_along_a_wall_is_longer_than_asked_for() -> None:
    """Lines lie at 45°: what runs along x or y are anchors."""
    for longest in (1.0, 5.0, 9.0):
        wanted = plain(infill="rectilinear", infill_density=0.1, infill_anchor=1, infill_anchor_max=longest)
        paths = infill_paths(sparse_only([rectangle(40, 40)]), wanted)
        for i in range(paths.n_paths):
            step = np.diff(paths.path(i), axis=0)
            on_wall = np.abs(step).min(axis=1) < 1e-6
            ways = np.split(np.hypot(*step.T) * on_wall, np.flatnonzero(np.diff(on_wall)) + 1)
            assert max(float(way.sum()) for way in ways) <= longest + 1e-6


def test_an_end_without_a_neighbour_gets_a_hook() -> None:
    stack = sparse_only([rectangle(6, 40)])
    wanted = {"infill": "rectilinear", "infill_density": 0.05, "infill_angle_deg": 0, "infill_anchor_max": 5}
    hooked, bare = (infill_paths(stack, plain(infill_anchor=hook, **wanted)) for hook in (2.0, 0.0))

    assert {len(bare.path(int(i))) for i in np.flatnonzero(bare.layer == 0)} == {2}
    for i in np.flatnonzero(hooked.layer == 0):
        xy = hooked.path(int(i))
        row = np.argmax(np.hypot(*np.diff(xy, axis=0).T))  # along x
        assert np.abs(xy[[0, -1], 1] - xy[row, 1]) == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("mesh", "degrees"), crossed([box((20, 20, 4)), box_with_hole((20, 20, 4)), ROUND], [0, 20, 45])
)
def test_no_line_lies_on_a_wall_or_on_what_joins_it_to_the_next(mesh: Mesh, degrees: float) -> None:
    wanted = plain(infill="rectilinear", infill_angle_deg=degrees, layer_height=0.2)
    stages = slice_stages(mesh, wanted)
    coverage = coverage_of(
        stack_of_program(stages.program, wanted.material.filament_diameter), stages.sections.solid
    )

    sparse = np.unique(stages.regions.internal_infill.ring_layer)
    assert len(sparse) > 5
    assert coverage.fill.overlap[sparse].max() < 0.2


def test_ends_reach_into_the_innermost_perimeter() -> None:
    wanted = plain(infill_density=0.15, internal_infill_overlap=0.1, layer_height=0.2)
    stages = slice_stages(box_with_hole((30, 30, 4), (10, 10)), wanted)
    paths, layer = stages.toolpaths, 10

    inner = np.flatnonzero((paths.layer == layer) & (paths.role == Role.PERIMETER))
    loops = shapely.union_all([shapely.LinearRing(paths.path(int(i))) for i in inner])
    sparse = np.flatnonzero((paths.layer == layer) & (paths.role == Role.INTERNAL_INFILL))
    nearest = min(loops.distance(shapely.LineString(paths.path(int(i)))) for i in sparse)
    assert nearest == pytest.approx(0.9 * float(bead.spacing(WIDTH, 0.2)), abs=1e-3)
