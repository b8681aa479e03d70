"""Inner perimeters of several layers in one bead: every column as full as before, none too high, none over air."""

from __future__ import annotations

from itertools import accumulate
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from printer_slicer import bead
from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.combine_perimeters import (
    SAME_PLACE,
    combine_perimeters,
    cut_paths,
    find_spans_between,
    find_spans_within,
)
from printer_slicer.extrusion import move_seconds
from printer_slicer.geometry.engine import ENGINES, using_engine
from printer_slicer.inspection.coverage.extrusions import Extrusions
from printer_slicer.inspection.coverage.limits import findings
from printer_slicer.inspection.coverage.measurement import coverage_of
from printer_slicer.inspection.coverage.raster import CellWindow, rasterize_fill, window_mean
from printer_slicer.inspection.coverage.stack import stack_of_program
from printer_slicer.model import Areas, LayerPlan, Sections, Toolpaths
from printer_slicer.overhang_grades import grade_overhangs
from printer_slicer.perimeters import lay_walls
from printer_slicer.pipeline import slice_stages
from printer_slicer.profile import Profile
from printer_slicer.regions import classify
from printer_slicer.roles import Role
from tests.effort import examples, few_of
from tests.parts import box, box_with_hole, layers, plain, shape, shapely, sphere, step_pyramid
from tests.strategies import box as rectangle
from tests.strategies import rectilinear_areas

FINE = {"layer_height": 0.1, "first_layer_height": 0.1}
LIMIT = 0.3
engines = pytest.mark.parametrize("engine", list(ENGINES))


def made(sections: Sections, profile: Profile) -> tuple[Toolpaths, Toolpaths, Int | None]:
    """The perimeters before and after, and the groups of layers."""
    walls = lay_walls(sections, profile)
    paths = grade_overhangs(walls.paths, sections)
    after, groups = combine_perimeters(paths, sections, classify(sections, walls, profile), profile)
    return paths, after, groups


def stack(rings: list[list[Float]], height: float = 0.1) -> Sections:
    """Sections of layers that are all equally high."""
    return Sections(layers(len(rings), height), Areas.from_rings(rings))


def extrusions_of_program(paths: Toolpaths) -> Extrusions:
    """Each segment as a bead of its mean width."""
    following = paths.following
    owner = np.repeat(np.arange(paths.n_paths), np.diff(paths.start))
    width, height = (paths.width + paths.width[following]) / 2, paths.height[owner]
    n = len(owner)
    return Extrusions(
        begin=paths.xy,
        end=paths.xy[following],
        z_top=paths.plan.top[paths.layer[owner]],
        rise=np.zeros(n),
        height=height,
        area=bead.cross_section(width, height),
        purpose=np.zeros(n, np.int64),
        line=np.zeros(n, np.int64),
    )


def columns(paths: Toolpaths, window: CellWindow) -> Float:
    """How high the plastic of all layers is in each cell, mm, in the mean over about a bead's width."""
    beads = extrusions_of_program(paths)
    total = np.zeros((window.deep, window.wide))
    for height in np.unique(beads.height).tolist():
        total += height * rasterize_fill(beads.take(beads.height == height), window)
    return window_mean(total, 2)


def inner_ones(paths: Toolpaths) -> Toolpaths:
    return paths.take(np.flatnonzero(paths.role == Role.PERIMETER))


def is_thick(paths: Toolpaths) -> Bool:
    return np.asarray(paths.height > paths.plan.height[paths.layer] + 1e-6)


def first_layers(paths: Toolpaths) -> Int:
    """(M,) the lowest layer that each bead fills."""
    low = paths.plan.top[paths.layer] - paths.height
    return np.searchsorted(paths.plan.bottom, low - 1e-6).astype(np.int64)


def places_along(paths: Toolpaths, index: int) -> Any:
    """Points 0.2 mm apart along a path, but for the ends of an open one, which may reach around a corner."""
    xy = paths.path(index)
    line = shapely.LineString(np.concatenate([xy, xy[:1]]) if paths.closed[index] else xy)
    trimmed = 0.0 if paths.closed[index] else 0.2
    return shapely.line_interpolate_point(line, np.arange(trimmed, line.length - trimmed, 0.2))


