"""How much of a perimeter's bead is carried, and what is done about the rest."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import given

from printer_slicer.arrays import Float
from printer_slicer.model import Areas, Fan, LayerPlan, Mesh, Program, Sections, Toolpaths
from printer_slicer.overhang_grades import grade_overhangs
from printer_slicer.perimeters import lay_walls
from printer_slicer.pipeline import slice_part
from printer_slicer.roles import Role
from printer_slicer.slicing import cut
from tests.parts import box, joined, layers, plain, shape, shapely, sphere
from tests.strategies import clean_areas

WIDTH = 0.45


def square(side: float, at: tuple[float, float] = (0.0, 0.0)) -> Float:
    return np.array([(0, 0), (side, 0), (side, side), (0, side)], dtype=np.float64) + at


def beads(areas: Areas, tops: Float | None = None) -> tuple[Toolpaths, Sections]:
    plan = LayerPlan.from_tops(np.arange(1, areas.n_layers + 1) * 0.2 if tops is None else tops)
    sections = Sections(plan, areas)
    return lay_walls(sections, plain()).paths, sections


def pieces(paths: Toolpaths) -> tuple[Float, Float, Float]:
    """Middle (K, 2), length (K,) and carried share (K,) of every straight piece of closed paths."""
    ends = []
    for i in range(paths.n_paths):
        xy = paths.path(i)
        ends.append(np.stack([xy, np.roll(xy, -1, axis=0)], axis=1))
    both = np.concatenate(ends)
    return both.mean(axis=1), np.hypot(*(both[:, 1] - both[:, 0]).T), paths.support_ratio


@pytest.mark.parametrize("shift", [0.0, 0.05, 0.15, 0.25, 0.35, 0.5, 3.0])
def test_a_wall_set_out_over_another_is_carried_by_what_is_left_of_its_bead(shift: float) -> None:
    """The side that stands out by `shift`: its bead has 1 - shift / width over the layer below."""
    paths, sections = beads(Areas.from_rings([[square(20)], [square(20, (shift, 0))]]))
    after = grade_overhangs(paths, sections)

    middle, _, carried = pieces(after)
    layer = np.repeat(after.layer, np.diff(after.start))
    out = (layer == 1) & (middle[:, 0] > 20 + shift - WIDTH) & (np.abs(middle[:, 1] - 10) < 8)
    share = max(1 - shift / WIDTH, 0.0)
    assert carried[out] == pytest.approx(1.0 if share > 0.9 else share, abs=0.01)
    assert (carried[layer == 0] == 1).all()


def test_walls_that_stand_on_each_other_stay_as_they_are() -> None:
    paths, sections = beads(Areas.from_rings([[square(20)]] * 4))
    after = grade_overhangs(paths, sections)

    assert np.array_equal(after.xy, paths.xy)
    assert (after.support_ratio == 1).all()


@given(areas=clean_areas(3))
def test_paths_keep_their_points_and_their_way(areas: Areas) -> None:
    paths, sections = beads(areas)
    after = grade_overhangs(paths, sections)

    assert after.n_paths == paths.n_paths
    for i in range(paths.n_paths):
        before, now = paths.path(i), after.path(i)
        ring = np.concatenate([before, before[:1]])
        assert {tuple(xy) for xy in before.tolist()} <= {tuple(xy) for xy in now.tolist()}
        assert shapely.distance(shapely.linestrings(ring), shapely.points(now)) == pytest.approx(0, abs=1e-9)
        length = np.hypot(*np.diff(np.concatenate([now, now[:1]]), axis=0).T).sum()
        assert length == pytest.approx(np.hypot(*np.diff(ring, axis=0).T).sum())


@given(areas=clean_areas(3))
def test_what_is_deep_over_the_layer_below_is_carried_and_what_is_far_out_is_not(areas: Areas) -> None:
    paths, sections = beads(areas)
    after = grade_overhangs(paths, sections)

    middle, length, carried = pieces(after) if after.n_paths else (np.zeros((0, 2)), np.zeros(0), np.zeros(0))
    layer = np.repeat(after.layer, np.diff(after.start))
    for k in (1, 2):
        below, here = shape(areas, k - 1), (layer == k) & (length > 2 * WIDTH)
        spots = shapely.points(middle[here])
        away = (
            shapely.distance(below.boundary, spots)
            if not shapely.is_empty(below)
            else np.full(len(spots), 9.0)
        )
        inside = shapely.contains(below, spots)
        clear = away > length[here] / 2 + 2 * WIDTH  # whole pieces, and more than what joins short stretches
        assert (carried[here][clear & inside] == 1).all()
        assert (carried[here][clear & ~inside] < 0.05).all()


def test_on_uneven_layers_the_share_follows_the_step_of_each() -> None:
    """A stump that widens by 45 degrees: thick layers step out farther."""
    heights = np.array([0.2, 0.1, 0.1, 0.3, 0.3, 0.15, 0.15, 0.2, 0.2, 0.25, 0.25])
    plan = LayerPlan.from_tops(np.cumsum(heights))
    low = box((20, 20, 2.2), (-10, -10, 0)).triangles.copy()
    low[low[:, :, 2] > 0, :2] *= 24.4 / 20
    sections = cut(Mesh(low), plan, 0.0125)
    after = grade_overhangs(lay_walls(sections, plain()).paths, sections)

    step = np.diff(plan.cut, prepend=0.0)
    _, length, carried = pieces(after)
    layer = np.repeat(after.layer, np.diff(after.start))
    outer = np.repeat(after.role == Role.EXTERNAL_PERIMETER, np.diff(after.start))
    for k in range(1, plan.n_layers):
        here = (layer == k) & outer
        mean = float((length[here] * carried[here]).sum() / length[here].sum())
        share = 1 - step[k] / WIDTH
        assert mean == pytest.approx(share if share < 0.9 else 1.0, abs=0.03)


def test_a_path_turned_around_keeps_what_its_pieces_are_carried_by() -> None:
    from printer_slicer.ordering import order

    plan = LayerPlan.from_tops(np.array([0.2]))
    xy = np.array([(9.0, 5), (8, 5), (3, 5), (1, 5), (0.5, 5)])
    path = Toolpaths.gathered(
        plan,
        xy=xy,
        size=np.array([5]),
        layer=np.array([0]),
        role=np.array([Role.INTERNAL_INFILL]),
        width=np.array([WIDTH]),
        closed=False,
        support_ratio=np.array([0.1, 0.2, 0.3, 0.4, 1.0]),
    )
    after = order(path, Sections(plan, Areas.from_rings([[square(10)]])), plain())

    assert np.array_equal(after.xy, xy[::-1])
    assert after.support_ratio[:4].tolist() == [0.4, 0.3, 0.2, 0.1]


# --- speed, fan, name ---


@cache
def mushroom() -> Program:
    """A stalk under a cap that stands out on all sides, and a ball: every grade."""
    part = joined([box((10, 10, 3), (10, 10, 0)), box((12, 12, 2), (9, 9, 3)), sphere(4).moved((40, 15, 0))])
    return slice_part(part, plain(solid_infill_below_area=0), plan=layers(39, 0.2))


def test_beads_carried_by_less_than_half_are_overhang_perimeters_and_slow() -> None:
    program, speeds = mushroom(), plain().speeds
    hangs = program.role == Role.OVERHANG_PERIMETER

    assert hangs.any()
    assert program.layer[hangs].min() > 0
    assert (program.speed[hangs] <= speeds.overhang_50_ratio * speeds.perimeter + 1e-9).all()
    slowest = np.unique(program.speed[hangs & (program.layer == 15)]).min()
    assert slowest == pytest.approx(
        min(speeds.overhang_0_ratio * speeds.external_perimeter, speeds.bridge), rel=0.05
    )


def test_speed_changes_with_the_share_and_not_in_steps() -> None:
    program = mushroom()
    speeds = program.speed[(program.role == Role.EXTERNAL_PERIMETER) & (program.layer > 0)]

    assert len(np.unique(np.round(speeds, 1))) > 5  # grades have their own, and so has what is between


def test_the_fan_is_stronger_on_overhangs() -> None:
    wanted = plain(solid_infill_below_area=0, **{"material.fan_ratio": 0.2, "material.fan_ratio_max": 0.2})
    part = joined([box((20, 20, 3), (10, 10, 0)), box((26, 26, 2), (7, 7, 3))])
    program = slice_part(part, wanted, plan=layers(25, 0.2))
    fans = [event for event in program.events if isinstance(event, Fan)]
    index, ratio = np.array([event.index for event in fans]), np.array([event.ratio for event in fans])
    at = ratio[np.searchsorted(index, np.arange(program.n_moves), side="right") - 1]

    hangs = program.role == Role.OVERHANG_PERIMETER
    assert hangs.any()
    assert (at[hangs] > 0.5).all()
    assert at[(program.role == Role.EXTERNAL_PERIMETER) & (program.layer > 17)] == pytest.approx(0.2)
