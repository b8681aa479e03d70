"""Extrusion widths of the first layer and of external perimeters: neither changes the volume of plastic."""

from __future__ import annotations

import numpy as np
import pytest

from printer_slicer.errors import ProfileError
from printer_slicer.model import Mesh
from printer_slicer.pipeline import slice_stages
from printer_slicer.roles import Role
from printer_slicer.stages import Stages
from tests.parts import box, box_with_hole, plain


def widths(stages: Stages, *roles: Role, layer: int) -> list[float]:
    """All widths of some roles on one layer."""
    paths = stages.toolpaths
    owner = np.repeat(np.arange(paths.n_paths), np.diff(paths.start))
    chosen = np.isin(paths.role[owner], roles) & (paths.layer[owner] == layer)
    return np.unique(np.round(paths.width[chosen], 6)).tolist()


def plastic(stages: Stages, layer: int) -> float:
    """Of the part itself on one layer, mm³."""
    program = stages.program
    chosen = (program.layer == layer) & (program.role > Role.RAFT)
    return float(program.filament[chosen].sum() * np.pi * 1.75**2 / 4)


@pytest.mark.parametrize("wide", [0.36, 0.6, 0.8])
@pytest.mark.parametrize("mesh", [box((30, 30, 2)), box_with_hole((30, 30, 2))], ids=lambda mesh: mesh.name)
def test_the_first_layer_is_full_at_any_width(mesh: Mesh, wide: float) -> None:
    stages = slice_stages(mesh, plain(first_layer_width=wide, infill_density=1))
    solid = stages.sections.solid.area() * stages.sections.plan.height

    # Inner perimeters are wider by what the round sides of the outer ones leave empty.
    for layer, usual in ((0, wide), (1, 0.45)):
        assert widths(stages, Role.EXTERNAL_PERIMETER, layer=layer) == [usual]
        assert widths(stages, Role.PERIMETER, layer=layer) == pytest.approx([1.04 * usual], rel=0.04)
    # Rows; beads in what they leave at corners may be narrower.
    assert max(widths(stages, Role.BOTTOM_SOLID_INFILL, layer=0)) == pytest.approx(wide, rel=0.05)
    for layer in (0, 1):
        assert plastic(stages, layer) == pytest.approx(solid[layer], rel=0.03)


def test_what_lies_on_the_bed_has_the_width_for_it() -> None:
    wanted = plain(first_layer_width=0.7, skirt_loops=2, skirt_height=1, brim_width=3)
    stages = slice_stages(box((20, 20, 2)), wanted)

    assert widths(stages, Role.SKIRT, Role.BRIM, layer=0) == [0.7]
    assert widths(stages, Role.SKIRT, layer=1) == [0.45]


def test_on_a_raft_the_parts_first_layer_is_as_wide_as_the_others() -> None:
    stages = slice_stages(box((20, 20, 2)), plain(first_layer_width=0.7, skirt_loops=1, raft_height=0.8))

    assert widths(stages, Role.SKIRT, layer=0) == [0.7]
    assert widths(stages, Role.EXTERNAL_PERIMETER, layer=3) == [0.45]


@pytest.mark.parametrize("wide", [0.1, 1.2])
def test_a_width_that_does_not_suit_the_nozzle_is_refused(wide: float) -> None:
    with pytest.raises(ProfileError, match=r"quality.first_layer_width"):
        plain(first_layer_width=wide)


@pytest.mark.parametrize("varying", [True, False])
@pytest.mark.parametrize("perimeters", [1, 2, 3])
@pytest.mark.parametrize("wide", [0.36, 0.6])
@pytest.mark.parametrize("mesh", [box((30, 30, 2)), box_with_hole((30, 30, 2))], ids=lambda mesh: mesh.name)
def test_external_perimeters_of_another_width_leave_the_part_full(
    mesh: Mesh, wide: float, perimeters: int, varying: bool
) -> None:
    wanted = plain(
        external_perimeter_width=wide, perimeters=perimeters, varying_walls=varying, infill_density=1
    )
    stages = slice_stages(mesh, wanted)
    usual = slice_stages(mesh, plain(perimeters=perimeters, varying_walls=varying, infill_density=1))

    for layer in (0, 1, 3):
        assert widths(stages, Role.EXTERNAL_PERIMETER, layer=layer) == [wide]
        assert plastic(stages, layer) == pytest.approx(plastic(usual, layer), rel=1e-3)
    inner = widths(stages, Role.PERIMETER, layer=1)
    assert inner == widths(usual, Role.PERIMETER, layer=1) == [] or inner == pytest.approx([0.46], rel=0.04)


def test_a_vase_is_as_wide_as_external_perimeters() -> None:
    stages = slice_stages(box((20, 20, 4)), plain(external_perimeter_width=0.6, spiral=True))

    assert max(widths(stages, Role.EXTERNAL_PERIMETER, layer=15)) == 0.6


def test_the_first_layer_width_counts_for_external_perimeters_too() -> None:
    stages = slice_stages(box((20, 20, 2)), plain(external_perimeter_width=0.4, first_layer_width=0.6))

    assert widths(stages, Role.EXTERNAL_PERIMETER, layer=0) == [0.6]
    assert widths(stages, Role.EXTERNAL_PERIMETER, layer=1) == [0.4]


def test_external_perimeters_must_suit_the_nozzle() -> None:
    with pytest.raises(ProfileError, match="external_perimeter_width"):
        plain(external_perimeter_width=0.2)