@st.composite
def steps(draw: st.DrawFn) -> Sections:
    """A few different sections, each for a few layers of different heights."""
    shapes = draw(rectilinear_areas(3))
    times = draw(st.lists(st.integers(1, 6), min_size=3, max_size=3))
    source = np.repeat(np.arange(3), times)
    heights = draw(st.sampled_from([[0.1], [0.08, 0.1, 0.12], [0.2, 0.1]]))
    high = [heights[i % len(heights)] for i in range(len(source))]
    return Sections(LayerPlan.from_tops(np.array(list(accumulate(high)))), shapes.copy_layers(source))


@settings(max_examples=examples(8))
@given(sections=steps(), perimeters=st.integers(2, 4), varying=st.booleans())
def test_every_column_holds_as_much_as_before(sections: Sections, perimeters: int, varying: bool) -> None:
    wanted = plain(perimeters_every=LIMIT, perimeters=perimeters, varying_walls=varying)
    before, after, _ = made(sections, wanted)

    volume = [float(extrusions_of_program(paths).volume.sum()) for paths in (before, after)]
    assert volume[1] == pytest.approx(volume[0], rel=1e-3)
    if before.n_paths:
        window = CellWindow.around(before.xy.min(axis=0), before.xy.max(axis=0), 1.0, 0.2)
        total = float(sections.plan.top[-1])
        assert columns(after, window) == pytest.approx(columns(before, window), abs=0.05 * total)


@settings(max_examples=examples(10))
@given(sections=steps(), limit=st.sampled_from([0.15, 0.2, 0.3, 2.0]))
def test_thick_beads_keep_to_their_limit_and_stand_where_every_layer_has_a_perimeter(
    sections: Sections, limit: float
) -> None:
    wanted = plain(perimeters_every=limit, perimeters=3)
    before, after, _ = made(sections, wanted)

    thick = after.take(np.flatnonzero(is_thick(after)))
    assert (thick.height <= min(limit, 0.32) + 1e-6).all()
    assert (thick.width >= np.repeat(thick.height, np.diff(thick.start)) - 1e-9).all()
    assert (thick.role == Role.PERIMETER).all()
    inner = inner_ones(before)
    for i, first in enumerate(first_layers(thick).tolist()):
        points = shapely.MultiPoint(thick.path(i))
        for layer in range(first, int(thick.layer[i]) + 1):
            rings = [inner.path(j) for j in np.flatnonzero(inner.layer == layer).tolist()]
            loops = shapely.MultiLineString([np.concatenate([ring, ring[:1]]) for ring in rings])
            away = shapely.distance(places_along(thick, i), loops)
            assert away.max(initial=0.0) <= 1.3 * SAME_PLACE
        # It rests on the layer below, and the next one lies on it.
        assert first > 0
        assert thick.support_ratio[thick.start[i] : thick.start[i + 1] - 1].min(initial=1.0) >= 1
        assert shapely.covers(shape(sections.solid, int(thick.layer[i]) + 1).buffer(0.1), points)


@engines
def test_a_prism_has_a_third_of_its_inner_perimeters(engine: str) -> None:
    """The first layer is on its own; the last one is seen from above."""
    with using_engine(engine):
        before, after, groups = made(
            stack([[rectangle(0, 0, 20, 20)]] * 11), plain(perimeters_every=LIMIT, infill_density=0)
        )

    inner = inner_ones(after)
    assert groups is not None
    assert inner.layer[is_thick(inner)].tolist() == [3, 6, 9]
    assert inner.height[is_thick(inner)] == pytest.approx([0.3] * 3)
    assert inner.layer[~is_thick(inner)].tolist() == [0, 10]
    assert inner.closed.all()
    # One spacing inside the outer bead, as wide as fills the same.
    gap = float(bead.spacing(inner_ones(before).width[0], 0.1))
    assert gap > float(bead.spacing(0.45, 0.1))  # with what the round sides of the outer ones leave empty
    assert inner.width.max() == pytest.approx(gap + 0.3 * (1 - np.pi / 4), abs=1e-4)


