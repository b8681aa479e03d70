"""Features with their own layers: nothing is found where nothing is wrong, and planted faults are found."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from printer_slicer.arrays import Bool
from printer_slicer.gcode import write_gcode
from printer_slicer.inspection.coverage.model_check import Check, CheckOptions, check_gcode
from printer_slicer.model import Program
from printer_slicer.pipeline import slice_part
from printer_slicer.placing import Placement
from printer_slicer.profile import Profile
from printer_slicer.roles import Role
from tests.inspection.coverage.changed_programs import without
from tests.towers import optimal, towers

BOX_ENDS = 18.0
"""x of the model between the box and the ball, mm from its left side."""
HIGHEST = {"planner__error_price": 500.0, "support": "off"}


@cache
def profile(**changes: object) -> Profile:
    return optimal(**(HIGHEST | changes))


@cache
def program(roof: float, **changes: object) -> Program:
    return slice_part(towers(roof), profile(**changes))


def checked(made: Program, roof: float, asked: CheckOptions | None = None, **changes: object) -> Check:
    return check_gcode(write_gcode(made, profile(**changes)), towers(roof), asked or CheckOptions())


def in_ball(made: Program) -> Bool:
    """(M,) moves of the ball and its post above the base and below the roof."""
    x = made.xyz[:, 0]
    left = x[made.role == Role.EXTERNAL_PERIMETER].min()
    return np.asarray((x > left + BOX_ENDS) & (made.z_top > 2.1) & (made.z_top < 13.4))


@pytest.mark.parametrize(
    "changes", [{}, {"raft_height": 0.6}, {"internal_infill_every": 0.3}], ids=["bed", "raft", "thick"]
)
@pytest.mark.parametrize("roof", [0.0, 2.0])
def test_features_are_within_all_limits(roof: float, changes: dict[str, object]) -> None:
    check = checked(program(roof, **changes), roof, **changes)

    found = [one for one in check.findings if "unsupported" not in one.code]
    assert (found, check.problems) == ([], ())
    assert check.match.share > 0.99
    assert check.coverage.stack.group.max() == (3 if roof else 2)
    assert any("features have layers of their own" in note for note in check.notes)


def test_features_at_a_given_position_are_within_all_limits() -> None:
    made, part = program(0.0), towers(0.0)
    middle = (part.bounds[0] + part.bounds[1])[:2] / 2
    outer = made.xyz[made.role == Role.EXTERNAL_PERIMETER][:, :2]
    center = (outer.min(axis=0) + outer.max(axis=0)) / 2
    assert np.abs(center - middle).max() > 1

    check = checked(made, 0.0, CheckOptions(placement=Placement(center=tuple(center.tolist()))))

    assert (check.findings, check.problems) == ((), ())


def test_perimeters_that_are_missing_in_one_feature_are_found_in_its_layers() -> None:
    made = program(0.0)
    removed = in_ball(made) & (made.role != Role.TRAVEL) & (made.z_top > 6) & (made.z_top < 7)

    check = checked(without(made, removed), 0.0)

    assert check.findings
    assert all(one.z is not None and 5.5 < one.z < 7.5 for one in check.findings)


def test_a_feature_that_is_missing_is_found() -> None:
    made = program(0.0)

    check = checked(without(made, in_ball(made) & (made.role != Role.TRAVEL)), 0.0)

    assert any(one.code == "uncovered" for one in check.findings)
