"""`arrange` writes plates as 3MF files, which keep their places."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from command_line import MACHINE, QUICK, is_message, typed

import printer_slicer as ps
from tests.parts import box


@pytest.fixture
def parts(tmp_path: Path) -> tuple[Path, Path]:
    ps.export_stl(box((30, 20, 3)), tmp_path / "tile.stl")
    ps.export_stl(box((120, 120, 2), at=(7, 7, 5)), tmp_path / "plate.stl")
    return tmp_path / "tile.stl", tmp_path / "plate.stl"


def test_a_plate_is_a_3mf_that_is_sliced_where_the_parts_are(
    parts: tuple[Path, Path], tmp_path: Path
) -> None:
    tile, plate = parts
    output = tmp_path / "out.3mf"

    outcome = typed("arrange", f"{tile}*3", plate, "-o", output, *MACHINE)
    assert outcome.code == 0, outcome.err
    assert f"{output}: arranged 4 parts on 1 plate, at least 6 mm apart" in outcome.out
    told = json.loads(typed("arrange", f"{tile}*3", plate, "-o", output, "--json", *MACHINE).out)
    read = ps.load_mesh(output)
    assert told["outputs"] == [str(output)]
    assert [item.name for item in read.objects] == [one["name"] for one in told["parts"]]
    for item, one in zip(read.objects, told["parts"], strict=True):
        assert item.low[2] == 0
        assert (item.low[0] + item.high[0]) / 2 == pytest.approx(one["x"], abs=1e-3)
        assert (item.low[1] + item.high[1]) / 2 == pytest.approx(one["y"], abs=1e-3)
    again, direct = tmp_path / "again.gcode", tmp_path / "direct.gcode"
    assert typed("slice", output, "--as-placed", "-o", again, *QUICK).code == 0
    assert typed("slice", f"{tile}*3", plate, "-o", direct, *QUICK).code == 0
    lines = [
        [line for line in path.read_text().splitlines() if line.startswith("G1 X")]
        for path in (again, direct)
    ]
    assert abs(len(lines[0]) - len(lines[1])) <= 4


def test_several_plates_become_several_files(parts: tuple[Path, Path], tmp_path: Path) -> None:
    output = tmp_path / "out.3mf"

    told = json.loads(typed("arrange", f"{parts[1]}*2", "-o", output, "--json", *MACHINE).out)
    assert told["outputs"] == [str(tmp_path / "out-1.3mf"), str(tmp_path / "out-2.3mf")]
    assert typed("arrange", f"{parts[1]}*2", "-o", output, "--plate", "2", *MACHINE).code == 0
    assert output.read_bytes() == (tmp_path / "out-2.3mf").read_bytes()


def test_what_makes_no_sense_is_rejected(parts: tuple[Path, Path], tmp_path: Path) -> None:
    output = tmp_path / "out.3mf"

    assert is_message(typed("arrange", *parts, "-o", tmp_path / "out.stl", *MACHINE), "Name it out.3mf")
    assert is_message(
        typed("arrange", *parts, "-o", output, "--as-placed", *MACHINE), "Leave out --as-placed"
    )
    assert is_message(
        typed("arrange", *parts, "-o", output, "--center", "5,5", *MACHINE), "Leave out --center"
    )
    ps.export_stl(ps.Mesh(box((9, 9, 9)).triangles[1:]), tmp_path / "open.stl")
    refused = typed("arrange", tmp_path / "open.stl", "-o", output, "--strict", *MACHINE)
    assert refused.code == 3
    assert "needs repair" in refused.err


def test_volumes_that_are_not_written_are_named(parts: tuple[Path, Path], tmp_path: Path) -> None:
    flags = ("--modifier", parts[0], "-o", tmp_path / "out.3mf")

    outcome = typed("arrange", parts[1], *flags, *MACHINE)
    assert "plate: modifiers, support volumes and painted facets are not written" in outcome.err