def test_only_the_stretch_that_changes_is_printed_on_every_layer() -> None:
    """A notch in one side, deeper from layer to layer."""
    notched = [
        [
            np.array(
                [
                    (0, 0),
                    (40, 0),
                    (40, 40),
                    (24, 40),
                    (24, 38 - 0.2 * k),
                    (16, 38 - 0.2 * k),
                    (16, 40),
                    (0, 40),
                ],
                np.float64,
            )
        ]
        for k in range(8)
    ]
    before, after, _ = made(stack(notched), plain(perimeters_every=LIMIT, infill_density=0))

    inner = inner_ones(after)
    thick = inner.take(np.flatnonzero(is_thick(inner)))
    assert thick.layer.tolist() == [3, 6]
    assert not thick.closed.any()
    for i in range(thick.n_paths):
        xy = thick.path(i)
        assert not ((np.abs(xy[:, 0] - 20) < 3) & (xy[:, 1] > 30)).any()
    # The other side is there on no layer but those.
    opposite = inner.path(int(np.flatnonzero(inner.layer == 2)[0]))
    assert opposite[:, 1].min() > 30
    volume = [float(extrusions_of_program(paths).volume.sum()) for paths in (before, after)]
    assert volume[1] == pytest.approx(volume[0], rel=2e-4)


def test_slopes_stay_as_they_are() -> None:
    rings = [[rectangle(0.05 * k, 0.05 * k, 20 - 0.05 * k, 20 - 0.05 * k)] for k in range(12)]
    before, after, _ = made(stack(rings), plain(perimeters_every=LIMIT))

    assert not is_thick(after).any()
    assert after.n_paths == before.n_paths


def test_a_hundredth_of_a_millimetre_is_no_change() -> None:
    rings = [[rectangle(0, 0, 20 + 0.01 * (k % 2), 20)] for k in range(12)]
    _, after, _ = made(stack(rings), plain(perimeters_every=LIMIT))

    # All but the first and the last layer; of ten layers three groups of three save as much as four groups.
    assert after.height[is_thick(after)].sum() == pytest.approx(0.95, abs=0.06)


def test_beads_of_one_place_but_of_different_widths_stay_apart() -> None:
    """A wall that is 1.25 and 1.4 mm thick in turns has its middle bead in the same place on every layer."""
    wide = [[rectangle(0, -0.625 - 0.075 * (k % 2), 30, 0.625 + 0.075 * (k % 2))] for k in range(8)]
    even = [[rectangle(0, -0.625, 30, 0.625)]] * 8
    wanted = plain(perimeters_every=LIMIT, perimeters=3)

    assert not is_thick(made(stack(wide), wanted)[1]).any()
    assert is_thick(made(stack(even), wanted)[1]).any()


def test_without_the_setting_or_room_for_two_layers_nothing_is_touched() -> None:
    sections = stack([[rectangle(0, 0, 20, 20)]] * 6)

    for every in (0.0, 0.15):
        before, after, groups = made(sections, plain(perimeters_every=every))
        assert groups is None
        assert after.n_paths == before.n_paths
        assert after.height.tolist() == before.height.tolist()


@pytest.mark.parametrize("outside_in", [False, True])
def test_thick_beads_are_laid_when_the_outer_ones_of_their_layer_are_there(outside_in: bool) -> None:
    wanted = plain(
        **FINE, perimeters_every=LIMIT, perimeters=3, external_perimeter_first=outside_in, raft_height=0.6
    )
    paths = slice_stages(box((20, 20, 4)), wanted).toolpaths

    thick = is_thick(paths) & (paths.role == Role.PERIMETER)
    assert thick.any()
    for layer in np.unique(paths.layer[thick]).tolist():
        here = paths.layer == layer
        outer = np.flatnonzero(here & (paths.role == Role.EXTERNAL_PERIMETER))
        assert outer.max() < np.flatnonzero(here & thick).min()
        infill = np.flatnonzero(here & (paths.role > Role.OVERHANG_PERIMETER))
        assert infill.min(initial=paths.n_paths) > np.flatnonzero(here & thick).max()


