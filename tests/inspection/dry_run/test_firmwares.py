"""A part that is sliced with the default profile, on every simulated firmware there is."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from printer_slicer.mesh_io import export_stl
from printer_slicer.sim.firmwares import SIMULATED_FIRMWARES
from tests.cli.command_line import typed
from tests.parts import box


@pytest.fixture(scope="module")
def part(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("firmwares") / "part.stl"
    export_stl(box((8.0, 8.0, 1.0)), path)
    return path


@pytest.mark.parametrize("firmware", sorted(SIMULATED_FIRMWARES))
def test_a_default_slice_ends_clean_on_every_firmware(firmware: str, part: Path) -> None:
    done = typed("dry-run", part, "--firmware", firmware, "--json")
    facts = json.loads(done.out)

    assert done.code == 0, facts["problems"]
    assert facts["ok"]
    assert facts["executed_equals_sent"]


def test_a_file_for_marlin_is_refused_where_its_speed_limits_mean_another_unit(part: Path) -> None:
    """RepRapFirmware reads M203 in mm/min: z would move at 0.08 mm/s."""
    path = part.with_suffix(".gcode")
    assert typed("slice", part, "-o", path).code == 0

    done = typed("check", path, "--set", "printer.flavour=reprapfirmware")

    assert done.code == 7
    assert "M203" in done.err
    assert "mm/min" in done.err


def test_a_flavour_that_is_set_by_name_counts(part: Path) -> None:
    """What another firmware makes of a file for Klipper may be asked, too."""
    done = typed("dry-run", part, "--firmware", "marlin 2.1", "--set", "printer.flavour=klipper")

    assert "SET_VELOCITY_LIMIT" in done.out or "SET_PRESSURE_ADVANCE" in done.out
