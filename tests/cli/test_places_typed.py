"""Settings of objects and heights as they are typed, measured in the G-code that is written."""

from __future__ import annotations

import re
from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest
from command_line import BOX, typed

from printer_slicer.mesh_io import export_stl, load_mesh
from printer_slicer.model import Mesh


def fed(path: Path) -> dict[tuple[str, float, bool], float]:
    """Filament in mm by what the file calls it, height, and whether it lies in the right half of the bed."""
    found: dict[tuple[str, float, bool], float] = defaultdict(float)
    what, z, x = "", 0.0, 0.0
    for line in path.read_text().splitlines():
        if line.startswith(";TYPE:"):
            what = line[6:]
        words = dict(re.findall(r"([XYZE])(-?[\d.]+)", line.partition(";")[0])) if line[:2] == "G1" else {}
        z, x = float(words.get("Z", z)), float(words.get("X", x))
        if "E" in words and words.keys() & {"X", "Y"}:
            found[what, round(z, 3), x > 110] += float(words["E"])
    return found


def sliced(path: Path, *arguments: object) -> dict[tuple[str, float, bool], float]:
    outcome = typed(
        "slice", *arguments, "-o", path, "--quiet", "--planner", "uniform", "--set", "infill=rectilinear"
    )
    assert (outcome.code, outcome.err) == (0, "")
    return fed(path)


def sparse(
    found: dict[tuple[str, float, bool], float], low: float, high: float, right: bool | None = None
) -> float:
    return sum(
        length
        for (what, z, half), length in found.items()
        if what == "Internal infill" and low < z <= high and right in (None, half)
    )


def test_a_range_changes_its_heights_and_no_other(tmp_path: Path) -> None:
    usual = sliced(tmp_path / "usual.gcode", BOX, "--set", "infill_density=0.15")
    other = sliced(
        tmp_path / "other.gcode", BOX, "--set", "infill_density=0.15", "--range", "2:3:infill_density=0.45"
    )

    assert sparse(other, 2.0, 3.0) == pytest.approx(3 * sparse(usual, 2.0, 3.0), rel=0.15)
    assert sparse(other, 1.4, 1.8) == pytest.approx(sparse(usual, 1.4, 1.8), rel=0.02)


def test_an_object_has_its_own_infill_beside_another(tmp_path: Path) -> None:
    box = load_mesh(BOX)
    for name, left in {"lid": 0.0, "can": 40.0}.items():
        export_stl(Mesh(box.triangles + np.array([left, 0.0, 0.0]), name), tmp_path / f"{name}.stl")
    plate = [tmp_path / "lid.stl", tmp_path / "can.stl", "--set", "infill_density=0.15"]
    usual = sliced(tmp_path / "usual.gcode", *plate)
    other = sliced(tmp_path / "other.gcode", *plate, "--set-for", "can:infill_density=0.45")

    assert sparse(other, 1.4, 3.0, right=True) == pytest.approx(
        3 * sparse(usual, 1.4, 3.0, right=True), rel=0.15
    )
    assert sparse(other, 1.4, 3.0, right=False) == pytest.approx(
        sparse(usual, 1.4, 3.0, right=False), rel=0.02
    )
