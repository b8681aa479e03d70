"""Files as read by programs that were not written here: print servers and what shows thumbnails.

They are asked in a Python of their own, for they hold on to versions of packages: `PRINTER_SLICER_READERS` names it,
else it is this one. Where a reader is not installed its tests are skipped. docs/gcode.md says how to install them.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from printer_slicer.extrusion import move_seconds
from printer_slicer.gcode_text import gcode_of
from printer_slicer.model import Program
from printer_slicer.pipeline import slice_stages
from printer_slicer.profile import Profile, profile_with
from printer_slicer.roles import Role
from printer_slicer.stages import Stages
from printer_slicer.version import VERSION
from tests.parts import cone, profile
from tests.waiting import LAST_RESORT

PYTHON = os.environ.get("PRINTER_SLICER_READERS", sys.executable)
MOONRAKER = """
import json, runpy, sys
from importlib.util import find_spec
from pathlib import Path
folder = Path(find_spec("moonraker").origin).parent
script = runpy.run_path(str(folder / "components" / "file_manager" / "metadata.py"))
print(json.dumps(script["extract_metadata"](sys.argv[1], [])))
"""
PRUSA = """
import json, sys
from gcode_metadata import get_metadata
found = get_metadata(sys.argv[1], save_cache=False)
print(json.dumps({"data": found.data, "thumbnails": {key: len(value) for key, value in found.thumbnails.items()}}))
"""
THUMBNAILS = """
import json, sys
from gcode_thumbnail_tool import extract_thumbnails_from_gcode_file
found = extract_thumbnails_from_gcode_file(sys.argv[1])
print(json.dumps([[image.width, image.height, image.getbbox()] for image in found.images]))
"""
PRINTERS = ["marlin_220", "corexy_klipper"]


@cache
def wanted(printer: str) -> Profile:
    """A bare start, so that what is fed is what the program feeds."""
    start = "G28\nM190 S{first_layer_bed_temperature}\nM109 S{first_layer_nozzle_temperature}"
    usual = profile(
        printer, quality="adaptive", start_gcode=start, end_gcode="M104 S0", thumbnails="32x32, 200x120"
    )
    return profile_with(usual, {"material.cost": 20})


@cache
def sliced(printer: str) -> Stages:
    return slice_stages(cone(), wanted(printer))


@pytest.fixture(params=PRINTERS)
def printed(request: pytest.FixtureRequest, tmp_path: Path) -> tuple[Path, Program, Profile]:
    """A file, and what is in it."""
    stages, usual = sliced(request.param), wanted(request.param)
    path = tmp_path / "cone.gcode"
    path.write_bytes(gcode_of(stages.program, usual, part=stages.part, made=datetime(2026, 1, 2, tzinfo=UTC)))
    return path, stages.program, usual


def asked(module: str, arguments: list[str]) -> str:
    """What the readers' Python prints; skips the test where it does not have the module."""
    if _missing(module):
        pytest.skip(f"{module} is not installed")
    done = subprocess.run(
        [PYTHON, *arguments], capture_output=True, text=True, timeout=LAST_RESORT, check=False, env=_bare()
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def _bare() -> dict[str, str]:
    return {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}


@cache
def _missing(module: str) -> bool:
    command = [PYTHON, "-c", f"import {module}"]
    return (
        subprocess.run(command, capture_output=True, timeout=LAST_RESORT, check=False, env=_bare()).returncode
        != 0
    )


def seconds_of(program: Program, usual: Profile) -> float:
    return float(move_seconds(program, usual).sum())


def grams(program: Program, usual: Profile) -> float:
    return float(program.filament_used * np.pi * 1.75**2 / 4000 * usual.material.density)


def test_moonraker_finds_everything(printed: tuple[Path, Program, Profile]) -> None:
    path, program, usual = printed
    found: dict[str, Any] = json.loads(asked("moonraker", ["-c", MOONRAKER, str(path)]))
    heights, counts = np.unique(np.round(program.plan.height, 4), return_counts=True)

    assert (found["slicer"], found["slicer_version"]) == ("printer_slicer", VERSION)
    assert found["layer_count"] == program.plan.n_layers
    assert found["object_height"] == pytest.approx(program.plan.top[-1])
    assert found["layer_height"] == heights[(heights * counts).argmax()]
    assert found["first_layer_height"] == pytest.approx(program.plan.height[0])
    assert found["estimated_time"] == pytest.approx(seconds_of(program, usual), abs=0.5)
    assert found["filament_total"] == pytest.approx(program.filament_used, abs=0.01)
    assert found["filament_weight_total"] == pytest.approx(grams(program, usual), abs=0.01)
    assert (found["filament_type"], found["filament_name"]) == ("PLA", usual.material.name)
    assert found["nozzle_diameter"] == usual.printer.nozzle_diameter
    assert found["first_layer_extr_temp"] == usual.material.first_layer_nozzle_temperature
    assert found["first_layer_bed_temp"] == usual.material.first_layer_bed_temperature
    assert found["printer_model"] == usual.printer.name
    sizes = {(one["width"], one["height"]) for one in found["thumbnails"]}
    assert sizes == {(32, 32), (200, 120)}


def test_prusas_metadata_finds_everything(printed: tuple[Path, Program, Profile]) -> None:
    path, program, usual = printed
    found = json.loads(asked("gcode_metadata", ["-c", PRUSA, str(path)]))
    data = found["data"]

    assert data["estimated printing time (normal mode)"].endswith("s")
    assert data["filament used [mm]"] == pytest.approx(program.filament_used, abs=0.01)
    assert data["filament used [g]"] == pytest.approx(grams(program, usual), abs=0.01)
    assert data["filament cost"] == pytest.approx(grams(program, usual) * 0.02, abs=0.01)
    assert data["max_layer_z"] == pytest.approx(program.plan.top[-1])
    assert data["filament_type"] == "PLA"
    assert data["nozzle_diameter"] == usual.printer.nozzle_diameter
    assert data["temperature"] == usual.material.nozzle_temperature
    assert data["bed_temperature"] == usual.material.bed_temperature
    assert data["printer_model"] == usual.printer.name
    assert data["layer_info_present"] is True
    assert data["normal_percent_present"] is True
    assert set(found["thumbnails"]) == {"32x32_PNG", "200x120_PNG"}


def test_octoprints_analysis_sees_the_part(printed: tuple[Path, Program, Profile]) -> None:
    path, program, _ = printed
    text = asked("octoprint", ["-m", "octoprint", "analysis", "gcode", str(path)])
    found = dict(line.split(": ") for line in text.splitlines() if line.count(": ") == 1)
    fed = float(text.partition("extrusion_length:\n- ")[2].split()[0])
    beads = program.role != Role.TRAVEL
    places = np.concatenate([program.start[beads], program.xyz[beads]])

    assert fed == pytest.approx(program.filament_used, rel=0.01)
    assert float(found["  depth"]) > 0
    area = text.partition("printing_area:\n")[2].partition("\ntotal")[0]
    bounds = {key.strip(): float(value) for key, value in (line.split(":") for line in area.splitlines())}
    assert (bounds["maxX"], bounds["maxY"], bounds["maxZ"]) == pytest.approx(places.max(axis=0), abs=0.01)


def test_the_tool_for_thumbnails_finds_them(printed: tuple[Path, Program, Profile]) -> None:
    found = json.loads(asked("gcode_thumbnail_tool", ["-c", THUMBNAILS, str(printed[0])]))

    assert [one[:2] for one in found] == [[32, 32], [200, 120]]
    assert all(one[2] is not None and one[2][2] - one[2][0] > 0.3 * one[1] for one in found)
