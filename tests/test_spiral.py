"""Spirals: one bead from the bottom to the top, whatever the heights of the layers."""

from __future__ import annotations

import numpy as np
import pytest

from printer_slicer.errors import PartError
from printer_slicer.gcode_text import gcode_of
from printer_slicer.inspection.coverage.model_check import CheckOptions, check_gcode
from printer_slicer.model import LayerPlan, Mesh, Program
from printer_slicer.pipeline import slice_stages
from printer_slicer.profile import Profile
from printer_slicer.roles import Role
from printer_slicer.stages import Stages
from tests.parts import box, box_with_hole, plain, two_boxes

ONE_LOW = LayerPlan.from_tops(np.cumsum([0.3, 0.2, 0.2, *[0.32] * 18, 0.23, 0.32, 0.32]))
UNEVEN = LayerPlan.from_tops(np.cumsum([0.3, 0.2, 0.2, *[0.1] * 10, *[0.32] * 10, *[0.2] * 5]))
EVEN = LayerPlan.from_tops(np.arange(1, 31) * 0.2)
PLANS = pytest.mark.parametrize("plan", [EVEN, UNEVEN, ONE_LOW], ids=["even", "uneven", "one low"])


def spiral(**changes: object) -> Profile:
    return plain(spiral=True, **{"bottom_thickness": 0.6, "skirt_loops": 0} | changes)


def tower(plan: LayerPlan, side: float = 30.0) -> Mesh:
    return box((side, side, float(plan.top[-1])))


def sliced(mesh: Mesh, plan: LayerPlan) -> Stages:
    return slice_stages(mesh, spiral(), plan=plan)


def turns(program: Program) -> slice:
    """The moves above the bottom."""
    first = int(np.searchsorted(program.layer, np.searchsorted(program.plan.bottom, 0.6 - 1e-9)))
    return slice(first, program.n_moves - 1)


@PLANS
def test_above_the_bottom_the_bead_never_breaks_and_never_falls(plan: LayerPlan) -> None:
    program = sliced(tower(plan), plan).program

    above = turns(program)
    role = program.role[above]
    laid = np.flatnonzero(role != Role.TRAVEL)
    assert (role[laid[0] :] == Role.EXTERNAL_PERIMETER).all()
    z = program.xyz[above, 2][laid[0] :]
    assert (np.diff(z) >= -1e-9).all()
    assert z[-1] == pytest.approx(plan.top[-1])
    assert (program.filament[above][laid[0] :] > 0).all()


@PLANS
def test_every_turn_climbs_by_its_layer_and_the_last_one_is_flat(plan: LayerPlan) -> None:
    stages = sliced(tower(plan), plan)
    paths = stages.toolpaths

    own = np.flatnonzero(paths.layer >= 3).tolist()
    for path in own[:-1]:
        some = slice(paths.start[path], paths.start[path + 1])
        assert paths.z_offset[some][0] == pytest.approx(-plan.height[paths.layer[path]])
        assert paths.z_offset[some][-1] == pytest.approx(0)
        assert paths.path(path)[0] == pytest.approx(paths.path(path - 1)[-1], abs=1e-6) or path == own[0]
    assert (paths.z_offset[paths.start[-2] :] == 0).all()


@PLANS
def test_the_plastic_is_that_of_the_wall(plan: LayerPlan) -> None:
    """Between the ramps at both ends, which make one turn together, a turn fills down to the one below."""
    stages = sliced(tower(plan), plan)
    paths = stages.toolpaths

    own = np.flatnonzero(paths.layer >= 3)
    heights = []
    for path in own.tolist():
        some = slice(paths.start[path], paths.start[path + 1])
        share = paths.flow_ratio[some] * paths.height[path]
        far = np.hypot(*np.diff(paths.xy[some], axis=0).T)
        heights.append(float((far * (share[1:] + share[:-1]) / 2).sum()))
    around = 4 * (30 - 0.45)
    assert sum(heights) == pytest.approx(around * (plan.top[-1] - plan.bottom[3]), rel=2e-3)


@PLANS
def test_check_finds_nothing_wrong_with_it(plan: LayerPlan) -> None:
    mesh = tower(plan)
    stages = sliced(mesh, plan)

    check = check_gcode(gcode_of(stages.program, spiral()), stages.part, CheckOptions())

    assert [finding.message for finding in check.findings] == []
    assert not check.problems


def test_a_spiral_stands_on_a_raft_and_on_its_own_bottom() -> None:
    wanted = spiral(raft_height=1.0)
    stages = slice_stages(tower(EVEN), wanted, plan=EVEN)
    paths = stages.toolpaths

    base = int(paths.layer[paths.role == Role.RAFT].max()) + 1
    climbing = np.unique(
        paths.layer[np.repeat(np.arange(paths.n_paths), np.diff(paths.start))[paths.z_offset < 0]]
    )
    assert base > 1
    assert climbing.tolist() == list(range(base + 3, paths.plan.n_layers))


def test_a_part_with_a_hole_is_refused_with_the_place() -> None:
    with pytest.raises(PartError, match=r"spiral mode needs one outline.*at z .* mm there are 2") as caught:
        slice_stages(box_with_hole((20, 20, 3)), spiral())
    assert "quality.spiral" in str(caught.value)


def test_two_parts_are_refused() -> None:
    with pytest.raises(PartError, match="spiral mode needs one outline"):
        slice_stages(two_boxes(), spiral())


def test_a_part_lower_than_the_bottom_is_refused() -> None:
    with pytest.raises(PartError, match="spiral mode needs one outline"):
        slice_stages(box((10, 10, 0.4)), spiral())


@pytest.mark.parametrize("lean", [0.5, 1.0, -1.0])
def test_on_a_leaning_part_each_turn_begins_where_the_one_below_ends(lean: float) -> None:
    upright = box((20, 20, 6))
    sheared = upright.triangles.copy()
    sheared[..., 0] += lean * sheared[..., 2]
    plan = LayerPlan.from_tops(np.arange(1, 31) * 0.2)
    program = slice_stages(Mesh(sheared, "leaning"), spiral(), plan=plan).program

    above = turns(program)
    laid = np.flatnonzero(program.role[above] != Role.TRAVEL)
    assert len(laid) > 100
    assert np.array_equal(laid, np.arange(laid[0], laid[-1] + 1))
