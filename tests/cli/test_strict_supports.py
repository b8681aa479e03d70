"""Islands without supports fail a run on request, and nothing about supports is left unsaid."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from command_line import QUICK, typed

import printer_slicer as ps
from printer_slicer.errors import PartError
from printer_slicer.mesh_io import export_stl
from printer_slicer.profile import load_profile
from tests.parts import box, joined
from tests.supports.shapes import hook, round_body, tee


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    export_stl(hook(), tmp_path / "hook.stl")
    export_stl(tee(10.0, 10.0), tmp_path / "tee.stl")
    export_stl(round_body([(5.0, 0.0), (5.0, 10.0), (9.0, 11.0), (9.0, 14.0)]), tmp_path / "vase.stl")
    export_stl(box((3, 3, 3), (0, 0, 0)), tmp_path / "low.stl")
    export_stl(box((40, 40, 40), (0, -20, 0)), tmp_path / "all.stl")
    return tmp_path


@pytest.mark.parametrize("command", ["slice", "dry-run"])
def test_islands_without_supports_fail_on_request(folder: Path, command: str) -> None:
    words = (command, folder / "hook.stl", "--strict-supports", *QUICK)
    if command == "slice":
        words = (*words, "-o", folder / "x.gcode")
    outcome = typed(*words)

    assert outcome.code == 3
    said = " ".join(outcome.err.split())
    assert "hook" in said
    assert "1 island without support, the lowest at x 20.0 y 0.0 z 14.90: there are no supports" in said
    assert "--strict-supports" in said
    assert not (folder / "x.gcode").exists()


def test_islands_with_supports_pass(folder: Path) -> None:
    words = (
        folder / "hook.stl",
        "-o",
        folder / "x.gcode",
        "--supports",
        "columns",
        "--strict-supports",
        *QUICK,
    )

    assert typed("slice", *words).code == 0


def test_overhangs_without_islands_pass(folder: Path) -> None:
    assert typed("slice", folder / "tee.stl", "-o", folder / "x.gcode", "--strict-supports", *QUICK).code == 0


def test_blocked_islands_fail(folder: Path) -> None:
    words = (
        folder / "hook.stl",
        "-o",
        folder / "x.gcode",
        "--supports",
        "columns",
        "--strict-supports",
        *QUICK,
    )
    outcome = typed("slice", *words, "--support-blocker", folder / "all.stl")

    assert outcome.code == 3
    assert "a support blocker covers it" in " ".join(outcome.err.split())


def test_python_has_the_same_check() -> None:
    profile = load_profile(quality="standard")
    with pytest.raises(PartError, match="there are no supports"):
        ps.slice_stages(hook(), profile, strict_supports=True)
    columns = load_profile(quality="standard", changes={"support": "columns"})

    assert ps.job_of(hook(), columns, strict_supports=True).program is not None


def test_supports_in_spiral_mode_are_reported(folder: Path) -> None:
    words = (folder / "vase.stl", "-o", folder / "x.gcode", "--set", "spiral=true", *QUICK)

    assert "no supports are printed in spiral mode" in " ".join(
        typed("slice", *words, "--supports").err.split()
    )
    assert "supports" not in typed("slice", *words).err


def test_enforcers_in_which_nothing_hangs_are_reported(folder: Path) -> None:
    words = (folder / "tee.stl", "-o", folder / "x.gcode", "--supports", "columns", *QUICK)
    outcome = typed("slice", *words, "--support-enforcer", folder / "low.stl")

    assert "no overhang lies within the support enforcer at x, y, z" in " ".join(outcome.err.split())
    assert "enforcers" not in typed("slice", *words, "--support-enforcer", folder / "all.stl").err


def test_json_has_all_about_bare_places(folder: Path) -> None:
    cap = round_body([(3.0, 0.0), (3.0, 10.0), (14.0, 10.5), (14.0, 12.0)])
    export_stl(joined([cap, box((40, 40, 2), (-20, -20, 0))]), folder / "cap.stl")
    words = (folder / "cap.stl", "-o", folder / "x.gcode", "--supports", "columns", *QUICK, "--json")
    facts = json.loads(typed("slice", *words, "--set", "support_on_bed_only=true").out)["supports"]

    assert facts["unsupported_mm2"] == pytest.approx(
        sum(one["area_mm2"] for one in facts["unsupported_places"]), rel=0.01
    )
    assert facts["unsupported_mm2"] == pytest.approx(np.pi * (14**2 - 3**2), rel=0.1)
    assert max(one["free_distance_mm"] for one in facts["unsupported_places"]) == pytest.approx(11.0, abs=0.5)


def test_supports_are_no_remedy_where_they_are_on(folder: Path) -> None:
    words = ("slice", folder / "tee.stl", "-o", folder / "x.gcode", *QUICK)
    none, kept = typed(*words), typed(*words, "--supports", "columns", "--set", "support_min_area=1000")

    said = [" ".join(outcome.err.split()) for outcome in (none, kept)]
    assert all("of unsupported extrusion" in text for text in said)
    assert ["print supports with --supports" in text for text in said] == [True, False]


def test_blockers_without_effect_are_reported(folder: Path) -> None:
    words = (folder / "tee.stl", "-o", folder / "x.gcode", "--supports", "columns", *QUICK)
    outcome = typed("slice", *words, "--support-blocker", folder / "low.stl")

    said = " ".join(outcome.err.split())
    assert "nothing would get supports within the support blocker at x, y, z" in said
    assert "blocker" not in typed("slice", *words, "--support-blocker", folder / "all.stl").err
