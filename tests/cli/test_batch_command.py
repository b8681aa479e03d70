"""`batch` slices like `slice`, reports each part, and goes on where it ended."""

from __future__ import annotations

import csv
import json
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from command_line import BOX, MACHINE, PARTS, QUICK, USUAL, typed

import printer_slicer as ps
from printer_slicer.batching.manifest import MANIFEST
from tests.parts import box
from tests.supports.shapes import tee
from tests.waiting import until


@pytest.fixture
def models(tmp_path: Path) -> list[Path]:
    """A tile, a tee that prints better upside down, and a file that is no model."""
    ps.export_stl(box((12, 9, 2)), tmp_path / "tile.stl")
    ps.export_stl(tee(), tmp_path / "tee.stl")
    (tmp_path / "broken.stl").write_bytes(b"solid nothing")
    return [tmp_path / "tile.stl", tmp_path / "broken.stl", tmp_path / "tee.stl"]


@pytest.mark.parametrize(
    "options",
    [[], ["--orient", "fast", "--rotate", "30"], ["--copies", "3", "--scale", "50%"]],
    ids=["plain", "oriented", "copies"],
)
def test_the_gcode_is_that_of_slice(models: list[Path], tmp_path: Path, options: list[str]) -> None:
    tile, _, part = models
    folder, single = tmp_path / "out", tmp_path / "single"
    assert typed("batch", tile, part, "--output-dir", folder, "--jobs", 1, *options, *QUICK).code == 0

    for path in (tile, part):
        assert typed("slice", path, "--output-dir", single, *options, *QUICK).code == 0
        assert (folder / f"{path.stem}.gcode").read_bytes() == (single / f"{path.stem}.gcode").read_bytes()


def test_a_part_that_cannot_be_sliced_costs_one_row(models: list[Path], tmp_path: Path) -> None:
    folder, table, page = tmp_path / "out", tmp_path / "r.csv", tmp_path / "r.html"
    outcome = typed(
        "batch", *models, "--output-dir", folder, "--jobs", 1, "--report", table, "--report", page, *QUICK
    )

    assert outcome.code == 3
    assert "broken  failed: " in outcome.out
    assert "2 of 3 sliced" in outcome.out
    assert sorted(path.name for path in folder.glob("*.gcode")) == ["tee.gcode", "tile.gcode"]
    rows = list(csv.DictReader(table.read_text().splitlines()))
    assert [row["part"] for row in rows] == ["tile.stl", "broken.stl", "tee.stl"]
    assert [row["status"] for row in rows] == ["done", "failed", "done"]
    assert float(rows[0]["filament_g"]) > 0
    assert page.read_text().count("<tr") == 4
    assert page.read_text().count("data:image/png;base64,") == 2


def test_a_sweep_marks_the_rows_that_no_other_beats(models: list[Path], tmp_path: Path) -> None:
    outcome = typed(
        *("batch", models[2], "--output-dir", tmp_path / "out", "--jobs", 1, "--json", *MACHINE),
        *("--matrix", "quality=standard,fine", "--matrix", "perimeters=1,3"),
    )
    assert outcome.code == 0, outcome.err
    rows = json.loads(outcome.out)["tasks"]

    assert [(row["quality"], row["perimeters"]) for row in rows] == [
        ("standard", "1"),
        ("standard", "3"),
        ("fine", "1"),
        ("fine", "3"),
    ]
    assert rows[0]["files"] == "tee-quality-standard-perimeters-1.gcode"
    figures = [(row["seconds"], row["max_error_mm"], row["volume_error_mm3"]) for row in rows]
    for row, own in zip(rows, figures, strict=True):
        beaten = any(all(a <= b for a, b in zip(one, own, strict=True)) and one != own for one in figures)
        assert row["best"] == (not beaten)