def test_perimeters_and_infill_share_their_groups() -> None:
    wanted = plain(**FINE, perimeters_every=LIMIT, internal_infill_every=LIMIT)
    paths = slice_stages(step_pyramid([30, 20], [5.05, 3.0]), wanted).toolpaths

    spans = {
        role: {
            (int(a), int(b))
            for a, b in zip(first_layers(one).tolist(), one.layer.tolist(), strict=True)
            if b > a
        }
        for role in (Role.PERIMETER, Role.INTERNAL_INFILL)
        for one in [paths.take(np.flatnonzero(paths.role == role))]
    }
    assert len(spans[Role.INTERNAL_INFILL]) > 8
    # A perimeter that is seen from above, or that a bridge ends on, is on its own; else groups do not overlap.
    for a, b in spans[Role.INTERNAL_INFILL] - spans[Role.PERIMETER]:
        assert all(b < c or d < a for c, d in spans[Role.PERIMETER])


@given(
    data=st.data(),
    closed=st.booleans(),
    points=st.lists(
        st.tuples(st.integers(-9, 9), st.integers(-9, 9), st.integers(3, 6)), min_size=3, max_size=8
    ),
)
def test_what_is_cut_out_of_a_path_and_what_is_left_make_up_the_path(
    data: st.DataObject, closed: bool, points: list[tuple[int, int, int]]
) -> None:
    xy = np.array([(x, y) for x, y, _ in points], np.float64)
    path = Toolpaths.gathered(
        layers(2, 0.1),
        xy=xy + 1e-3 * np.arange(len(xy))[:, None],
        size=np.array([len(xy)]),
        layer=np.array([1]),
        role=np.array([Role.PERIMETER]),
        width=np.array([width / 10 for _, _, width in points]),
        closed=closed,
    )
    areas = data.draw(rectilinear_areas(2))
    inside = find_spans_within(path, areas, 0.5)
    taken, left = cut_paths(path, inside), cut_paths(path, find_spans_between(path, inside))

    if not len(inside.path):
        assert left.n_paths == 0
        return
    assert (taken.length() >= 0.5 - 1e-6).all()
    for measure in (Toolpaths.length, Toolpaths.area):
        assert measure(taken).sum() + measure(left).sum() == pytest.approx(measure(path).sum())
    assert not taken.closed.any() or left.n_paths == 0


PARTS = {
    "hole": lambda: box_with_hole((16, 16, 3), (5, 4)),
    "pyramid": lambda: step_pyramid([16, 10], [2.0, 2.0]),
    "box": lambda: box((14, 14, 4)),
    "sphere": lambda: sphere(4),
}


@pytest.mark.parametrize("name", few_of(list(PARTS), 2))
def test_the_ledger_finds_nothing_that_it_does_not_find_without(name: str) -> None:
    """The same volume, nothing uncovered, nothing in the air, printed in less time."""
    ledgers, seconds = [], []
    for every in (0.0, LIMIT):
        wanted = plain(**FINE, internal_infill_every=LIMIT, perimeters_every=every)
        stages = slice_stages(PARTS[name](), wanted)
        ledgers.append(
            coverage_of(
                stack_of_program(stages.program, wanted.material.filament_diameter), stages.sections.solid
            )
        )
        seconds.append(float(move_seconds(stages.program, wanted).sum()))

    usual, thick = ledgers
    assert thick.volume.sum() == pytest.approx(usual.volume.sum(), rel=2e-3)
    assert thick.uncovered.area() == pytest.approx(usual.uncovered.area(), abs=0.1)
    # What lies 0.03 mm farther in or out may be in the shell or not.
    assert np.nanmax(np.abs(thick.fill.shell - usual.fill.shell)) < (0.05 if name == "sphere" else 0.01)
    assert {one.code for one in findings(thick)} <= {one.code for one in findings(usual)}
    assert seconds[1] < 0.98 * seconds[0]
