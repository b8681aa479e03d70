"""Solid regions are filled bead by bead, on layers of any height, and stay where they belong."""

from __future__ import annotations

import numpy as np
import pytest

from printer_slicer import bead
from printer_slicer.geometry.engine import ENGINES, using_engine
from printer_slicer.infill import infill_paths
from printer_slicer.model import Areas, Regions
from printer_slicer.roles import Role
from tests.infill.stacks import (
    SOLID_ROLES,
    UNEVEN,
    WIDTH,
    lengths,
    rectangle,
    rows,
    solid_only,
    sparse_only,
    volumes,
)
from tests.parts import layers, plain

engines = pytest.mark.parametrize("engine", list(ENGINES))


@pytest.mark.parametrize("role", SOLID_ROLES, ids=lambda role: role.name.lower())
def test_neighbouring_solid_lines_lie_one_spacing_of_their_own_layer_apart(role: Role) -> None:
    """Width - height * (1 - pi / 4), so on a plan of uneven layers each has another spacing."""
    wanted = plain(infill_angle_deg=0, thick_bridges=False)
    paths = infill_paths(solid_only([rectangle(12, 9)], role), wanted)

    height = np.diff(UNEVEN, prepend=0)
    for layer in range(6):
        angle = 0.0 if role == Role.BRIDGE else np.pi / 2 * (layer % 2)
        gaps = np.diff(rows(paths, layer, angle))
        width = paths.width[np.repeat(paths.layer, np.diff(paths.start)) == layer]
        turns = width != width[0]
        assert len(set(width[turns].tolist())) == (role != Role.BRIDGE)
        assert (width[turns] < width[0]).all()
        # A bridge's beads have as much plastic as usual, however near the next one is.
        # Of other beads, by what the turns at their ends lay too little or too much.
        near = 0.05 if role == Role.BRIDGE else 0.015
        assert gaps == pytest.approx(width[0] - height[layer] * (1 - np.pi / 4), rel=near, abs=1e-4)
        assert width[0] == pytest.approx(WIDTH, rel=0.05)  # so that a whole number of beads fills 12 or 9 mm


@engines
def test_solid_lines_lay_as_much_plastic_as_the_area_holds(engine: str) -> None:
    with using_engine(engine):
        paths = infill_paths(solid_only([rectangle(30, 20)]), plain(infill_overlap=0))

    assert volumes(paths) / paths.plan.height == pytest.approx(600, rel=0.005)


def test_the_direction_turns_by_a_right_angle_from_layer_to_layer() -> None:
    paths = infill_paths(solid_only([rectangle(12, 9)]), plain(infill_angle_deg=30))

    for layer in range(6):
        angle = np.deg2rad(30) + np.pi / 2 * (layer % 2)
        assert len(rows(paths, layer, angle)) > 15
        assert len(rows(paths, layer, angle + np.pi / 2)) < 5  # turns at corners


def test_bridges_run_in_their_own_direction() -> None:
    regions = solid_only([rectangle(12, 9)], Role.BRIDGE)
    angles = np.deg2rad([10, 20, 30, 40, 50, 60])
    turned = Regions(
        regions.plan,
        regions.bottom_solid_infill,
        regions.bridge,
        regions.top_solid_infill,
        regions.solid_infill,
        regions.internal_infill,
        angles,
    )

    paths = infill_paths(turned, plain())

    assert all(len(rows(paths, layer, float(angle))) > 10 for layer, angle in enumerate(angles))


def test_centre_lines_stay_half_a_bead_inside_but_for_the_overlap_and_their_ends() -> None:
    for overlap in (0.0, 0.15):
        regions = solid_only([rectangle(12, 9)])
        paths = infill_paths(regions, plain(infill_overlap=overlap))
        for i in range(paths.n_paths):
            gap = float(bead.spacing(paths.width[paths.start[i]], paths.plan.height[paths.layer[i]]))
            inset = gap / 2 - overlap * WIDTH
            low, high = paths.path(i).min(axis=0), paths.path(i).max(axis=0)
            # Rows end half a turn before the border, and turns are a third of a row: a third of a spacing nearer.
            assert (low >= inset - gap / 3 - 1e-3).all()
            assert (high <= np.array([12, 9]) - inset + gap / 3 + 1e-3).all()