def test_resume_slices_only_what_is_missing(models: list[Path], tmp_path: Path) -> None:
    folder = tmp_path / "out"
    line = ["batch", models[0], models[2], "--output-dir", folder, "--jobs", 1, *QUICK]
    assert typed(*line).code == 0
    before = {path.name: path.stat().st_mtime_ns for path in folder.glob("*.gcode")}
    (folder / "tee.gcode").unlink()

    page = tmp_path / "r.html"
    assert typed(*line, "--resume", "--report", page).code == 0
    assert page.read_text().count("data:image/png;base64,iVBOR") == 2
    after = {path.name: path.stat().st_mtime_ns for path in folder.glob("*.gcode")}
    assert after["tile.gcode"] == before["tile.gcode"]
    assert after["tee.gcode"] > before["tee.gcode"]


def test_models_with_the_same_name_get_the_name_of_their_folder(tmp_path: Path) -> None:
    paths = [tmp_path / folder / "lid.stl" for folder in ("a", "b")]
    for path in paths:
        path.parent.mkdir()
        ps.export_stl(box((6, 6, 1)), path)
    assert typed("batch", *paths, "--output-dir", tmp_path / "out", "--jobs", 1, *QUICK).code == 0
    assert sorted(path.name for path in (tmp_path / "out").glob("*.gcode")) == ["a-lid.gcode", "b-lid.gcode"]


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--matrix", "nonsense=1,2"], "--matrix nonsense=1: "),
        (["--matrix", "perimeters"], "--matrix perimeters: expected KEY=VALUE"),
        (["--matrix", "quality=fine,draft", "--quality", "fine"], "--quality is given, too"),
        (["--report", "r.txt"], "--report r.txt: the name must end in .csv or .html"),
        (["--orient-keep-up", "20"], "has no effect without --orient"),
        (["--report", "missing/r.html"], "the folder missing does not exist"),
        (["--cluster", "tcp://127.0.0.1:1"], "127.0.0.1:1"),
    ],
)
def test_wrong_options_end_before_anything_is_sliced(tmp_path: Path, options: list[str], said: str) -> None:
    outcome = typed("batch", BOX, "--output-dir", tmp_path / "out", *options)
    assert outcome.code == 2
    assert said in outcome.err
    assert not list(tmp_path.glob("out/*.gcode"))


def test_a_model_that_is_named_twice_is_rejected(tmp_path: Path) -> None:
    outcome = typed("batch", BOX, BOX, "--output-dir", tmp_path)
    assert outcome.code == 2
    assert "is named 2 times" in outcome.err


@pytest.mark.skipif(sys.platform == "win32", reason="signals")
def test_ctrl_c_leaves_whole_files_and_a_manifest(tmp_path: Path) -> None:
    folder, parts = tmp_path / "out", sorted(PARTS.glob("*.stl"))
    command = [sys.executable, "-m", "printer_slicer", "batch", *parts, "--output-dir", folder, "--jobs", "1"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env=USUAL) as running:
        until(lambda: (folder / MANIFEST).exists() and (folder / MANIFEST).stat().st_size > 0)
        running.send_signal(signal.SIGINT)
        _, said = running.communicate()

    assert running.returncode == 6
    assert "continue with --resume" in said
    assert "Traceback" not in said
    noted = [json.loads(line) for line in (folder / MANIFEST).read_text().splitlines()]
    assert 0 < len(noted) < len(parts)
    for file in folder.glob("*.gcode"):
        assert file.read_text().rstrip().splitlines()[-1].startswith(";")
    assert not list(folder.glob(".*.partial"))


def test_plan_compares_settings_and_marks_the_plans_that_no_other_beats() -> None:
    line = [
        "plan",
        PARTS / "vase.stl",
        "--matrix",
        "tolerance=0.05,0.1",
        "--matrix",
        "quality=adaptive",
        *MACHINE,
    ]
    rows = json.loads(typed(*line, "--json").out)["plans"]
    shown = typed(*line).out

    assert [row["choices"]["tolerance"] for row in rows] == ["0.05", "0.1"]
    assert rows[0]["max_error_mm"] < rows[1]["max_error_mm"]
    assert rows[0]["seconds"] > rows[1]["seconds"]
    assert [row["best"] for row in rows] == [True, True]
    assert "* tolerance=0.05 quality=adaptive" in shown
    refused = typed(*line, "--compare")
    assert (refused.code, "--matrix: --compare" in refused.err) == (2, True)
