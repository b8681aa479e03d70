"""Slips of who types: what is near is offered, what is expected is told, and what makes no sense is not passed over."""

from __future__ import annotations

import io
import json
from pathlib import Path

import pytest
from command_line import BOX, QUICK, is_message, typed

from printer_slicer.cli.inputs import save_stdin
from printer_slicer.errors import UsageError


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("slice --prnter x part.stl", "slice: --prnter: no such option\n  Did you mean '--printer'?"),
        ("slice part.stl --prnter=x", "slice: --prnter: no such option\n  Did you mean '--printer'?"),
        ("slcie", "'slcie': no such command\n  Did you mean 'slice'? usage: printer-slicer COMMAND"),
        ("profiles lst", "profiles: ACTION: unknown: 'lst'; Did you mean 'list'?"),
        ("slice part.stl --units mmm", "slice: --units: unknown: 'mmm'; Did you mean 'mm'?"),
        ("check --link abc x", "check: --link: 'abc': expected a whole number greater than 0"),
        ("contours x.stl -o x.svg --smooth x", "contours: --smooth: 'x': expected a number, such as 0.02"),
        ("slice part.stl --layer 1.5", "slice: --layer: '1.5': expected a whole number"),
        ("draw x.gcode -o x.svg --z up", "draw: --z: 'up': expected a height above the bed"),
        ("slice part.stl --printer", "slice: --printer: needs a value"),
        ("ports x", "ports: x: unexpected argument"),
        (
            "profiles import x --foldr y",
            "profiles import: --foldr: no such option\n  Did you mean '--folder'?",
        ),
    ],
)
def test_what_cannot_be_read_is_told_with_what_is_near(line: str, told: str) -> None:
    outcome = typed(*line.split())

    assert outcome.code == 2
    assert is_message(outcome, told, "see printer-slicer")


def test_a_height_under_the_bed_is_refused_as_a_height() -> None:
    outcome = typed("slice", BOX, "-o", "-", "--range", "-5:5:perimeters=4")

    assert outcome.code == 2
    assert is_message(outcome, "-5:5:perimeters=4", "got -5")


@pytest.mark.parametrize("heights", ["0:inf", "5:", ":5", "box:5:6", "low:high"])
def test_a_range_that_is_none_is_not_taken_for_an_object(heights: str) -> None:
    outcome = typed("slice", BOX, "-o", "-", "--range", f"{heights}:perimeters=3")

    assert outcome.code == 2
    assert is_message(
        outcome, f"--range {heights}:perimeters=3: expected LOW:HIGH", "--set-for", "5:10:perimeters=4"
    )


def test_heights_over_the_part_are_told(tmp_path: Path) -> None:
    flags = (*QUICK, "--range", "5:20:perimeters=3", "--range", "100:200:perimeters=4")
    outcome = typed("slice", BOX, "-o", tmp_path / "x.gcode", *flags, "--json")

    assert outcome.code == 0
    (warning,) = json.loads(outcome.out)["warnings"]
    assert warning == "the range from 100 to 200 mm (perimeters) is above the part, which is 10 mm high"
    assert outcome.err == f"printer-slicer: warning: {warning}\n"


@pytest.mark.parametrize("command", [("slice", BOX), ("profiles", "list"), ("plan", BOX)])
def test_a_folder_of_profiles_that_is_not_there_is_told(command: tuple[object, ...], tmp_path: Path) -> None:
    outcome = typed(*command, "--profiles", tmp_path / "none")

    assert (outcome.code, outcome.out) == (2, "")
    assert is_message(outcome, f"--profiles {tmp_path}/none: no such folder", "materials/")


@pytest.mark.parametrize("name", ["x.stl", "x.3MF", "x.obj"])
def test_gcode_is_not_written_under_the_name_of_a_model(name: str, tmp_path: Path) -> None:
    outcome = typed("slice", BOX, "-o", name, *QUICK, cwd=tmp_path)

    assert outcome.code == 2
    assert is_message(outcome, f"-o {name}: ", "Name it x.gcode")
    assert list(tmp_path.iterdir()) == []


def test_a_folder_or_a_link_that_leads_nowhere_is_no_profile(tmp_path: Path) -> None:
    (tmp_path / "materials" / "dir.toml").mkdir(parents=True)
    (tmp_path / "materials" / "link.toml").symlink_to("nowhere")
    for name, problem in (
        ("dir", "is a folder, not a profile"),
        ("link", "is a link to a missing file"),
    ):
        path = tmp_path / "materials" / f"{name}.toml"
        by_name = typed("slice", BOX, "--profiles", tmp_path, "--material", name)
        by_path = typed("profiles", "check", path)

        assert is_message(by_name, f"{path}: {problem}")
        assert f"{path}: {problem}" in by_path.err
    assert "dir" not in typed("profiles", "list", "materials", "--profiles", tmp_path).out.split()


@pytest.mark.parametrize("group", ["speeds", "quality.speeds", "planner"])
def test_a_group_of_settings_is_told_from_a_setting(group: str) -> None:
    outcome = typed("slice", BOX, "-o", "-", *QUICK, "--set", f"{group}=3")

    assert outcome.code == 2
    assert is_message(
        outcome, f"--set {group}: this is a group of settings", f"Choose one of: {group.rpartition('.')[2]}."
    )


def test_a_stdin_without_end_is_told(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="-: stdin has more than 10 bytes") as caught:
        save_stdin(io.BytesIO(b"G28\n" * 5), tmp_path, max_bytes=10)

    assert caught.value.remedy == "Give the name of the file instead"
