"""What the command line tells about meshes that need repair, and what --strict refuses."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from command_line import PARTS, QUICK, Outcome, is_message, typed

from printer_slicer.mesh_io import export_stl
from tests.parts import box, joined, without


def refused(outcome: Outcome, *parts: object) -> None:
    assert outcome.code == 3
    assert is_message(outcome, *parts)


def test_a_mesh_that_needs_repair_is_refused_when_that_is_asked_for(tmp_path: Path) -> None:
    export_stl(without(box((8, 8, 3)), 0), tmp_path / "open.stl")
    for command in (["slice"], ["plan"], ["dry-run"], ["print", "--port", "sim:"]):
        refused(
            typed(*command, tmp_path / "open.stl", "--strict", *QUICK),
            "open",
            "needs repair: holes filled",
        )
    target = str(tmp_path / "open.svg")
    refused(typed("contours", tmp_path / "open.stl", "-o", target, "--strict"), "needs repair: holes filled")

    assert typed("slice", PARTS / "cylinder.stl", "--strict", "-o", tmp_path / "a.gcode", *QUICK).code == 0


@pytest.mark.parametrize(
    "command",
    [["slice"], ["plan"], ["dry-run"], ["print", "--port", "sim:"], ["contours", "-o", "open.svg"]],
    ids=str,
)
def test_every_command_tells_what_was_put_right(command: list[str], tmp_path: Path) -> None:
    export_stl(without(box((8, 8, 3)), 0), tmp_path / "open.stl")
    said = [str(tmp_path / word) if word == "open.svg" else word for word in command]

    in_words = typed(*said, tmp_path / "open.stl", *QUICK)
    as_json = typed(*said, tmp_path / "open.stl", "--json", *QUICK)

    assert (in_words.code, as_json.code) == (0, 0), in_words.err + as_json.err
    assert "repaired: holes filled: 1, first at x" in in_words.out
    documents = [json.loads(line) for line in as_json.out.splitlines()]
    told = [document["repairs"] for document in documents if "repairs" in document]
    assert told
    for (repair,) in told:
        assert (repair["kind"], repair["count"], len(repair["places"])) == ("holes filled", 1, 1)
        assert repair["largest_gap_mm"] > 0
        assert repair["area_guessed_mm2"] > 0


def test_places_of_repairs_are_those_of_the_part_as_scaled_and_turned(tmp_path: Path) -> None:
    export_stl(without(box((3, 5, 10), (7, 20, 30)), 0), tmp_path / "open.stl")
    places = []
    for flags in ((), ("--center", "50,60"), ("--units", "cm"), ("--scale", "2", "--rotate", "90")):
        said = typed("slice", tmp_path / "open.stl", "--json", *flags, *QUICK, "-o", tmp_path / "a.gcode")
        places.append(np.array(json.loads(said.out)["repairs"][0]["places"][0]))
    plain, placed, tens, turned = places

    assert ((plain >= [7, 20, 30]) & (plain <= [10, 25, 40])).all()
    assert placed.tolist() == plain.tolist()
    assert tens == pytest.approx(10 * plain, abs=0.01)
    assert turned == pytest.approx(2 * plain[[1, 0, 2]] * [-1, 1, 1], abs=0.01)


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
    assert "largest gap 0.5 mm" in told.out
    assert facts["repairs"][0]["largest_gap_mm"] == 0.5
    assert facts["repairs"][0]["places"][0][0] == 5.25
    refused(
        typed("slice", tmp_path / "cracked.stl", "--strict", *QUICK),
        "cracked",
        "gaps in contours",
        "x 5.25",
    )
