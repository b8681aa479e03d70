"""Modifier volumes: settings of the part inside them."""

from __future__ import annotations

import numpy as np
import pytest

import printer_slicer as ps
from printer_slicer.model import Mesh, Toolpaths, Volumes
from printer_slicer.placing import join
from printer_slicer.profile import Profile, load_profile
from printer_slicer.profile.overrides import Override
from printer_slicer.roles import Role
from printer_slicer.stages import Stages
from printer_slicer.values import replace
from tests.parts import box, prism
from tests.supports.shapes import tee

PART = Mesh(box((40.0, 20.0, 6.0)).triangles, "part")
RIGHT = Mesh(box((25.0, 40.0, 20.0), (20.0, -10.0, -5.0)).triangles, "right")
"""Covers the right half of the part."""


def profile(base: dict[str, object] | None = None, **settings: object) -> Profile:
    """A profile with settings for the modifier `right`."""
    usual = load_profile(quality="standard", changes=base or {})
    if not settings:
        return usual
    overrides = (Override(object="right", set=settings),)  # type: ignore[arg-type]
    return replace(usual, quality=replace(usual.quality, overrides=overrides))


def sliced(wanted: Profile, part: Mesh = PART, *modifiers: Mesh) -> Stages:
    return ps.slice_stages(part, wanted, volumes=Volumes(modifiers=modifiers or (RIGHT,)))


def lengths(stages: Stages, role: Role) -> tuple[float, float]:
    """Length of all paths of a role in the left and the right half, mm."""
    paths: Toolpaths = stages.toolpaths.take(np.flatnonzero(stages.toolpaths.role == role))
    middle = stages.part.bounds.mean(axis=0)[0]
    if not paths.n_paths:
        return 0.0, 0.0
    is_inner = np.ones(len(paths.xy) - 1, np.bool_)
    is_inner[paths.start[1:-1] - 1] = False
    a, b = paths.xy[:-1][is_inner], paths.xy[1:][is_inner]
    length, x = np.hypot(*(b - a).T), np.stack([a[:, 0], b[:, 0]])
    low, high = x.min(axis=0), x.max(axis=0)
    share = np.clip((middle - low) / np.maximum(high - low, 1e-9), 0, 1)
    return float((length * share).sum()), float((length * (1 - share)).sum())


def test_density_and_pattern_change_inside_only() -> None:
    plain, dense = sliced(profile()), sliced(profile(infill_density=0.6, infill="grid"))
    before, after = (lengths(one, Role.INTERNAL_INFILL) for one in (plain, dense))
    ratio = 0.6 / load_profile(quality="standard").quality.infill_density

    assert after[0] == pytest.approx(before[0], rel=0.05)
    assert after[1] == pytest.approx(before[1] * ratio, rel=0.1)


def test_no_plastic_is_lost_or_laid_twice_at_the_border() -> None:
    solid = sliced(profile({"quality.infill_density": 1.0}))
    half = sliced(profile({"quality.infill_density": 1.0}, infill_angle_deg=45.0))

    assert half.program.filament_used == pytest.approx(solid.program.filament_used, rel=0.01)


def test_a_modifier_with_the_same_settings_changes_no_region() -> None:
    usual = load_profile(quality="standard").quality.infill_density
    plain, same = sliced(profile()), sliced(profile(infill_density=usual))

    for name in ("internal_infill", "solid_infill", "top_solid_infill", "bottom_solid_infill", "bridge"):
        one, other = (getattr(stages.regions, name).area() for stages in (plain, same))
        assert other == pytest.approx(one, abs=0.05)


def test_solid_layers_change_inside_only() -> None:
    plain, thick = sliced(profile()), sliced(profile(top_thickness=3.0, bottom_thickness=2.0))
    before, after = (lengths(one, Role.INTERNAL_INFILL) for one in (plain, thick))

    assert after[0] == pytest.approx(before[0], rel=0.05)
    assert after[1] < 0.5 * before[1]
    plain_top, thick_top = (lengths(one, Role.TOP_SOLID_INFILL) for one in (plain, thick))
    assert sum(thick_top) == pytest.approx(sum(plain_top), rel=0.05)  # the border is no surface


