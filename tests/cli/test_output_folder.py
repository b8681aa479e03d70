"""G-code of several models in a folder, one file for each."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from printer_slicer.mesh_io import export_stl
from tests.cli.command_line import BOX, PARTS, QUICK, typed
from tests.parts import box, cone

CONE = PARTS / "cone.stl"


def small_parts(folder: Path) -> None:
    """`box.stl` and `cone.stl`."""
    export_stl(box((6.0, 6.0, 2.0)), folder / "box.stl")
    export_stl(cone(4.0, 3.0, 12), folder / "cone.stl")


@pytest.mark.parametrize("flags", [("-o", "made/here/"), ("--output-dir", "made/here")])
def test_each_model_has_its_file_in_a_folder_that_is_made(flags: tuple[str, str], tmp_path: Path) -> None:
    small_parts(tmp_path)
    outcome = typed("slice", "box.stl", "cone.stl", *flags, "--json", *QUICK, cwd=tmp_path)

    assert outcome.code == 0, outcome.err
    assert sorted(path.name for path in (tmp_path / "made" / "here").iterdir()) == ["box.gcode", "cone.gcode"]
    told = [json.loads(line) for line in outcome.out.splitlines()]
    assert [one["output"] for one in told] == ["made/here/box.gcode", "made/here/cone.gcode"]
    assert [len(one["models"]) for one in told] == [1, 1]
    typed("slice", "cone.stl", "-o", "alone.gcode", *QUICK, cwd=tmp_path)
    assert (tmp_path / "made/here/cone.gcode").read_bytes() == (tmp_path / "alone.gcode").read_bytes()


def test_a_folder_that_is_there_is_a_folder(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()

    assert typed("slice", BOX, "-o", "out", *QUICK, cwd=tmp_path).code == 0
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["box.gcode"]


def test_models_that_would_share_a_file_or_a_picture_are_refused(tmp_path: Path) -> None:
    (tmp_path / "other").mkdir()
    shutil.copy(CONE, tmp_path / "other" / "box.stl")
    same = typed("slice", BOX, "other/box.stl", "-o", "out/", *QUICK, cwd=tmp_path)
    drawn = typed("slice", BOX, CONE, "-o", "out/", "--picture", "a.svg", *QUICK, cwd=tmp_path)
    both = typed("slice", BOX, "-o", "a.gcode", "--output-dir", "out", *QUICK, cwd=tmp_path)

    assert (same.code, drawn.code, both.code) == (2, 2, 2)
    assert ": out/box.gcode" in same.err
    assert not (tmp_path / "out").exists()


def test_a_folder_that_cannot_be_made_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    outcome = typed("slice", BOX, "-o", "file/out/", *QUICK, cwd=tmp_path)

    assert outcome.code == 2
    assert "file/out: the folder cannot be created" in outcome.err
