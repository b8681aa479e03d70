"""Trees: branches that never begin in the air, keep their distance, and reach every strip that hangs."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import printer_slicer as ps
from printer_slicer.arrays import Float, Int, consecutive
from printer_slicer.geometry import (
    difference,
    intersection,
    normalize,
    offset,
    split_connected,
    union,
)
from printer_slicer.model import Areas, LayerPlan, Mesh, Sections, SupportPlan, Supports
from printer_slicer.supports.tree_settings import read_tree_settings
from printer_slicer.supports.trees import grow_trees
from tests.effort import examples
from tests.parts import loft, plain
from tests.supports.by_hand import overhangs_of, prepared, support_plan
from tests.supports.loops import draw_plastic, find_hanging_stretches
from tests.supports.noise import noise_sections
from tests.supports.shapes import bracket, hook, mushroom, ramp_in_a_room, sphere_on_bed, table, tee

SHAPES: dict[str, Callable[[], Mesh]] = {
    "tee": tee,
    "hook": hook,
    "sphere": sphere_on_bed,
    "mushroom": mushroom,
    "bracket": bracket,
    "table": lambda: table(40, 30, 20),
}
SEEDS = st.integers(0, 100_000)
XY_GAP = 0.5
shapes = pytest.mark.parametrize("name", SHAPES)


@cache
def grown(name: str) -> tuple[Supports, Sections]:
    overhangs, plan, sections = prepared(SHAPES[name]())
    return grow_trees(overhangs, plan, sections, plain()), sections


def grown_on_noise(seed: int, **changes: object) -> tuple[Supports, Sections]:
    sections = noise_sections(seed)
    overhangs = overhangs_of(sections)
    return grow_trees(overhangs, support_plan(overhangs), sections, plain(**changes)), sections


def check_chains(supports: Supports, sections: Sections) -> None:
    """Every piece goes down within the slope to another piece, to the bed, or to the top of the part."""
    pieces, layers = supports.branches, supports.plan.layers
    limits = read_tree_settings(plain(), float(layers.height.max()), float(layers.top[-1]))
    low, high = pieces[:, :4], pieces[:, 4:]
    assert (high[:, 0] > low[:, 0]).all()
    aside = np.hypot(*(high - low)[:, 1:3].T) + low[:, 3] - high[:, 3]
    assert (aside <= limits.slope * (high[:, 0] - low[:, 0]) + 1e-3).all()
    assert (low[:, 3] >= high[:, 3] - 1e-9).all()
    assert (high[:, 3] >= limits.tip_radius - 1e-9).all()
    going_on = {tuple(end) for end in np.round(high[:, :3], 6).tolist()}
    ends = [end for end in np.round(low[:, :3], 6).tolist() if tuple(end) not in going_on]
    for z, x, y in ends:
        if z > 0:
            layer = np.flatnonzero(np.isclose(sections.plan.top, z, atol=1e-4))
            assert len(layer) == 1, "an end in the air"
            assert contains(sections.solid, x, y, int(layer[0]))


def contains(areas: Areas, x: float, y: float, layer: int) -> bool:
    dot = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * 1e-3 + (x, y)
    stack = Areas.from_rings([[dot] if k == layer else [] for k in range(areas.n_layers)])
    return float(difference(stack, areas).area().sum()) < 1e-9


def unite_layers(areas: Areas, first: Int, last: Int) -> Areas:
    """For each entry the union of the layers from `first` to `last` - 1."""
    count = np.maximum(last - first, 0)
    entry = np.repeat(np.arange(len(first)), count)
    copies = areas.copy_layers(consecutive(first, count))
    return normalize(Areas(copies.xy, copies.ring_start, entry[copies.ring_layer], len(first)))


def find_pieces_in_the_air(supports: Supports, sections: Sections) -> Float:
    """Areas of the connected pieces of which less than a seventh lies over supports, part or bed."""
    layers, plan = supports.plan.layers, sections.plan
    areas = normalize(supports.area)
    part = unite_layers(
        sections.solid,
        np.searchsorted(plan.top, layers.bottom - 0.6),
        np.searchsorted(plan.top, layers.bottom + 1e-6),
    )
    pieces = split_connected(areas)
    carriers = union(areas.shift_layers(1), part)
    carried = intersection(pieces.areas, pieces.select_nearby_rings(carriers)).area()
    size = pieces.areas.area()
    return np.asarray(size[(carried < size / 7) & (pieces.layer > 0)])


def measure_overlap(supports: Supports, sections: Sections, gap: float) -> float:
    """Volume of supports nearer than `gap` to the part beside them, mm³."""
    layers, plan = supports.plan.layers, sections.plan
    beside = unite_layers(
        sections.solid,
        np.searchsorted(plan.top, layers.bottom + 1e-6, side="right"),
        np.searchsorted(plan.bottom, layers.top - 1e-6),
    )
    near = offset(beside, gap)
    return float(intersection(normalize(supports.area), near).area() @ layers.height)


@shapes
def test_branches_lead_to_the_bed_or_to_the_part(name: str) -> None:
    supports, sections = grown(name)

    assert len(supports.branches)
    assert not supports.unsupported
    check_chains(supports, sections)


@shapes
def test_nothing_begins_in_the_air(name: str) -> None:
    assert len(find_pieces_in_the_air(*grown(name))) == 0


@shapes
def test_trees_keep_their_distance_from_the_part(name: str) -> None:
    assert measure_overlap(*grown(name), XY_GAP - 0.01) < 1e-3


@shapes
def test_areas_of_a_layer_do_not_overlap(name: str) -> None:
    supports, _ = grown(name)

    together = supports.area.area().sum()
    assert normalize(supports.area).area().sum() == pytest.approx(together, rel=1e-4)
    assert difference(supports.hollow, supports.base).area().sum() < 1e-6


@shapes
def test_everything_that_hangs_has_a_support_near_it(name: str) -> None:
    supports, sections = grown(name)
    overhangs = overhangs_of(sections)
    hanging = np.flatnonzero(overhangs.area.used & (supports.plan.carrier >= 0))
    layers = supports.plan.layers
    bottom = sections.plan.bottom[hanging]
    first = np.searchsorted(layers.top, bottom - 0.85 - 1e-6)
    below = unite_layers(
        offset(normalize(supports.area), 1.5), first, np.searchsorted(layers.top, bottom + 1e-6)
    )

    bare = difference(overhangs.area.copy_layers(hanging), below).area().sum()

    assert bare <= 0.003 * overhangs.area.area().sum()


@given(seed=SEEDS)
@settings(max_examples=examples(6))
def test_trees_among_random_solids(seed: int) -> None:
    supports, sections = grown_on_noise(seed)

    check_chains(supports, sections)
    assert measure_overlap(supports, sections, XY_GAP - 0.01) < 1e-3
    # What is cut off beside narrow passages is found by the check of what stands; here it must be next to nothing.
    in_the_air = find_pieces_in_the_air(supports, sections)
    assert in_the_air.sum() <= 1e-3 * normalize(supports.area).area().sum()
    assert len(in_the_air) <= 5


@given(seed=SEEDS)
@settings(max_examples=examples(3))
def test_on_the_bed_only(seed: int) -> None:
    supports, _ = grown_on_noise(seed, support_on_bed_only=True)

    low, high = (np.round(ends, 6) for ends in (supports.branches[:, :3], supports.branches[:, 4:7]))
    going_on = {tuple(end) for end in high.tolist()}
    assert all(end[0] == 0 for end in low.tolist() if tuple(end) not in going_on)


def test_the_same_part_gets_the_same_trees() -> None:
    overhangs, plan, sections = prepared(bracket())

    one, other = (grow_trees(overhangs, plan, sections, plain()) for _ in range(2))

    assert one.branches.tobytes() == other.branches.tobytes()
    for name in ("base", "interface", "joists", "hollow"):
        assert getattr(one, name).xy.tobytes() == getattr(other, name).xy.tobytes()


def test_the_order_of_facets_changes_nothing() -> None:
    mesh = mushroom()
    mixed = Mesh(mesh.triangles[np.random.default_rng(1).permutation(mesh.n_facets)], mesh.name)

    one, other = (grow_trees(*prepared(part), plain()) for part in (mesh, mixed))

    assert one.branches == pytest.approx(other.branches, abs=1e-6)


def test_nothing_hangs_nothing_grows() -> None:
    sections = noise_sections(1)
    overhangs = overhangs_of(sections)
    none = Areas.empty(sections.plan.n_layers)
    empty = type(overhangs)(overhangs.plan, none, np.zeros(0, np.int64), none, none, overhangs.is_flat)
    nothing = np.full(sections.plan.n_layers, -1)
    plan = SupportPlan(LayerPlan.from_tops(np.zeros(0)), nothing, np.full(len(nothing), np.nan))

    supports = grow_trees(empty, plan, sections, plain())

    assert not supports.area.n_rings
    assert not len(supports.branches)
    assert not supports.unsupported


@pytest.mark.parametrize("source", ["tee", "hook", "sphere", "mushroom", 0, 1])
def test_loops_of_branches_lie_on_loops_below(source: str | int) -> None:
    """Each loop is carried by half its width; only short stretches bridge the inside of a branch."""
    supports, sections = grown(source) if isinstance(source, str) else grown_on_noise(source)
    layers, plan = supports.plan.layers, sections.plan
    part = unite_layers(
        sections.solid,
        np.searchsorted(plan.top, layers.bottom - 0.6),
        np.searchsorted(plan.top, layers.bottom + 1e-6),
    )

    hanging, loops = find_hanging_stretches(supports, part)

    assert loops.sum() > 0
    assert hanging.sum() <= 0.01 * loops.sum()
    assert (hanging > 1.0).sum() <= (0.004 if isinstance(source, str) else 0.01) * len(loops)
    assert hanging.max(initial=0.0) < (
        2.2 if isinstance(source, str) else 3.0
    )  # less than the joists of a roof


def test_branches_stand_on_the_part_only_where_that_saves_their_price() -> None:
    """Over a low plate, the way down beside it is long: with a low price branches stand on it, with a high one not."""
    overhangs, plan, sections = prepared(bracket())

    standing = []
    for price in (0.0, 1000.0):
        pieces = grow_trees(overhangs, plan, sections, plain(support_bed_detour=price)).branches
        low, high = (np.round(ends, 6) for ends in (pieces[:, :3], pieces[:, 4:7]))
        going_on = {tuple(end) for end in high.tolist()}
        standing.append({tuple(end) for end in low.tolist() if tuple(end) not in going_on and end[0] > 0})

    assert standing[0]
    assert not standing[1]
    assert {z for z, _, _ in standing[0]} == {4.0}


def test_branches_stand_on_a_ramp_where_no_way_leads_to_the_bed() -> None:
    overhangs, plan, sections = prepared(ramp_in_a_room())

    supports = grow_trees(overhangs, plan, sections, plain())

    assert not supports.unsupported
    assert supports.branches[:, 0].min() > 0
    check_chains(supports, sections)
    assert len(find_pieces_in_the_air(supports, sections)) == 0


def test_trees_of_a_tee_are_light() -> None:
    """Loops of 0.45 mm, roofs of two layers and joists for 500 mm² weigh 2 g in PLA; columns weigh 4 g."""
    supports, _ = grown("tee")

    volume = float(draw_plastic(supports).area() @ supports.plan.layers.height)

    assert 800 < volume < 1850


def test_lines_of_roofs_run_across_joists() -> None:
    supports, _ = grown("tee")  # its arms point along x, and so do the joists

    roofs = supports.interface.ring_layer >= supports.interface.ring_layer.max() - 1
    angle = supports.interface_angle[roofs]
    assert np.isfinite(angle).any()
    assert angle[np.isfinite(angle)] == pytest.approx(np.pi / 2)


@pytest.mark.parametrize("n", [0, 1, 3])
def test_roofs_have_as_many_closed_layers_as_the_settings_say(n: int) -> None:
    """Over joists, which touch the overhang themselves if there are none."""
    supports = grow_trees(*prepared(tee()), plain(support_interface_layers=n))
    top = supports.plan.layers.n_layers - 1

    roof = np.flatnonzero(supports.interface.area() > 100)
    assert roof.tolist() == list(range(top - n + 1, top + 1))
    assert supports.joists.used.nonzero()[0].tolist() == [top - n]
    assert not supports.unsupported


@pytest.mark.parametrize("seed", [33, 38, 46, 80])
def test_roofs_and_branches_beside_narrow_passages_do_not_begin_in_the_air(seed: int) -> None:
    """The part is in the way of joists there, and cuts branches off."""
    assert len(find_pieces_in_the_air(*grown_on_noise(seed))) == 0


@pytest.mark.parametrize("seed", [33, 46])
def test_bare_places_have_the_area_that_no_tip_reaches(seed: int) -> None:
    supports, sections = grown_on_noise(seed)
    area = np.array([place.area for place in supports.unsupported])

    assert (area >= 0).all()
    assert 1.0 < area.sum() < overhangs_of(sections).area.area().sum()


@pytest.mark.parametrize("height", [0.2, 0.22, 0.24])
def test_slopes_near_the_threshold_get_tips_at_any_layer_height(height: float) -> None:
    rise = 12 * np.tan(np.deg2rad(38.0))
    side = np.array([(0, 0), (3, 0), (3, 20), (15, 20 + rise), (15, 40), (0, 40)])
    part = Mesh(loft([side, side], [0.0, 14.0])[..., [0, 2, 1]][:, ::-1], "slope")
    profile = ps.load_profile(quality="standard", changes={"support": "tree", "layer_height": height})

    supports = ps.slice_stages(part, profile).supports

    assert supports is not None
    assert sum(place.area for place in supports.unsupported) <= 0.1 * 12 * 14


def test_tips_are_no_thinner_and_no_closer_than_can_be_printed() -> None:
    least = plain(
        support_joist_spacing=0.5,
        support_tip_distance=0.5,
        support_tip_diameter=0.2,
        support_branch_diameter=0.5,
    )
    width, limits = least.extrusion_width, read_tree_settings(least, 0.2, 30.0)

    assert limits.joist == pytest.approx(3 * width)
    assert limits.tip_distance >= 2 * limits.tip_radius
    assert limits.branch_radius >= limits.tip_radius >= width
