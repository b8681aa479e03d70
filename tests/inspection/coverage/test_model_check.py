"""G-code against its model: planted faults are found at their layers, and nothing is found where nothing is wrong."""

from __future__ import annotations

import shutil
import subprocess
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from printer_slicer import bead
from printer_slicer.errors import UsageError
from printer_slicer.gcode import write_gcode
from printer_slicer.inspection.coverage.limits import CoverageLimits
from printer_slicer.inspection.coverage.measurement import CoverageRules
from printer_slicer.inspection.coverage.model_check import Check, CheckOptions, check_gcode
from printer_slicer.inspection.deposition.marks import Purpose
from printer_slicer.mesh_io import export_stl
from printer_slicer.model import LayerPlan, Mesh, Program
from printer_slicer.pipeline import slice_part
from printer_slicer.placing import Placement
from printer_slicer.roles import Role
from tests.effort import examples
from tests.inspection.coverage.changed_programs import without
from tests.parts import box, box_with_hole, joined, plain, sphere
from tests.test_values import arrays
from tests.waiting import LAST_RESORT

PROFILE = plain(layer_height=0.3, first_layer_height=0.3, planner__kind="uniform", infill_density=0.2)
PART = box_with_hole((20.0, 20.0, 6.0))


@cache
def program() -> Program:
    return slice_part(PART, PROFILE)


def checked(made: Program, mesh: Mesh = PART, asked: CheckOptions | None = None) -> Check:
    return check_gcode(write_gcode(made, PROFILE), mesh, asked or CheckOptions())


def kinds_at(check: Check, layer: int) -> set[str]:
    return {one.code for one in check.findings if layer in one.affected_layers}


def other_layers(check: Check, *layers: int) -> list[int]:
    found = {k for one in check.findings for k in one.affected_layers}
    return sorted(found - set(layers))


# --- nothing wrong ---


def test_a_slice_of_our_own_passes() -> None:
    check = checked(program())

    assert check.findings == ()
    assert check.problems == ()
    assert check.ok
    assert check.match.share > 0.99
    coverage = check.coverage
    assert coverage.stack.n_layers == program().plan.n_layers
    assert coverage.outside.area().sum() == pytest.approx(0, abs=0.01)
    assert coverage.uncovered.area().sum() < 0.002 * coverage.shell.area().sum()
    assert (np.abs(coverage.fill.shell - 1) < 0.05).all()


def test_every_array_of_a_check_is_read_only() -> None:
    found = list(arrays(checked(program()), "check"))

    assert len(found) > 30
    assert [name for name, array in found if array.flags.writeable] == []


def test_what_is_laid_is_what_is_fed() -> None:
    made = program()
    coverage = checked(made).coverage

    fed = made.filament[made.role != Role.TRAVEL].sum() * np.pi * 1.75**2 / 4
    assert coverage.by_purpose.sum() == pytest.approx(fed, rel=1e-3)
    assert coverage.volume.sum() == pytest.approx(
        coverage.by_purpose.sum() - coverage.by_purpose[Purpose.SKIRT]
    )


def test_of_a_sphere_only_the_flattest_layers_are_told() -> None:
    # Its second layer reaches out by more than a bead, and no beads fit into the middle of its first and last ones.
    # Where the skin ends, solid strips and the anchors of sparse lines lie side by side.
    profile = plain(first_layer_height=0.2)
    mesh = sphere(radius=8)
    check = check_gcode(write_gcode(slice_part(mesh, profile), profile), mesh, CheckOptions())

    n_layers = check.coverage.stack.n_layers
    more = [one for one in check.findings if one.code == "overfilled"]
    assert all(one.amount < 1.125 for one in more)
    assert {one.code for one in check.findings} <= {"unsupported", "underfilled", "overfilled"}
    assert all(one.last < 4 or one.first > n_layers - 3 for one in check.findings if one not in more)


@settings(max_examples=examples(4))
@given(st.tuples(*[st.integers(8, 30)] * 2, st.integers(1, 4)), st.floats(-40, 40), st.floats(-40, 40))
def test_any_box_passes_wherever_it_lies(size: tuple[int, int, int], x: float, y: float) -> None:
    mesh = box((float(size[0]), float(size[1]), float(size[2])))
    made = slice_part(mesh, PROFILE, placement=Placement(center=(x, y)))
    check = checked(made, mesh.moved((3.0, -7.0, 1.0)))

    assert check.findings == ()
    assert check.match.shift == pytest.approx((x - size[0] / 2 - 3, y - size[1] / 2 + 7), abs=0.005)
    assert check.z == pytest.approx(-1)


# --- planted faults ---


