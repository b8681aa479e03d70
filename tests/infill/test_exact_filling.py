"""Solid areas are filled exactly: random outlines, random heights, nothing bare, nothing twice, nothing outside."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from printer_slicer import bead
from printer_slicer.arrays import Float
from printer_slicer.geometry import (
    Areas,
    difference,
    normalize,
    offset,
    offset_open,
    split_connected,
    stroke_lines,
)
from printer_slicer.infill import infill_paths
from printer_slicer.inspection.coverage.measurement import coverage_of
from printer_slicer.inspection.coverage.stack import stack_of_program
from printer_slicer.model import LayerPlan, Regions, Sections, Toolpaths
from printer_slicer.perimeters import lay_walls
from printer_slicer.pipeline import slice_stages
from printer_slicer.regions import classify
from printer_slicer.roles import Role
from tests.effort import crossed, examples
from tests.infill.stacks import solid_only
from tests.parts import box, plain, sphere
from tests.strategies import star_rings

HEIGHTS = st.sampled_from([0.08, 0.12, 0.2, 0.28, 0.32])


def strokes(paths: Toolpaths) -> Areas:
    """What the beads cover, as wide as they are, with round ends."""
    following = paths.following
    begin = np.flatnonzero(following != np.arange(len(paths.xy)))
    xy = np.stack([paths.xy[begin], paths.xy[following[begin]]], axis=1).reshape(-1, 2)
    width = (paths.width[begin] + paths.width[following[begin]]) / 2
    layer = np.repeat(paths.layer, np.diff(paths.start))[begin]
    return stroke_lines(xy, 2 * np.arange(len(begin) + 1), layer, width / 2, paths.plan.n_layers)


def filled(solid: Areas, height: float) -> tuple[Toolpaths, Toolpaths, Areas]:
    """Walls and solid infill of sections that are full all through, and where infill is."""
    plan = LayerPlan.from_tops(height * np.arange(1, solid.n_layers + 1))
    wanted = plain(infill_density=1)
    sections = Sections(plan, solid)
    walls = lay_walls(sections, wanted)
    regions = classify(sections, walls, wanted)
    without_bridges = Regions(
        plan,
        regions.bottom_solid_infill,
        Areas.empty(plan.n_layers),
        regions.top_solid_infill,
        regions.solid_infill,
        regions.internal_infill,
        np.zeros(0),
        inside=regions.inside,
    )
    inside = regions.bottom_solid_infill.merge(regions.solid_infill).merge(regions.top_solid_infill)
    return walls.paths, infill_paths(without_bridges, wanted), inside


def one_layer(rings: list[Float]) -> Areas:
    return normalize(Areas.from_rings([rings]))


def fills(paths: Toolpaths) -> Float:
    """(L,) mm³ of beads whose width changes evenly from point to point."""
    following = paths.following
    owner = np.repeat(np.arange(paths.n_paths), np.diff(paths.start))
    long = np.hypot(*(paths.xy[following] - paths.xy).T)
    wide = (paths.width + paths.width[following]) / 2
    laid = long * bead.cross_section(wide, paths.height[owner])
    return np.bincount(paths.layer[owner], laid, paths.plan.n_layers).astype(np.float64)


def outlines(test: Callable[..., None]) -> Callable[..., None]:
    """Any outline, with or without a hole, at any height."""
    return settings(max_examples=examples(8))(given(rings=star_rings(), height=HEIGHTS)(test))


@outlines
def test_solid_areas_hold_what_they_should_within_a_percent_and_a_little_in_each_corner(
    rings: list[Float], height: float
) -> None:
    _, infill, inside = filled(one_layer(rings), height)

    area = float(inside.area().sum())
    # No bead is narrower than one can be, nor too short to be worth a stop: and rows do not reach into pointed
    # corners: in each scrap 0.4 mm² may be wrong.
    scraps = split_connected(inside).count
    assert float(fills(infill).sum()) / height == pytest.approx(area, abs=0.01 * area + 0.4 * scraps)


@outlines
def test_nothing_solid_stays_bare(rings: list[Float], height: float) -> None:
    walls, infill, inside = filled(one_layer(rings), height)

    bare = difference(inside, strokes(Toolpaths.joined(walls.plan, [walls, infill])))
    area = float(inside.area().sum())
    wider = [float(offset_open(bare, gap / 2).area().sum()) for gap in (0.1, 0.2, 0.35)]
    scraps = split_connected(inside).count
    # Rows do not reach into pointed corners, nor round beads into cusps.
    assert wider[0] <= 0.005 * area + 0.4 * scraps
    assert wider[1] <= 0.002 * area + 0.4 * scraps
    assert wider[2] <= 0.4 * scraps


@outlines
def test_no_bead_of_solid_infill_leaves_the_section(rings: list[Float], height: float) -> None:
    solid = one_layer(rings)
    _, infill, inside = filled(solid, height)

    laid = strokes(infill)
    assert float(difference(laid, solid).area().sum()) < 1e-3
    # Nor does it lie on the walls: round ends reach in, which rows do not fill.
    beyond = difference(laid, offset(inside, 0.2))
    assert float(beyond.area().sum()) < 0.002 * float(inside.area().sum()) + 0.1


def test_threads_of_a_bridge_leave_no_wedges_beside_a_slanting_wall() -> None:
    regions = solid_only([np.array([(0, 0), (20, 0), (20, 5), (0, 8.5)])], Role.BRIDGE)
    paths = infill_paths(regions, plain())

    bare = difference(offset(regions.bridge, -0.1), strokes(paths))
    assert (paths.role == Role.BRIDGE).all()
    assert float(offset_open(bare, 0.05).area().max()) < 0.1


@pytest.mark.parametrize(("height", "side"), crossed([0.1, 0.2, 0.32], [20.0, 40.0]))
def test_a_solid_cube_holds_as_much_as_the_model(side: float, height: float) -> None:
    wanted = plain(infill_density=1, layer_height=height, first_layer_height=height, planner__kind="uniform")
    stages = slice_stages(box((side, side, 5 * height)), wanted)

    assert fills(stages.toolpaths).sum() / (side**2 * 5 * height) == pytest.approx(1, abs=0.005)


@pytest.mark.parametrize(("degrees", "height"), crossed([0, 20, 45, 70], [0.1, 0.2, 0.32]))
def test_nowhere_in_a_solid_box_do_turns_lie_on_rows_or_rows_on_walls(degrees: float, height: float) -> None:
    wanted = plain(
        infill_density=1,
        infill_angle_deg=degrees,
        layer_height=height,
        first_layer_height=height,
        planner__kind="uniform",
    )
    stages = slice_stages(box((15, 11, 3 * height)), wanted)
    coverage = coverage_of(
        stack_of_program(stages.program, wanted.material.filament_diameter), stages.sections.solid
    )

    # A little in thick layers, whose turns cannot be that thin, and in corners with a wedge.
    assert coverage.fill.overlap.max() < 0.008 * coverage.section_volume.max() / height
    assert coverage.uncovered.area().max() < 0.1
    assert coverage.volume == pytest.approx(coverage.section_volume, rel=0.01)


def test_small_round_skins_are_full_and_nowhere_too_full() -> None:
    wanted = plain(layer_height=0.2, planner__kind="uniform", infill_density=1)
    stages = slice_stages(sphere(5), wanted)
    coverage = coverage_of(
        stack_of_program(stages.program, wanted.material.filament_diameter), stages.sections.solid
    )

    assert stages.regions.bridge.n_rings == 0
    assert coverage.uncovered.area().max() < 0.2
    assert coverage.fill.overlap.sum() < 0.03 * coverage.covered.area().sum()
    assert np.nanmin(coverage.fill.shell) > 0.96  # the cap under the top is all outer perimeter
    assert np.nanmedian(coverage.fill.shell) > 0.985
    assert np.nanmax(coverage.fill.shell) < 1.02
