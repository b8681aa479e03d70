"""`check` and `dry-run` of several files: one line each, and the worst exit code."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from command_line import BOX, QUICK, typed


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a good file and one that moves before homing, beyond the axis."""
    folder = tmp_path_factory.mktemp("gcode")
    assert typed("slice", BOX, "-o", folder / "good.gcode", *QUICK).code == 0
    (folder / "bad.gcode").write_text("G1 X900 E5 F600\n")
    return folder


@pytest.mark.parametrize("command", ["check", "dry-run"])
def test_each_file_has_a_line_and_the_worst_code_counts(files: Path, command: str) -> None:
    good, bad = files / "good.gcode", files / "bad.gcode"
    one, other = typed(command, good), typed(command, bad)
    both = typed(command, good, bad, files / "missing.gcode")
    told = json.loads(typed(command, good, bad, "--json").out)["files"]

    assert (one.code, other.code, both.code) == (0, 7, 7)
    lines = both.out.splitlines()
    assert [line.split()[0] for line in lines[:3]] == [str(good), str(bad), str(files / "missing.gcode")]
    assert [line.split()[1].rstrip(";") for line in lines[:3]] == ["ok", "failed:", "failed:"]
    assert "line 1" in lines[1]
    assert lines[3] == "1 of 3 files without problems"
    assert [(Path(one["file"]).name, one["exit_code"]) for one in told] == [
        ("good.gcode", 0),
        ("bad.gcode", 7),
    ]
    assert typed(command, good, good).code == 0


def test_patterns_are_expanded(files: Path) -> None:
    assert "1 of 2 files without problems" in typed("check", files / "*.gcode").out


def test_options_for_one_file_are_rejected(files: Path) -> None:
    both = (files / "good.gcode", files / "bad.gcode")
    assert "one file is compared" in typed("check", *both, "--model", BOX).err
    assert "one picture cannot show 2 files" in typed("dry-run", *both, "--picture", files / "a.png").err
