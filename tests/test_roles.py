"""The table of roles: one row for each, and nothing that depends on their numbers."""

from __future__ import annotations

import ast
from pathlib import Path

import numpy as np

from printer_slicer.inspection.deposition.marks import Purpose, purposes_of_roles
from printer_slicer.profile import load_profile
from printer_slicer.roles import ROLES, Phase, Role, roles_with

PACKAGE = Path(__file__).parents[1] / "printer_slicer"


def test_every_role_has_its_row() -> None:
    assert len(ROLES) == len(Role)
    assert [role for role in Role if not ROLES[role].type_comment] == [Role.TRAVEL]


def test_rows_name_settings_that_there_are() -> None:
    profile = load_profile()

    for row in ROLES:
        assert getattr(profile.speeds, row.speed) > 0
        assert getattr(profile.accelerations, row.acceleration) > 0


def test_questions_are_answered_for_whole_arrays() -> None:
    roles = np.array(
        [Role.TRAVEL, Role.SKIRT, Role.INTERNAL_INFILL, Role.TOP_SOLID_INFILL, Role.INTERNAL_BRIDGE]
    )

    assert roles_with(is_part=True)[roles].tolist() == [False, False, True, True, True]
    assert roles_with(is_infill=True)[roles].tolist() == [False, False, True, True, False]
    assert roles_with(phase=Phase.INFILL, is_infill=True)[roles].tolist() == [
        False,
        False,
        True,
        False,
        False,
    ]
    assert roles_with(is_bridge=True)[roles].tolist() == [False, False, False, False, True]


def test_what_comments_say_is_read_back_as_the_same_kind_of_extrusion() -> None:
    purposes = [Purpose(purpose) for purpose in purposes_of_roles(np.arange(len(Role))).tolist()]

    assert purposes[Role.EXTERNAL_PERIMETER] == Purpose.EXTERNAL_PERIMETER
    assert purposes[Role.OVERHANG_PERIMETER] == Purpose.OVERHANG_PERIMETER
    assert purposes[Role.RAFT] == Purpose.SUPPORT_MATERIAL
    assert {role for role in Role if purposes[role] == Purpose.SKIRT} == {Role.SKIRT, Role.BRIM}
    assert {role for role in Role if purposes[role] == Purpose.UNKNOWN} == {Role.TRAVEL}


def test_no_role_is_compared_by_its_number() -> None:
    ordered = (ast.Lt, ast.LtE, ast.Gt, ast.GtE)
    texts = {path: path.read_text(encoding="utf-8") for path in sorted(PACKAGE.rglob("*.py"))}
    found = [
        (str(path.relative_to(PACKAGE)), ast.unparse(node))
        for path, text in texts.items()
        if "Role." in text
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Compare)
        and any(isinstance(operator, ordered) for operator in node.ops)
        and "Role." in ast.unparse(node)
    ]

    assert found == []
