"""Shells hold the volume of their part, and no place of them much more."""

from __future__ import annotations

import numpy as np
import pytest

from printer_slicer.arrays import Float
from printer_slicer.geometry import difference
from printer_slicer.inspection.coverage.measurement import coverage_of, find_overlaps
from printer_slicer.inspection.coverage.stack import stack_of_program
from printer_slicer.model import Mesh
from printer_slicer.pipeline import slice_stages
from printer_slicer.profile import Profile, load_profile
from printer_slicer.roles import Role
from printer_slicer.stages import Stages
from tests.effort import few_of
from tests.parts import (
    box,
    box_with_hole,
    cone,
    joined,
    prism,
    shape,
    shapely,
    sheared_prism,
    sphere,
    step_pyramid,
)

_NOT_SHELL = (Role.INTERNAL_INFILL, Role.SKIRT, Role.IRONING)


def usual() -> Profile:
    return load_profile("marlin_220", "pla", "standard", {"skirt_loops": 0})


def plate_with_bosses() -> Mesh:
    turn = np.linspace(0, 2 * np.pi, 48, endpoint=False)
    circle = 4 * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    bosses = [prism(circle + place, 3).moved((0, 0, 2)) for place in ((8, 8), (30, 20))]
    return joined([box((40, 30, 2)), *bosses], "bosses")


def density(stages: Stages) -> Float:
    """(L,) plastic of perimeters and solid infill by the area of the section without its sparse area."""
    paths, solid = stages.toolpaths, stages.sections.solid
    own = ~np.isin(paths.role, _NOT_SHELL)
    laid = np.bincount(paths.layer[own], (paths.area() * paths.height)[own], solid.n_layers)
    volume = (solid.area() - stages.regions.internal_infill.area()) * stages.sections.plan.height
    return np.asarray(laid / volume)


def overfilled(stages: Stages, profile: Profile) -> float:
    """The share of the shells' area that holds more than 1.3 times what fills it."""
    coverage = coverage_of(
        stack_of_program(stages.program, profile.material.filament_diameter), stages.sections.solid
    )
    shell = difference(stages.sections.solid, stages.regions.internal_infill)
    layers = np.flatnonzero(coverage.fill.overlap).tolist()
    over = [
        shapely.area(shapely.intersection(shape(find_overlaps(coverage, k), 0), shape(shell, k)))
        for k in layers
    ]
    return float(sum(over)) / float(shell.area().sum())


def dumbbell() -> Mesh:
    """Two blocks and a neck with room for three beads, at whose ends only corners see each other."""
    outline = [
        (0, 0),
        (8, 0),
        (8, 4.3),
        (9, 4.3),
        (9, 0),
        (17, 0),
        (17, 10),
        (9, 10),
        (9, 5.65),
        (8, 5.65),
        (8, 10),
        (0, 10),
    ]
    return prism(outline, 4)


# Near the tip of a cone there is no room for whole loops; the bead of the neck ends in the loops that pass its ends.
PARTS = [
    (box_with_hole((24, 24, 5), (20, 20)), 2e-4),
    (cone(), 1e-3),
    (plate_with_bosses(), 2e-4),
    (dumbbell(), 2.5e-3),
    (box((20, 20, 4)), 2e-4),
    (sphere(), 2e-4),
    (step_pyramid((30, 20, 10), (2, 2, 2)), 2e-4),
    (sheared_prism(), 2e-4),
]


@pytest.mark.parametrize("case", few_of(PARTS, 4), ids=lambda case: case[0].name)
def test_shells_have_full_density_and_no_place_is_overfilled(case: tuple[Mesh, float]) -> None:
    mesh, most = case
    profile = usual()
    stages = slice_stages(mesh, profile)

    assert float(np.median(density(stages))) == pytest.approx(1, abs=0.01)
    assert overfilled(stages, profile) <= most