def test_areas_too_thin_for_a_bead_get_none() -> None:
    assert infill_paths(solid_only([rectangle(0.1, 5)]), plain(infill_overlap=0)).n_paths == 0


def test_thick_bridges_are_round_threads_with_a_little_air_between_them() -> None:
    regions = solid_only([rectangle(12, 9)], Role.BRIDGE)
    for flow in (0.8, 1.0, 1.3):
        paths = infill_paths(regions, plain(bridge_flow_ratio=flow))

        thread = 0.4 * np.sqrt(flow)
        assert paths.width == pytest.approx(thread)
        assert paths.height == pytest.approx(thread)
        assert bead.cross_section(thread, thread) == pytest.approx(flow * np.pi / 4 * 0.4**2)
        assert np.diff(rows(paths, 3, 0.0)) == pytest.approx(thread + 0.05, rel=0.05)


def test_flat_bridges_have_as_much_plastic_as_asked_for() -> None:
    regions = solid_only([rectangle(12, 9)], Role.BRIDGE)
    usual, less = (
        infill_paths(regions, plain(bridge_flow_ratio=flow, thick_bridges=False)) for flow in (1.0, 0.8)
    )

    assert np.array_equal(usual.xy, less.xy)
    assert np.array_equal(less.height, less.plan.height[less.layer])
    of_path = np.repeat(less.layer, np.diff(less.start))
    section = bead.cross_section(less.width, less.plan.height[of_path])
    full = bead.cross_section(usual.width, usual.plan.height[of_path])
    assert section == pytest.approx(0.8 * full, rel=1e-3)


@pytest.mark.parametrize(("pattern", "between"), [("grid", 25), ("rectilinear", 75)])
def test_internal_bridges_cross_the_infill_below(pattern: str, between: float) -> None:
    regions = sparse_only([rectangle(40, 40)])
    above = np.flatnonzero(regions.internal_infill.ring_layer == 3)
    none = Areas.empty(6)
    bridged = Regions(
        regions.plan,
        *(none, none, none, none),
        regions.internal_infill.take(np.flatnonzero(regions.internal_infill.ring_layer == 2)),
        np.zeros(0),
        internal_bridge=regions.internal_infill.take(above),
    )
    paths = infill_paths(bridged, plain(infill=pattern))

    angles = np.deg2rad(np.arange(0, 180, 5))
    below, over = (
        [i for i, angle in enumerate(angles) if len(rows(paths, layer, float(angle))) > least]
        for layer, least in ((2, 4), (3, 50))
    )
    assert set(paths.role[paths.layer == 3].tolist()) == {Role.INTERNAL_BRIDGE}
    turned = [abs((over[0] - one) * 5 + 90) % 180 - 90 for one in below]
    assert min(abs((turn + 90) % 180 - 90) for turn in turned) >= between


def test_strips_beside_a_wall_are_filled_along_it() -> None:
    """A ring 1 mm wide in a 30 mm square inside: long lines, and as much plastic as it holds."""
    square, hole = rectangle(30, 30), (rectangle(28, 28) + 1)[::-1]
    regions = solid_only([square, hole], tops=layers(4, 0.2).top)
    inside = solid_only([square], tops=layers(4, 0.2).top).solid_infill
    along = Regions(
        regions.plan,
        *(
            regions.bottom_solid_infill,
            regions.bridge,
            regions.top_solid_infill,
            regions.solid_infill,
            regions.internal_infill,
            np.zeros(0),
        ),
        inside=inside,
    )
    paths, across = infill_paths(along, plain()), infill_paths(regions, plain())

    assert paths.n_paths <= 3 * 4
    assert across.n_paths > 0
    width = paths.width[paths.start[0]]
    assert lengths(paths) * bead.spacing(width, 0.2) == pytest.approx(30**2 - 28**2, rel=0.1)
    # No end hangs loose: a closed way returns to its beginning.
    for i in range(paths.n_paths):
        assert np.array_equal(paths.path(i)[0], paths.path(i)[-1])
