"""Scarf joints: the same plastic on the same loop, in a slope."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.gcode_text import gcode_of
from printer_slicer.inspection.coverage.model_check import CheckOptions, check_gcode
from printer_slicer.model import LayerPlan, Program, Toolpaths
from printer_slicer.ordering.scarf import add_scarfs
from printer_slicer.pipeline import slice_stages
from printer_slicer.roles import Role
from tests.parts import box, cone, plain, sphere

PLAN = LayerPlan.from_tops(np.array([0.3, 0.5, 0.8, 0.9]))


def loops(points: int, radius: float) -> Toolpaths:
    angle = np.arange(points) / points * 2 * np.pi
    ring = radius * np.column_stack([np.cos(angle), np.sin(angle)])
    return Toolpaths.gathered(
        PLAN,
        xy=np.concatenate([ring] * 4),
        size=np.full(4, points),
        layer=np.arange(4),
        role=np.full(4, int(Role.EXTERNAL_PERIMETER)),
        width=np.full(4, 0.45),
        closed=True,
    )


@given(points=st.integers(3, 60), length=st.floats(0.5, 30), begin=st.floats(0, 0.9))
def test_slopes_lie_on_the_loop_and_make_up_the_whole_bead(points: int, length: float, begin: float) -> None:
    before = loops(points, 10)
    around = float(before.length()[0])

    after = add_scarfs(before, plain(scarf_length=length, scarf_start=begin))

    assert after.n_paths == 4
    assert np.array_equal(after.path(0), before.path(0))
    assert after.closed.tolist() == [True] + [around <= 2 * length] * 3
    if around <= 2 * length:
        return
    assert after.length()[1:] == pytest.approx(around + length)
    for path in range(1, 4):
        some = slice(after.start[path], after.start[path + 1])
        far = np.hypot(*np.diff(after.xy[some], axis=0, prepend=after.xy[some][:1]).T)
        share, rise, height = after.flow_ratio[some], after.z_offset[some], PLAN.height[path]
        # Both passes over a place together are one bead; the nozzle stands on what the first one laid.
        walked = np.cumsum(far)
        for place in np.linspace(0.01, 0.99, 7) * length:
            low = np.interp(place, walked, share)
            high = np.interp(place + around, walked, share)
            assert low + high == pytest.approx(1, abs=1e-6)
            assert np.interp(place, walked, rise) == pytest.approx(-height * (1 - low), abs=1e-6)
        assert share[0] == pytest.approx(begin)
        assert rise.min() >= -height - 1e-9
        assert rise.max() <= 1e-9


def of_part(**changes: object) -> Program:
    return slice_stages(box((20, 15, 2)), plain(**changes)).program


def test_the_plastic_of_a_part_stays_what_it_was() -> None:
    plain_seams, sloped = of_part(), of_part(scarf_length=8, scarf_start=0)

    assert sloped.filament_used == pytest.approx(plain_seams.filament_used, rel=1e-5)
    outer = (sloped.role == Role.EXTERNAL_PERIMETER) & (sloped.layer > 0)
    below = sloped.plan.top[sloped.layer] - sloped.xyz[:, 2]
    assert below[outer].max() < sloped.plan.height.max()
    assert (sloped.start[outer, 2] < sloped.plan.top[sloped.layer[outer]] - 0.1).sum() >= 9
    assert (sloped.height[outer] > 0).all()


def test_the_nozzle_comes_down_where_the_slope_begins_and_not_before() -> None:
    program = of_part(scarf_length=8)

    way = program.xyz - program.start
    down = (way[:, 2] < -1e-6) & (np.arange(program.n_moves) > 1)
    assert down.sum() >= 9
    assert (np.hypot(*way[down, :2].T) == 0).all()
    # What follows is the bead that begins there.
    following = program.role[np.flatnonzero(down) + 1]
    assert (following == Role.EXTERNAL_PERIMETER).all()


def test_check_knows_slopes_for_what_they_are() -> None:
    wanted = plain(scarf_length=8)
    stages = slice_stages(cone(12, 6), wanted)

    check = check_gcode(gcode_of(stages.program, wanted), stages.part, CheckOptions())

    assert [finding.message for finding in check.findings] == []


def test_inner_perimeters_are_sloped_when_asked() -> None:
    program = slice_stages(sphere(8), plain(scarf_length=5, scarf_inner=True)).program

    inner = program.role == Role.PERIMETER
    assert (program.start[inner, 2] < program.plan.top[program.layer[inner]] - 0.05).sum() > 20
