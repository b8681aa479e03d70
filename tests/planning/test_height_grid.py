"""Where layers may end and which a plan may have: the list anywhere, anything else only at event planes."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import pytest

from printer_slicer.model import Mesh
from printer_slicer.planning import plan_layers
from printer_slicer.planning.height_grid import (
    HeightGrid,
    HeightRow,
    find_event_planes,
    list_candidate_layers,
)
from printer_slicer.planning.z_steps import ZSteps
from printer_slicer.profile import HeightRange, Profile
from printer_slicer.surface import certify, read_surface
from tests.parts import profile, sphere, step_pyramid

ROUNDING = 1e-6
STEPS: Final = step_pyramid([10, 8, 5], [0.353, 0.52, 0.61])


def optimal(**changes: Any) -> Profile:
    """All heights from 0.08 to 0.32 mm on a grid of 0.0025 mm, the first layer free."""
    usual: dict[str, Any] = {"z_step": 0.0025, "first_layer_height": 0, "planner__kind": "optimal"}
    return profile(**(usual | changes))


def rows(mesh: Mesh, wanted: Profile, *, everywhere: bool = False) -> tuple[HeightGrid, list[HeightRow]]:
    steps = ZSteps(mesh, wanted)
    grid = HeightGrid.of(steps, [stretch.layer_height for stretch in wanted.dials.ranges])
    return grid, list_candidate_layers(
        find_event_planes(mesh, wanted, grid.unit), grid, steps, wanted, everywhere=everywhere
    )


def test_a_height_off_the_list_begins_or_ends_at_an_event_plane() -> None:
    wanted = optimal(layer_heights=(0.1, 0.25))
    grid, found = rows(STEPS, wanted)
    events = {round(z / grid.unit) for z in read_surface(STEPS).contacts.event_heights()} - {0}

    assert len(events) == 3
    for row in found:
        on_list = round(row.height * grid.unit, 6) in (0.1, 0.25)
        assert row.listed.all() if on_list else not row.listed.any()
        assert row.free.all()
        if on_list:
            assert row.end.tolist() == list(range(row.height, grid.n + 1))
        else:
            ends = {end for event in events for end in (event, event + row.height)}
            assert set(row.end.tolist()) == {end for end in ends if row.height <= end <= grid.n}


def test_as_a_last_resort_every_layer_that_the_printer_can_print_is_there() -> None:
    grid, found = rows(STEPS, optimal(layer_heights=(0.1, 0.25)), everywhere=True)

    assert [row.height for row in found] == list(range(grid.lowest, grid.highest + 1))
    for row in found:
        assert row.end.tolist() == list(range(row.height, grid.n + 1))
        assert not row.free.all() or row.listed.all()


def test_only_the_first_layer_asked_for_stands_on_the_bed() -> None:
    grid, found = rows(STEPS, optimal(first_layer_height=0.2075))
    on_bed = [row.height for row in found if (row.end == row.height).any()]

    assert on_bed == [round(0.2075 / grid.unit)]


def test_a_height_of_a_range_is_on_the_list_within_it() -> None:
    stretch = HeightRange(low=0.5, high=0.9, layer_height=0.0925)
    grid, found = rows(STEPS, optimal(planner__ranges=(stretch,)))
    mine = next(row for row in found if row.height == round(0.0925 / grid.unit))
    top, bottom = mine.end * grid.unit, (mine.end - mine.height) * grid.unit

    assert mine.listed.sum() > 100
    assert mine.listed.tolist() == ((top > 0.5 + ROUNDING) & (bottom < 0.9 - ROUNDING)).tolist()


@pytest.mark.parametrize("changes", [{}, {"planner__max_step": 0.05}, {"first_layer_height": 0.2005}])
@pytest.mark.parametrize("height", [3.9997, 4.0003, 4.0011])
def test_where_steps_are_finer_than_layers_need_the_top_is_still_met_to_the_step(
    height: float, changes: dict[str, Any]
) -> None:
    """Layers end on every fifth step or so, but the last one ends where the part does."""
    mesh = Mesh(sphere(2).triangles * [1, 1, height / sphere(2).height])
    wanted = optimal(z_step=0.0005, tolerance=0.06, **changes)
    plan = plan_layers(mesh, wanted)
    steps = plan.height / 0.0005

    assert abs(plan.top[-1] - height) <= 0.00025 + ROUNDING
    assert np.abs(steps - np.rint(steps)).max() < 1e-4
    assert plan.height.min() >= wanted.printer.min_layer - ROUNDING
    assert plan.height.max() <= wanted.printer.max_layer + ROUNDING
    chosen = slice(1, None) if "first_layer_height" in changes else slice(None)
    assert certify(read_surface(mesh), plan).bound[chosen].max() <= 0.06 + ROUNDING
    if "planner__max_step" in changes:
        assert np.abs(np.diff(plan.height)).max() <= 0.05 + ROUNDING
