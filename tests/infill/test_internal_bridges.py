"""Internal bridges rest at both ends, in the direction in which they sag least, and take only what they need."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from printer_slicer import bead
from printer_slicer.arrays import Float
from printer_slicer.geometry import Areas, Polylines
from printer_slicer.infill import PATTERNS, infill_paths
from printer_slicer.infill.internal_bridges import support_internal_bridges
from printer_slicer.inspection.coverage.measurement import coverage_of
from printer_slicer.inspection.coverage.stack import stack_of_program
from printer_slicer.inspection.deposition.marks import Purpose
from printer_slicer.model import LayerPlan, Mesh, Regions
from printer_slicer.pipeline import slice_stages
from printer_slicer.roles import Role
from tests.beads_over_air import beads_over_air
from tests.effort import few_of
from tests.infill.stacks import WIDTH, lengths, rectangle
from tests.parts import plain, shape, shapely, sphere, step_pyramid
from tests.strategies import star_rings

USUAL = plain(infill_angle_deg=0)


def patch(*rings: Float, side: float = 40.0) -> Regions:
    """Solid patches over a layer that is sparse all over, in a square layer that is sparse around them."""
    plan, square = LayerPlan.from_tops(np.array([0.2, 0.4])), rectangle(side, side)
    none = Areas.empty(2)
    sparse = Areas.from_rings([[square], [square, *(ring[::-1] for ring in rings)]])
    solid, inside = Areas.from_rings([[], list(rings)]), Areas.from_rings([[square], [square]])
    return Regions(plan, none, none, none, none, sparse, np.zeros(0), internal_bridge=solid, inside=inside)


def lines(*ends: tuple[tuple[float, float], tuple[float, float]]) -> Polylines:
    """Sparse lines on the lower of two layers."""
    xy = np.array(ends, dtype=np.float64).reshape(-1, 2)
    return Polylines.of(xy, np.full(len(ends), 2), np.zeros(len(ends), np.int64))


def longest_in_the_air(mesh: Mesh, pattern: str) -> float:
    """mm of one bead over sparse infill that turns or ends before it rests on anything."""
    wanted = plain(infill=pattern, infill_density=0.15)
    stages = slice_stages(mesh, wanted)
    coverage = coverage_of(
        stack_of_program(stages.program, wanted.material.filament_diameter), stages.sections.solid
    )
    air = beads_over_air(coverage)
    bridges = coverage.stack.beads.purpose[air.bead] == Purpose.BRIDGE

    assert Role.INTERNAL_BRIDGE in set(stages.toolpaths.role.tolist())
    assert (bridges & air.bridge).any()
    return float(air.length[bridges & ~air.bridge].max(initial=0.0))


@pytest.mark.parametrize("pattern", PATTERNS)
def test_no_bead_over_sparse_infill_ends_in_the_air(pattern: str) -> None:
    # Twigs of trees end in the middle of rooms: a bead may turn beside one.
    limit = 1.6 if pattern == "lightning" else 1.0
    assert longest_in_the_air(step_pyramid([20, 10], [1.6, 1.4]), pattern) < limit


@pytest.mark.parametrize("pattern", few_of(["grid", "lightning"], 1))
def test_no_bead_under_a_round_top_ends_in_the_air(pattern: str) -> None:
    assert longest_in_the_air(sphere(7), pattern) < 1.0


def test_one_bridge_is_enough_to_carry_the_next_layers() -> None:
    """Stairs so flat that each layer has a new strip over sparse infill: the one before may reach under it."""
    wanted = plain(infill_density=0.15)
    stairs = step_pyramid([30, 28, 26, 24, 22, 20, 18], [1.2] + 6 * [0.2])
    stages = slice_stages(stairs, wanted)
    paths, asked = stages.toolpaths, stages.regions.internal_bridge

    assert len(set(asked.ring_layer.tolist())) == 5
    chosen = paths.take(np.flatnonzero(paths.role == Role.INTERNAL_BRIDGE))
    bridged = lengths(chosen).sum() * bead.spacing(WIDTH, 0.2)
    assert bridged < 1.1 * asked.area().sum()
    assert longest_in_the_air(stairs, "grid") < 1.0


def test_a_patch_between_two_lines_reaches_across_to_both() -> None:
    regions = patch(rectangle(4, 6, (18, 17)))

    after = support_internal_bridges(regions, lines(((14, 0), (14, 40)), ((26, 0), (26, 40))), USUAL)

    low, high = after.internal_bridge.xy.min(axis=0), after.internal_bridge.xy.max(axis=0)
    assert np.rad2deg(after.internal_bridge_angle) % 180 == pytest.approx(0, abs=1e-6)
    assert (low[0], high[0]) == pytest.approx((14 - WIDTH / 2, 26 + WIDTH / 2), abs=0.01)
    assert (low[1], high[1]) == pytest.approx((17, 23), abs=WIDTH / 2)


def test_a_patch_rests_on_the_nearer_of_line_and_wall() -> None:
    regions = patch(rectangle(4, 6, (18, 17)), side=24.0)

    after = support_internal_bridges(regions, lines(((14, 0), (14, 24))), USUAL)

    low, high = after.internal_bridge.xy.min(axis=0), after.internal_bridge.xy.max(axis=0)
    assert (low[0], high[0]) == pytest.approx((14 - WIDTH / 2, 24), abs=0.01)


def test_what_rests_already_stays_as_it_is() -> None:
    regions = patch(rectangle(12 + WIDTH, 6, (14 - WIDTH / 2, 17)))

    after = support_internal_bridges(regions, lines(((14, 0), (14, 40)), ((26, 0), (26, 40))), USUAL)

    assert after.internal_bridge.area() == pytest.approx(regions.internal_bridge.area(), rel=1e-3)


@pytest.mark.parametrize("degrees", [0, 30, 75, 120])
def test_rows_cross_parallel_lines_at_about_a_right_angle(degrees: int) -> None:
    turn = np.deg2rad(degrees)
    along, across = np.array([np.cos(turn), np.sin(turn)]), np.array([-np.sin(turn), np.cos(turn)])
    places = [20 + across * 4 * i for i in range(-9, 10)]
    below = lines(*((tuple(p - 40 * along), tuple(p + 40 * along)) for p in places))

    after = support_internal_bridges(patch(rectangle(20, 20, (10, 10))), below, USUAL)

    between = (np.rad2deg(after.internal_bridge_angle) - degrees) % 180
    assert np.abs(between - 90).max() <= 30


def bridged_over(ring: Float, turn: float, gap: float) -> tuple[Regions, Regions]:
    """A patch of 8 mm around the middle, over lines of one direction, before and after it rests on them."""
    ring = 20 + 8 * (ring - ring.mean(axis=0)) / np.abs(ring - ring.mean(axis=0)).max()
    along, across = np.array([np.cos(turn), np.sin(turn)]), np.array([-np.sin(turn), np.cos(turn)])
    middles = [20 + across * gap * i for i in range(-20, 20)]
    below = lines(*((tuple(middle - 50 * along), tuple(middle + 50 * along)) for middle in middles))
    regions = patch(ring)
    return regions, support_internal_bridges(regions, below, USUAL)


ALONG_A_SIDE = np.array(
    [
        (-1.00937274, -8.94321903),
        (2.98107301, -0.33645758),
        (0.33645758, 2.98107301),
        (-2.98107301, 0.33645758),
    ]
)
"""Over lines at 179°, 2 mm apart, some rows of the bridge end a step of the grid from others."""


@given(rings=star_rings(), angle=st.integers(0, 180), gap=st.floats(1.5, 9.0))
@example(rings=[ALONG_A_SIDE], angle=179, gap=2.0)
def test_bridges_take_from_solid_and_sparse_areas_and_nothing_is_lost(
    rings: list[Float], angle: int, gap: float
) -> None:
    regions, after = bridged_over(rings[0], np.deg2rad(angle), gap)

    bridge, sparse = shape(after.internal_bridge, 1), shape(after.internal_infill, 1)
    assert bridge.intersection(sparse).area < 0.01
    assert bridge.union(sparse).area == pytest.approx(40 * 40, rel=1e-4)
    assert shape(regions.internal_bridge, 1).difference(bridge).area < 0.01
    assert shape(after.internal_bridge, 0).is_empty


def test_directions_are_those_of_the_pieces_after_they_have_grown() -> None:
    regions = patch(rectangle(4, 6, (8, 17)), rectangle(6, 4, (27, 18)))
    below = lines(((5, 0), (5, 40)), ((15, 0), (15, 40)), ((22, 15), (40, 15)), ((22, 25), (40, 25)))

    after = support_internal_bridges(regions, below, USUAL)

    boxes = [
        (ring[:, 0].min(), turn)
        for ring, turn in zip(
            after.internal_bridge.rings(1), np.rad2deg(after.internal_bridge_angle), strict=True
        )
    ]
    (_, left), (_, right) = sorted(boxes)
    assert left % 180 == pytest.approx(0, abs=1e-6)
    assert right % 180 == pytest.approx(90, abs=1e-6)
    paths = infill_paths(replace(regions, internal_bridge=after.internal_bridge), USUAL)
    assert Role.INTERNAL_BRIDGE in set(paths.role.tolist())


def test_sparse_lines_keep_clear_of_the_ends_of_bridges() -> None:
    regions = patch(rectangle(12, 12, (14, 14)))
    paths = infill_paths(regions, plain(internal_infill_overlap=0.25))

    path_numbers = {
        role: shapely.MultiLineString(
            [paths.path(int(i)) for i in np.flatnonzero((paths.layer == 1) & (paths.role == role))]
        )
        for role in (Role.INTERNAL_INFILL, Role.INTERNAL_BRIDGE)
    }
    assert not path_numbers[Role.INTERNAL_INFILL].is_empty
    assert path_numbers[Role.INTERNAL_INFILL].distance(path_numbers[Role.INTERNAL_BRIDGE]) > 0.5 * WIDTH
