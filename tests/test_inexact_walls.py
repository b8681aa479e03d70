"""Layers whose contoured perimeters break the tolerance are changed before they are filled."""

from __future__ import annotations

import numpy as np

from printer_slicer.contouring import add_contour_rule
from printer_slicer.inexact_walls import change_inexact_walls
from printer_slicer.model import Mesh, Sections, Walls
from printer_slicer.objects import cut_objects
from printer_slicer.perimeters.known_walls import KnownWalls
from printer_slicer.pipeline import slice_stages
from printer_slicer.profile import Profile
from tests.contoured_parts import wedge
from tests.parts import joined, plain, pyramid


def slope_and_pyramid() -> Mesh:
    """Extrusions cannot follow the slope as closely as planned where the pyramid rises from it."""
    return joined([wedge(12.0), pyramid(6.0, 5.0)])


def keeping(tolerance: float) -> Profile:
    """A profile whose layers keep a tolerance, mm."""
    return plain(z_contouring=True, planner__kind="optimal", tolerance=tolerance)


def change(profile: Profile) -> tuple[Mesh, Sections, Walls]:
    """The part and its changed sections and walls, made from a plan in which no layer is level yet."""
    stages = slice_stages(slope_and_pyramid(), profile)
    plan = add_contour_rule(stages.plan, profile)
    known = KnownWalls()
    sections = cut_objects([stages.part], [plan], [profile])
    (walls,) = known.lay(sections, [profile])
    return stages.part, *change_inexact_walls(stages.part, sections[0], walls, profile, known)


def test_only_layers_that_become_level_change() -> None:
    profile = keeping(0.08)
    part, sections, walls = change(profile)
    rule = sections.plan.contour_rule

    assert rule is not None
    assert len({top for top, _, _ in rule.level_places}) > 1
    whole = cut_objects([part], [sections.plan], [profile])[0]
    assert not sections.solid.find_changed_layers(whole.solid).any()
    assert sections.below_cut is not None
    assert whole.below_cut is not None
    assert not sections.below_cut.find_changed_layers(whole.below_cut).any()
    (again,) = KnownWalls().lay([whole], [profile])
    assert not walls.inside.find_changed_layers(again.inside).any()


def test_the_perimeters_show_which_layers_break_the_tolerance() -> None:
    """So nothing is left to change after the infill."""
    profile = keeping(0.08)
    _, sections, _ = change(profile)
    final = slice_stages(slope_and_pyramid(), profile).stacks[0].plan.contour_rule

    assert final is not None
    assert sections.plan.contour_rule is not None
    assert sorted(final.level_places) == sorted(sections.plan.contour_rule.level_places)
    assert final.level_tops == sections.plan.contour_rule.level_tops
    assert np.isin([top for top, _, _ in final.level_places], sections.plan.top).all()
