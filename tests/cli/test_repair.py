"""What the command line tells about meshes that need repair, and what --strict refuses."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from command_line import PARTS, QUICK, Outcome, is_message, typed

from printer_slicer.mesh_io import export_stl, load_mesh
from printer_slicer.model import Mesh
from tests.parts import box, joined, without


def refused(outcome: Outcome, *parts: object) -> None:
    assert (outcome.code, outcome.out) == (3, "")
    assert is_message(outcome, *parts)


def test_a_mesh_that_needs_repair_is_refused_when_that_is_asked_for(tmp_path: Path) -> None:
    export_stl(Mesh(load_mesh(PARTS / "cylinder.stl").triangles[1:]), tmp_path / "open.stl")
    for command in (["slice"], ["plan"], ["dry-run"], ["print", "--port", "sim:"]):
        refused(
            typed(*command, tmp_path / "open.stl", "--strict", *QUICK),
            "open",
            "needs repair: holes filled",
        )
    target = str(tmp_path / "open.svg")
    refused(typed("contours", tmp_path / "open.stl", "-o", target, "--strict"), "needs repair: holes filled")

    assert typed("slice", PARTS / "cylinder.stl", "--strict", "-o", tmp_path / "a.gcode", *QUICK).code == 0


def test_gaps_that_only_sections_can_close_are_told_and_refused_when_that_is_asked_for(
    tmp_path: Path,
) -> None:
    half = box((5, 10, 4))
    left = without(half, *np.flatnonzero((half.triangles[:, :, 0] == 5).all(axis=1)).tolist())
    right = without(half, *np.flatnonzero((half.triangles[:, :, 0] == 0).all(axis=1)).tolist())
    export_stl(joined([left, right.moved((5.5, 0, 0))]), tmp_path / "cracked.stl")
    told = typed("slice", tmp_path / "cracked.stl", *QUICK)
    facts = json.loads(typed("slice", tmp_path / "cracked.stl", "--json", *QUICK).out)

    assert "gaps in contours closed: 28" in told.out
    assert "the widest of 0.5 mm" in told.out
    assert facts["repairs"][0]["largest_gap_mm"] == 0.5
    assert facts["repairs"][0]["places"][0][0] == 5.25
    refused(
        typed("slice", tmp_path / "cracked.stl", "--strict", *QUICK),
        "cracked",
        "gaps in contours",
        "x 5.25",
    )
