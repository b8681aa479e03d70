"""Sparse infill of several layers in one bead: every place filled once, no bead too high, as much plastic as before."""

from __future__ import annotations

from itertools import accumulate

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer import bead
from printer_slicer.arrays import Float
from printer_slicer.extrusion import move_seconds
from printer_slicer.geometry import Areas, difference, intersection
from printer_slicer.geometry.engine import ENGINES, using_engine
from printer_slicer.infill import PATTERNS, infill_paths
from printer_slicer.infill.combined_infill import InfillAreas, combine_infill_areas, group_layers
from printer_slicer.model import LayerPlan
from printer_slicer.pipeline import slice_stages
from printer_slicer.roles import Role
from tests.infill.stacks import rectangle, sparse_only, sparse_stack, volumes
from tests.parts import box, case_study, layers, plain, sphere, step_pyramid
from tests.strategies import rectilinear_areas

patterns = pytest.mark.parametrize("pattern", [name for name in PATTERNS if name != "lightning"])
heights = st.lists(st.sampled_from([0.08, 0.1, 0.12, 0.2, 0.28, 0.32]), min_size=2, max_size=9)
LIMIT = 0.32


def filled(areas: Areas, tops: Float, limit: float = LIMIT) -> InfillAreas:
    plan = LayerPlan.from_tops(tops)
    return combine_infill_areas(areas, plan, group_layers(areas, plan, limit), 0.4)


def height_of(made: InfillAreas) -> Float:
    """(E,) with 0 where nothing is filled."""
    return np.where(made.area.used, made.height, 0.0)


@given(st.data())
def test_every_place_is_filled_once_but_for_strips_that_no_bead_fits_in(data: st.DataObject) -> None:
    tops = np.array(list(accumulate(data.draw(heights))))
    areas = data.draw(rectilinear_areas(len(tops)))
    made = filled(areas, tops)
    bottom = np.append(0, tops[:-1])

    spans = [
        (float(tops[k]) - float(h), float(tops[k])) for k, h in zip(made.layer, made.height, strict=True)
    ]
    for layer in range(len(tops)):
        middle = (float(tops[layer]) + float(bottom[layer])) / 2
        covering = [e for e, (low, high) in enumerate(spans) if low < middle < high]
        own = areas.select(areas.ring_layer == layer)
        parts = [on_layer(made.area, e, layer, len(tops)) for e in covering]
        held = sum(float(part.area().sum()) for part in parts)
        assert held <= own.area().sum() + 1e-3
        for part in parts:
            assert difference(part, own).area().sum() < 1e-3
        if len(parts) == 2:
            assert intersection(*parts).area().sum() < 1e-3
        if len(covering) == 1 or not any(part.n_rings for part in parts[1:]):
            continue
        left = own
        for part in parts:
            left = difference(left, part)
        assert left.area().sum() <= 0.4 * own.ring_length().sum() + 1e-3


def on_layer(areas: Areas, entry: int, layer: int, n_layers: int) -> Areas:
    """One entry as the area of a layer in a stack of the usual size."""
    one = areas.select(areas.ring_layer == entry)
    return Areas(one.xy, one.ring_start, np.full(one.n_rings, layer), n_layers)


@given(heights=heights, limit=st.sampled_from([0.1, 0.2, 0.3, 0.32, 0.5]))
def test_no_bead_is_higher_than_the_limit_unless_its_layer_is(heights: list[float], limit: float) -> None:
    tops = np.array(list(accumulate(heights)))

    made = filled(Areas.from_rings([[rectangle(9, 9)]] * len(tops)), tops, limit)

    high = height_of(made)
    single = np.diff(tops, prepend=0)
    assert (high <= np.maximum(limit, single.max()) + 1e-6).all()
    assert (high[len(tops) :] <= limit + 1e-6).all()
    assert high.sum() == pytest.approx(tops[-1])  # one column: every height once


@given(heights=heights)
def test_an_upright_column_takes_as_few_beads_as_any_division(heights: list[float]) -> None:
    """Against the best of all divisions; the first layer is on its own."""
    tops = np.array(list(accumulate(heights)))

    def fewest(rest: list[float]) -> int:
        if not rest:
            return 0
        sums = [total for total in accumulate(rest) if total <= LIMIT + 1e-9]
        return 1 + min(fewest(rest[count:]) for count in range(1, max(len(sums), 1) + 1))

    made = filled(Areas.from_rings([[rectangle(9, 9)]] * len(tops)), tops)

    assert np.count_nonzero(height_of(made)) == 1 + fewest(heights[1:])


def test_groups_end_where_skins_begin() -> None:
    """Most of the part ends under a skin after five layers, the rest after eight: no group reaches over the fifth."""
    wide, narrow = rectangle(30, 20), rectangle(2, 20)

    made = filled(Areas.from_rings([[wide]] * 5 + [[narrow]] * 3), layers(8, 0.1).top)

    thick = np.unique(made.area.ring_layer[made.area.ring_layer >= 8])
    last = made.layer[thick].tolist()
    assert made.height[thick] == pytest.approx([0.3, 0.3])
    assert last[0] in (3, 4)  # one layer more or less below does not matter
    assert last[1] == 7