def test_a_missing_wall_is_found() -> None:
    made = program()
    check = checked(without(made, (made.layer == 7) & (made.role == Role.EXTERNAL_PERIMETER)))

    assert {"uncovered", "underfilled", "outline"} <= kinds_at(check, 7)
    assert other_layers(check, 7) == []
    worst = next(one for one in check.findings if one.code == "uncovered")
    gap = float(bead.spacing(PROFILE.extrusion_width, 0.3))
    # Inner perimeters beside it are wider by what its round side leaves empty.
    wall = (gap - float(bead.compute_side_extension(0.3)) / 2) * (4 * (20 - gap) + 4 * (8 + gap))
    assert check.coverage.uncovered.area()[worst.layer - 1] == pytest.approx(wall, rel=0.05)


def test_a_missing_inner_wall_is_found() -> None:
    made = program()
    check = checked(without(made, (made.layer == 9) & (made.role == Role.PERIMETER)))

    assert {"uncovered", "underfilled"} <= kinds_at(check, 9)
    assert other_layers(check, 9) == []


@pytest.mark.parametrize("by", [0.3, 2.0])
def test_a_shifted_layer_is_found(by: float) -> None:
    made = program()
    moved = made.xyz + np.where(made.layer == 6, by, 0.0)[:, None] * np.array([1.0, 0.0, 0.0])
    check = checked(replace(made, xyz=moved))

    assert {"outline", "outside"} <= kinds_at(check, 6)
    # What is laid over it may hang.
    assert other_layers(check, 6, 7) == []
    assert check.match.shift == pytest.approx((-10.0, -10.0), abs=0.01)


@pytest.mark.parametrize("share", [0.8, 1.25])
def test_too_little_and_too_much_plastic_in_some_layers_is_found(share: float) -> None:
    made = program()
    some = (made.layer >= 4) & (made.layer <= 6) & (made.role != Role.TRAVEL)
    check = checked(replace(made, filament=made.filament * np.where(some, share, 1.0)))

    kind = "underfilled" if share < 1 else "overfilled"
    found = [one for one in check.findings if one.code == kind]
    assert [(one.first, one.last) for one in found] == [(5, 7)]
    assert found[0].amount == pytest.approx(share, abs=0.08)
    # Beads that hold too much for their layer may reach down into the one below.
    assert other_layers(check, *([3] if share > 1 else []), 4, 5, 6) == []


def test_too_little_plastic_everywhere_is_found() -> None:
    made = program()
    check = checked(replace(made, filament=made.filament * np.where(made.role != Role.TRAVEL, 0.8, 1.0)))

    found = [one for one in check.findings if one.code == "underfilled"]
    assert [(one.first, one.last) for one in found] == [(1, made.plan.n_layers)]


def test_a_skipped_layer_is_found() -> None:
    made = program()
    check = checked(without(made, made.layer == 5))

    # The layers above it are one down now: the sixth that is there has twice the height to fill.
    assert check.coverage.stack.n_layers == made.plan.n_layers - 1
    assert "underfilled" in kinds_at(check, 5)
    assert other_layers(check, 5) == []
    under = next(one for one in check.findings if one.code == "underfilled")
    assert under.amount == pytest.approx(0.5, abs=0.05)
    assert "0.6 mm" in under.message


@pytest.mark.parametrize("missing", [0, 1, 2])
def test_missing_layers_at_the_top_are_found(missing: int) -> None:
    even = LayerPlan.from_tops(np.arange(1, 21) * PART.height / 20)
    made = slice_part(PART, PROFILE, plan=even)

    problems = checked(without(made, made.layer >= 20 - missing)).problems
    assert any("below the top of the part" in one for one in problems) == (missing > 0)


def test_a_skipped_layer_with_all_above_it_lowered_is_found() -> None:
    made = program()
    lower = np.where(made.layer > 5, made.plan.height[5], 0.0)
    lowered = replace(made, xyz=made.xyz - lower[:, None] * [0, 0, 1])

    problems = checked(without(lowered, made.layer == 5)).problems
    assert any("below the top of the part" in one for one in problems)


def test_infill_laid_twice_is_found() -> None:
    made = program()
    twice = (made.layer == 0) & (made.role == Role.BOTTOM_SOLID_INFILL)
    check = checked(replace(made, filament=made.filament * np.where(twice, 2.0, 1.0)))

    assert "overlap" in kinds_at(check, 0)
    assert other_layers(check, 0) == []


def test_a_part_that_begins_in_the_air_is_found() -> None:
    made = program()
    check = checked(without(made, made.layer < 3), asked=CheckOptions(placement=Placement(center=(0, 0))))

    assert not check.ok


def test_the_wrong_model_is_found() -> None:
    text = write_gcode(program(), PROFILE)
    bare = b"\n".join(line for line in text.split(b"\n") if not line.startswith(b";"))

    for one in (text, bare):
        check = check_gcode(one, sphere(radius=4), CheckOptions())
        assert any("match this model" in problem for problem in check.problems)


