"""Paths of supports: each line lies on another one, none leaves its area, and the plastic is what it should be."""

from __future__ import annotations

import numpy as np
import pytest

from printer_slicer import bead
from printer_slicer.arrays import Float
from printer_slicer.geometry import Areas, crosses_rings, find_enclosing_rings, offset, stroke_lines
from printer_slicer.model import LayerPlan, SupportPlan, Supports, Toolpaths
from printer_slicer.profile import load_profile
from printer_slicer.roles import Role
from printer_slicer.supports.styles import measure_path_volume
from printer_slicer.supports.support_paths import make_support_paths
from printer_slicer.supports.trees import grow_trees
from tests.supports.by_stages import columns_of, prepared
from tests.supports.shapes import bracket, hook, mushroom, sphere_on_bed, tee

PROFILE = load_profile()
WIDTH = PROFILE.extrusion_width


def rows_of(paths: Toolpaths, layer: int) -> Float:
    """The y of all lines along x of the base, without repetitions, mm."""
    begin, end = paths.ends_of_beads
    owner = paths.path_of_bead
    level = np.abs(paths.xy[begin, 1] - paths.xy[end, 1]) < 1e-9
    here = (paths.layer[owner] == layer) & (paths.role[owner] == Role.SUPPORT) & ~paths.closed[owner] & level
    return np.unique(np.round(paths.xy[begin[here], 1], 4))


def block(*rings: Float, n_layers: int = 4, hollow: bool = False) -> Supports:
    """The same area in all layers."""
    area = Areas.from_rings([list(rings)] * n_layers)
    none = Areas.empty(n_layers)
    layers = LayerPlan.from_tops(np.arange(1, n_layers + 1) * 0.2)
    plan = SupportPlan(layers, np.zeros(0, np.int64), np.zeros(0))
    return Supports(plan, area, none, none, none, area if hollow else none)


def rectangle(x: float, y: float, width: float, depth: float) -> Float:
    """A ring."""
    return np.array([(x, y), (x + width, y), (x + width, y + depth), (x, y + depth)])


@pytest.mark.parametrize("make", [tee, mushroom, sphere_on_bed, bracket], ids=lambda make: make.__name__)
def test_lines_lie_on_lines(make: type) -> None:
    supports, _, profile = columns_of(make())
    paths = make_support_paths(supports, profile)

    used = np.flatnonzero(supports.base.used)
    for layer in used[1:]:
        above, below = rows_of(paths, layer), rows_of(paths, layer - 1)
        if len(below):  # else there are only loops, or only a floor, below
            assert np.isin(above, below).all()


def test_the_first_layer_has_a_row_between_two() -> None:
    paths = make_support_paths(block(rectangle(0, 0, 40, 40)), PROFILE)
    first, above = rows_of(paths, 0), rows_of(paths, 1)

    assert np.diff(above) == pytest.approx(np.diff(above)[0], abs=1e-3)
    assert np.diff(above)[0] == pytest.approx(PROFILE.quality.support_spacing, rel=0.1)
    assert len(first) in {2 * len(above) - 1, 2 * len(above), 2 * len(above) + 1}
    assert (paths.closed & (paths.layer == 0)).sum() == 1
    assert not paths.closed[paths.layer > 0].any()


def test_the_outermost_rows_lie_near_the_edges() -> None:
    for depth in (3.0, 7.0, 10.7, 22.0, 41.0):
        rows = rows_of(make_support_paths(block(rectangle(0, 0, 40, depth)), PROFILE), 1)
        assert rows[[0, -1]] == pytest.approx([0.9, depth - 0.9], abs=1e-3)
        assert np.diff(rows).max(initial=0.0) <= 1.25 * PROFILE.quality.support_spacing + 1e-3


def test_interfaces_end_near_the_rows_below() -> None:
    supports, _, profile = columns_of(mushroom())
    paths = make_support_paths(supports, profile)
    lowest = int(np.flatnonzero(supports.interface.used)[0])
    below = paths.take(np.flatnonzero(paths.layer == lowest - 1))
    near = stroke_lines(
        below.xy, below.start, below.layer, np.full(below.n_paths, 1.8), supports.base.n_layers
    )
    points = paths.xy[np.repeat(paths.layer == lowest, np.diff(paths.start))]

    ring = find_enclosing_rings(near, points, np.full(len(points), lowest - 1))
    assert len(points) > 100
    assert (near.ring_area()[ring[ring >= 0]] > 0).mean() > 0.99
    assert (ring >= 0).all()