def test_without_thick_beads_layers_are_as_they_were() -> None:
    areas = Areas.from_rings([[rectangle(9, 9)]] * 4)

    for limit in (0.0, 0.15):
        assert filled(areas, layers(4, 0.1).top, limit).area is areas


@patterns
@pytest.mark.parametrize("engine", list(ENGINES))
def test_the_plastic_stays_what_the_density_says_over_uneven_layers(pattern: str, engine: str) -> None:
    tops = np.cumsum([0.2, 0.08, 0.1, 0.12, 0.3, 0.1, 0.2, 0.08, 0.08, 0.08, 0.32, 0.14])
    rings = [[rectangle(90 - 0.4 * k, 90, (0.2 * k, 0.3 * k))] for k in range(len(tops))]
    with using_engine(engine):
        paths = infill_paths(
            sparse_stack(rings, tops), plain(infill=pattern, infill_density=0.2, internal_infill_every=0.32)
        )

    sections = np.array([(90 - 0.4 * k) * 90 for k in range(len(tops))])
    expected = 0.2 * float((sections * np.diff(tops, prepend=0)).sum())
    assert paths.height.max() > 0.29
    assert volumes(paths).sum() == pytest.approx(expected, rel=0.02)
    assert (paths.width[paths.start[:-1]] >= paths.height).all()


def test_thick_beads_are_a_function_of_the_middle_of_what_they_fill() -> None:
    """Lines of cubic lie where they would on layers as high as the beads are."""
    thin = sparse_only([rectangle(40, 40)], np.append(0.1, 0.1 + 0.3 * np.arange(1, 5)))
    fine = sparse_only([rectangle(40, 40)], np.linspace(0.1, 1.3, 13))
    changes = {"infill": "cubic", "infill_density": 0.2, "infill_anchor_max": 0, "internal_infill_every": 0.3}

    one, another = (infill_paths(stack, plain(**changes)) for stack in (thin, fine))

    assert one.n_paths == another.n_paths
    assert one.xy == pytest.approx(another.xy, abs=1e-3)
    assert one.plan.top[one.layer] == pytest.approx(another.plan.top[another.layer])


def test_a_part_of_thin_layers_prints_faster_with_the_same_plastic() -> None:
    mesh = case_study()
    usual, thick = (
        slice_stages(mesh, plain(layer_height=0.1, first_layer_height=0.1, internal_infill_every=every))
        for every in (0, 0.3)
    )
    wanted = plain()

    seconds = [float(move_seconds(one.program, wanted).sum()) for one in (usual, thick)]
    filament = [
        float(one.program.filament[one.program.role == Role.INTERNAL_INFILL].sum()) for one in (usual, thick)
    ]
    assert seconds[1] < 0.9 * seconds[0]
    assert filament[1] == pytest.approx(filament[0], rel=0.02)


def test_thick_beads_keep_to_the_flow_limit_and_lie_inside_skins() -> None:
    wanted = plain(
        layer_height=0.1,
        first_layer_height=0.1,
        internal_infill_every=0.3,
        max_flow=4,
        speeds__internal_infill=200,
    )
    stages = slice_stages(step_pyramid([20, 14, 9], [3.0, 2.0, 2.0]), wanted)
    program = stages.program

    sparse = program.role == Role.INTERNAL_INFILL
    section = bead.cross_section(program.width[sparse], program.height[sparse])
    assert program.height[sparse].max() == pytest.approx(0.3)
    assert (section * program.speed[sparse] <= 4 + 1e-6).all()
    # What a thick bead fills is sparse on every layer that it reaches down through.
    paths, plan = stages.toolpaths, stages.sections.plan
    for i in np.flatnonzero((paths.role == Role.INTERNAL_INFILL) & (paths.height > 0.15)).tolist():
        first = int(np.searchsorted(plan.top, plan.top[paths.layer[i]] - paths.height[i] + 1e-6))
        box_of = np.concatenate([paths.path(i).min(axis=0), paths.path(i).max(axis=0)])
        for layer in range(first, int(paths.layer[i]) + 1):
            rings = np.concatenate(list(stages.regions.internal_infill.rings(layer)))
            assert (box_of[:2] >= rings.min(axis=0) - 0.2).all()
            assert (box_of[2:] <= rings.max(axis=0) + 0.2).all()


def test_no_bead_is_higher_than_eight_tenths_of_the_nozzle() -> None:
    stages = slice_stages(
        box((20, 20, 6)), plain(layer_height=0.1, first_layer_height=0.1, internal_infill_every=2)
    )

    assert stages.toolpaths.height.max() <= 0.32 + 1e-9
    assert slice_stages(sphere(3), plain(internal_infill_every=2)).toolpaths.height.max() == pytest.approx(
        0.2
    )
