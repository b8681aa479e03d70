"""Solid regions are filled bead by bead, on layers of any height, and stay where they belong."""

from __future__ import annotations

import numpy as np
import pytest

from printer_slicer import bead
from printer_slicer.geometry.engine import ENGINES, using_engine
from printer_slicer.infill import infill_paths
from printer_slicer.model import Regions, Role
from tests.infill.stacks import SOLID_ROLES, UNEVEN, WIDTH, lengths, rectangle, rows, solid_only
from tests.parts import plain

engines = pytest.mark.parametrize("engine", list(ENGINES))


@pytest.mark.parametrize("role", SOLID_ROLES, ids=lambda role: role.name.lower())
def test_neighbouring_solid_lines_lie_one_spacing_of_their_own_layer_apart(role: Role) -> None:
    """Width - height * (1 - pi / 4), so on a plan of uneven layers each has another spacing."""
    paths = infill_paths(solid_only([rectangle(12, 9)], role), plain(infill_angle_deg=0))

    height = np.diff(UNEVEN, prepend=0)
    for layer in range(6):
        angle = 0.0 if role == Role.BRIDGE else np.pi / 2 * (layer % 2)
        gaps = np.diff(rows(paths, layer, angle))
        width = paths.width[np.repeat(paths.layer, np.diff(paths.start)) == layer]
        assert gaps == pytest.approx(width[0] - height[layer] * (1 - np.pi / 4), abs=1e-4)
        assert (width == width[0]).all()
        assert width[0] == pytest.approx(WIDTH, rel=0.05)  # so that a whole number of beads fills 12 or 9 mm


@engines
def test_solid_lines_lay_as_much_plastic_as_the_area_holds(engine: str) -> None:
    with using_engine(engine):
        paths = infill_paths(solid_only([rectangle(30, 20)]), plain(infill_overlap=0))

    assert lengths(paths) * bead.spacing(WIDTH, paths.plan.height) == pytest.approx(600, rel=0.01)


def test_the_direction_turns_by_a_right_angle_from_layer_to_layer() -> None:
    paths = infill_paths(solid_only([rectangle(12, 9)]), plain(infill_angle_deg=30))

    for layer in range(6):
        angle = np.deg2rad(30) + np.pi / 2 * (layer % 2)
        assert len(rows(paths, layer, angle)) > 15
        assert len(rows(paths, layer, angle + np.pi / 2)) == 0


def test_bridges_run_in_their_own_direction() -> None:
    regions = solid_only([rectangle(12, 9)], Role.BRIDGE)
    angles = np.deg2rad([10, 20, 30, 40, 50, 60])
    turned = Regions(
        regions.plan,
        regions.bottom_skin,
        regions.bridge,
        regions.top_skin,
        regions.solid,
        regions.sparse,
        angles,
    )

    paths = infill_paths(turned, plain())

    assert all(len(rows(paths, layer, float(angle))) > 10 for layer, angle in enumerate(angles))


def test_centre_lines_stay_half_a_bead_inside_their_region_but_for_the_overlap() -> None:
    for overlap in (0.0, 0.15):
        regions = solid_only([rectangle(12, 9)])
        paths = infill_paths(regions, plain(infill_overlap=overlap))
        for i in range(paths.n_paths):
            gap = float(bead.spacing(paths.width[paths.start[i]], paths.plan.height[paths.layer[i]]))
            inset = gap / 2 - overlap * WIDTH
            low, high = paths.path(i).min(axis=0), paths.path(i).max(axis=0)
            assert (low >= inset - 1e-4).all()
            assert (high <= np.array([12, 9]) - inset + 1e-4).all()


def test_areas_too_small_for_a_line_get_none() -> None:
    assert infill_paths(solid_only([rectangle(0.2, 5)]), plain(infill_overlap=0)).n_paths == 0