def test_layers_are_those_of_the_file_if_the_model_is_another_part() -> None:
    made = slice_part(joined([box((40.0, 40.0, 1.2)), box((5.0, 5.0, 6.0), at=(14.0, 14.0, 0.0))]), PROFILE)
    elsewhere = CheckOptions(placement=Placement(center=(0, 0)))
    check = checked(made, box((5.0, 5.0, 6.0)), elsewhere)

    assert check.coverage.stack.n_layers == made.plan.n_layers
    assert any("match this model" in problem for problem in check.problems)


# --- what is asked ---


def test_where_the_part_lies_may_be_told() -> None:
    right = checked(program(), asked=CheckOptions(placement=Placement(center=(0, 0))))
    wrong = checked(program(), asked=CheckOptions(placement=Placement(center=(0.5, 0))))

    assert right.ok
    assert not right.matched
    assert {"outside", "outline"} <= {one.code for one in wrong.findings}


def test_limits_decide_what_is_told() -> None:
    assert checked(program(), asked=CheckOptions(limits=CoverageLimits(underfilled=1.08))).findings != ()


def test_a_deeper_shell_holds_the_infill_to_account() -> None:
    check = checked(program(), asked=CheckOptions(rules=CoverageRules(shell=5.0)))

    assert {"uncovered", "underfilled"} <= {one.code for one in check.findings}


def test_a_file_without_comments_is_understood() -> None:
    made = program()
    text = b"\n".join(line for line in write_gcode(made, PROFILE).split(b"\n") if not line.startswith(b";"))
    check = check_gcode(text, PART, CheckOptions())

    assert check.findings == ()
    assert check.problems == ()
    assert any("1.75 mm is assumed" in note for note in check.notes)
    assert any("shell of two lines" in note for note in check.notes)


def test_a_line_that_primes_the_nozzle_makes_no_layer() -> None:
    text = write_gcode(program(), PROFILE)
    bare = b"\n".join(line for line in text.split(b"\n") if not line.startswith(b";"))
    prime = b"M83\nG0 X-100 Y-100 Z0.42\nG1 X-40 E8\nG92 E0\n"
    check = check_gcode(prime + bare, PART, CheckOptions())

    assert check.coverage.stack.top[0] == pytest.approx(0.3)
    assert check.findings == ()


def test_beads_that_fly_far_away_are_told_and_measured_no_further() -> None:
    lines = write_gcode(program(), PROFILE).split(b"\n")
    at = lines.index(b";TYPE:Perimeter")
    check = check_gcode(b"\n".join([*lines[: at + 2], b"G1 X90000 E5", *lines[at + 2 :]]), PART)

    assert any("far from the part" in problem and str(at + 3) in problem for problem in check.problems)
    assert check.coverage.covered.xy.max() < 100


def test_beads_on_the_bed_itself_make_no_layer() -> None:
    lines = write_gcode(program(), PROFILE).split(b"\n")
    at = lines.index(b";TYPE:Perimeter")
    check = check_gcode(b"\n".join([*lines[:at], b"G1 Z0", b"G1 X3 E9", b"G1 Z0.3", *lines[at:]]), PART)

    assert check.coverage.stack.top[0] == pytest.approx(0.3)


def test_beads_of_absurd_width_are_drawn_no_wider_than_a_centimetre() -> None:
    made = program()
    huge = (made.layer == 3) & (made.role == Role.EXTERNAL_PERIMETER)
    check = checked(replace(made, filament=made.filament * np.where(huge, 1e4, 1.0)))

    assert {"overfilled", "outside", "outline"} <= kinds_at(check, 3)
    assert check.coverage.covered.xy.max() < 20.1


def test_text_without_beads_is_refused() -> None:
    with pytest.raises(UsageError, match="no extrusion of a part"):
        check_gcode(b"G28\nG1 X10\n", PART, CheckOptions())
    with pytest.raises(UsageError, match="binary G-code"):
        check_gcode(b"GCDE\x01\x00", PART)


# --- other slicers ---


@pytest.mark.skipif(not shutil.which("prusa-slicer"), reason="PrusaSlicer is not installed")
def test_a_file_of_prusaslicer_passes(tmp_path: Path) -> None:
    model, gcode = tmp_path / "part.stl", tmp_path / "part.gcode"
    export_stl(PART, model)
    command = ["prusa-slicer", "--export-gcode", str(model), "--output", str(gcode), "--layer-height", "0.3"]
    subprocess.run(command, check=True, capture_output=True, timeout=LAST_RESORT)
    check = check_gcode(gcode.read_bytes(), PART, CheckOptions())

    assert check.problems == ()
    assert check.findings == ()
    assert check.match.share > 0.99