def test_speeds_of_infill_change_inside_only() -> None:
    stages = sliced(profile({"speeds.internal_infill": 60.0}, **{"speeds.internal_infill": 30.0}))
    program = stages.program
    own = program.role == Role.INTERNAL_INFILL
    right = program.xyz[own, 0] > stages.part.bounds.mean(axis=0)[0] + 1.0

    assert program.speed[own][right].max() <= 30.0 + 1e-6
    assert program.speed[own][~right].max() > 40.0


def test_the_last_of_several_modifiers_counts() -> None:
    everywhere = replace(PART, name="all")
    overrides = (
        Override(object="all", set={"infill_density": 0.0}),
        Override(object="right", set={"infill_density": 0.5}),
    )
    usual = load_profile(quality="standard")
    wanted = replace(usual, quality=replace(usual.quality, overrides=overrides))
    one, other = sliced(wanted, PART, everywhere, RIGHT), sliced(wanted, PART, RIGHT, everywhere)

    assert lengths(one, Role.INTERNAL_INFILL)[1] > 100 > lengths(one, Role.INTERNAL_INFILL)[0]
    assert sum(lengths(other, Role.INTERNAL_INFILL)) < 1


@pytest.mark.parametrize(("base", "inside"), [("off", "columns"), ("columns", "off")])
def test_supports_may_be_on_or_off_inside(base: str, inside: str) -> None:
    part = tee(height=10.0)
    right = Mesh(box((40.0, 40.0, 30.0), (5.0, -20.0, -5.0)).triangles, "right")
    half = sliced(profile({"support": base}, support=inside), part, right).supports
    both = sliced(profile({"support": "columns"}), part, right).supports

    assert half is not None
    assert both is not None
    area = [one.area.area()[-1] for one in (half, both)]
    assert area[0] == pytest.approx(area[1] / 2, rel=0.05)
    assert (half.area.xy[:, 0].mean() > both.area.xy[:, 0].mean()) == (inside == "columns")


def test_the_threshold_of_supports_changes_inside_only() -> None:
    corners = np.array([(0.0, 0.0), (8.0, 0.0), (23.0, 15.0), (15.0, 15.0)])  # a lean of 45 degrees
    lean = prism(corners, 40.0)
    lean = Mesh(lean.triangles[:, :, [0, 2, 1]][:, ::-1], "lean")
    part = Mesh(lean.triangles - lean.bounds[0], "lean")
    half = Mesh(box((60.0, 20.0, 60.0), (-10.0, -0.5, -10.0)).triangles, "right")
    found = ps.overhangs(part, profile({}, support_threshold_deg=60), volumes=Volumes(modifiers=(half,)))

    assert found.area.n_rings
    middle = 0.5 * (found.area.xy[:, 1].min() + found.area.xy[:, 1].max())
    assert np.ptp(found.area.xy[:, 1]) == pytest.approx(19.5, abs=0.1)
    assert middle


def test_modifiers_belong_to_their_object() -> None:
    two = join(
        [replace(PART, volumes=Volumes(modifiers=(RIGHT,))), replace(PART.moved((0, 30, 0)), name="other")]
    )
    stages = ps.slice_stages(two, profile(infill_density=0.8))
    paths = stages.toolpaths
    own = paths.take(np.flatnonzero(paths.role == Role.INTERNAL_INFILL))
    is_other = own.xy[own.start[:-1], 1] > stages.part.bounds.mean(axis=0)[1]

    assert own.length()[is_other].sum() < 0.6 * own.length()[~is_other].sum()


@pytest.mark.parametrize("changes", [{}, {"perimeters": 4}])
def test_without_settings_that_are_followed_nothing_changes(changes: dict[str, object]) -> None:
    wanted = profile(**changes)
    plain = ps.slice_part(PART, profile())

    assert (sliced(wanted).program.xyz == plain.xyz).all()


def test_unknown_names_are_refused() -> None:
    with pytest.raises(ps.PrinterSlicerError, match="no object named 'right'; objects: part"):
        ps.slice_stages(PART, profile(infill_density=0.6))