def test_loops_of_slim_columns_lie_on_loops() -> None:
    supports, _, profile = columns_of(sphere_on_bed())
    paths = make_support_paths(supports, profile)
    loops = paths.take(np.flatnonzero(paths.closed & (paths.role == Role.SUPPORT)))
    half, n = np.full(loops.n_paths, WIDTH / 2), supports.base.n_layers
    cover = stroke_lines(loops.xy, loops.start, loops.layer, half, n)
    upper = loops.take(np.flatnonzero(loops.layer > 0))
    owner = np.repeat(np.arange(upper.n_paths), np.diff(upper.start))
    ring = find_enclosing_rings(cover, upper.xy, upper.layer[owner] - 1)
    hanging = np.bincount(owner, ring < 0, upper.n_paths) / np.diff(upper.start)

    assert upper.n_paths
    assert hanging.max() < 0.5


def test_no_zigzag_crosses_a_wall_between_two_rows() -> None:
    one, other = rectangle(0, 0, 40, 1.0), rectangle(0, 1.5, 40, 38.5)
    supports = block(one, other)
    paths = make_support_paths(supports, PROFILE)
    begin, end = paths.ends_of_beads
    layer = np.repeat(paths.layer, paths.beads_of_each)

    assert not crosses_rings(supports.base, paths.xy[begin], paths.xy[end], layer).any()


def test_beads_stay_within_their_areas() -> None:
    supports, _, profile = columns_of(mushroom())
    paths = make_support_paths(supports, profile)
    begin, end = paths.ends_of_beads
    layer = np.repeat(paths.layer, paths.beads_of_each)
    straight = np.abs(paths.xy[begin, 1] - paths.xy[end, 1]) < 1e-9

    within = offset(supports.base.merge(supports.interface), 0.01)
    assert not crosses_rings(
        within, paths.xy[begin[straight]], paths.xy[end[straight]], layer[straight]
    ).any()


def test_slim_columns_have_loops_down_to_the_foot() -> None:
    supports, _, profile = columns_of(hook())
    paths = make_support_paths(supports, profile)

    base = np.flatnonzero(supports.base.used)
    assert np.isin(base, paths.layer[paths.closed]).all()


def test_wide_columns_have_loops_only_on_request() -> None:
    plain = make_support_paths(block(rectangle(0, 0, 40, 40)), PROFILE)
    two = make_support_paths(block(rectangle(0, 0, 40, 40)), load_profile(changes={"support_walls": 2}))

    assert np.bincount(plain.layer[plain.closed], minlength=4).tolist() == [1, 0, 0, 0]
    assert np.bincount(two.layer[two.closed], minlength=4).tolist() == [2, 2, 2, 2]


def test_plastic_of_a_base_is_that_of_its_rows() -> None:
    paths = make_support_paths(block(rectangle(0, 0, 100, 100), n_layers=2), PROFILE)
    above = paths.take(np.flatnonzero(paths.layer == 1))

    section = float(bead.cross_section(WIDTH, 0.2))
    rows = 100 / PROFILE.quality.support_spacing
    steps = (rows - 1) * PROFILE.quality.support_spacing
    assert measure_path_volume(above) == pytest.approx((rows * (100 - WIDTH) + steps) * section, rel=0.01)


def test_plastic_of_an_interface_fills_its_share() -> None:
    area = Areas.from_rings([[rectangle(0, 0, 50, 50)]] * 2)
    none = Areas.empty(2)
    plan = SupportPlan(LayerPlan.from_tops(np.array([0.2, 0.4])), np.zeros(0, np.int64), np.zeros(0))
    paths = make_support_paths(Supports(plan, none, area, none, none, none), PROFILE)
    above = paths.take(np.flatnonzero(paths.layer == 1))

    share = float(bead.cross_section(WIDTH, 0.2)) / (WIDTH + PROFILE.quality.support_interface_spacing)
    assert measure_path_volume(above) == pytest.approx(2500 * share, rel=0.04)
    assert (above.role == Role.SUPPORT_INTERFACE).all()


def test_branches_are_loops_and_thick_ones_have_two() -> None:
    thin, thick = block(rectangle(0, 0, 2, 2), hollow=True), block(rectangle(0, 0, 4, 4), hollow=True)

    for supports, loops in ((thin, 1), (thick, 2)):
        paths = make_support_paths(supports, PROFILE)
        assert paths.closed.all()
        assert np.bincount(paths.layer).tolist() == [loops] * 4


def test_joists_are_single_lines() -> None:
    overhangs, plan, sections, profile = prepared(tee())
    supports = grow_trees(overhangs, plan, sections, profile)
    paths = make_support_paths(supports, profile)

    joists = paths.take(np.flatnonzero(~paths.closed & (paths.role == Role.SUPPORT) & (paths.layer > 0)))
    covered = supports.joists.area().sum()
    assert (np.diff(joists.start) == 2).all()
    assert (joists.length() + WIDTH).sum() * WIDTH == pytest.approx(covered, rel=0.05)
