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


@pytest.mark.parametrize("command", ["dry-run", "print", "sim"])
@pytest.mark.parametrize(
    "flags",
    [
        "--layer-height 0.2",
        "--infill 20%",
        "--walls 3",
        "--brim",
        "--planner uniform",
        "--heights 0.1,0.2",
        "--range 1:2:perimeters=3",
        "--set-for box:perimeters=3",
        "--quality fine",
        "--strict",
        "--set layer_height=0.2",
        "--set fill_density=20%",
    ],
)
def test_what_slices_is_refused_for_gcode(command: str, flags: str, tmp_path: Path) -> None:
    (tmp_path / "x.gcode").write_text("G28\nG1 X5 F3000\n", encoding="utf-8")
    file = {"print": ["x.gcode", "--port", "sim:"], "dry-run": ["x.gcode"], "sim": ["--expect", "x.gcode"]}
    outcome = typed(command, *file[command], *flags.split(), cwd=tmp_path)
    shown = flags if flags.startswith("--set ") else flags.partition(" ")[0]

    assert outcome.code == 2
    assert is_message(outcome, f"x.gcode: {shown} does not apply to G-code, which is already sliced\n  Leave")


@pytest.mark.parametrize("command", ["check x.gcode", "send x.gcode --to octoprint http://nowhere"])
def test_a_setting_of_the_quality_is_refused_where_nothing_is_sliced(command: str, tmp_path: Path) -> None:
    (tmp_path / "x.gcode").write_text("G28\nG1 X5 F3000\n", encoding="utf-8")
    outcome = typed(*command.split(), "--set", "layer_height=0.2", cwd=tmp_path)

    assert outcome.code == 2
    assert is_message(outcome, "--set layer_height=0.2 does not apply to G-code")


@pytest.mark.parametrize(
    "line",
    [
        "check --picture x.svg",
        "check --limit unsupported=5",
        "check --shell 1",
        "check --filament 1.75",
        "check --scale 2",
        "draw --rotate 90",
        "draw --no-drop",
    ],
)
def test_what_needs_a_model_is_refused_without_one(line: str, tmp_path: Path) -> None:
    (tmp_path / "x.gcode").write_text("G28\nG1 X5 F3000\n", encoding="utf-8")
    command, *flags = line.split()
    outcome = typed(command, "x.gcode", *flags, cwd=tmp_path)

    assert (outcome.code, outcome.out) == (2, "")
    assert is_message(outcome, f"{flags[0]} has no effect without --model", "Name the model")
    assert ("printer-slicer draw" in outcome.err) == (flags[0] == "--picture")


@pytest.mark.parametrize(
    ("flags", "told"),
    [
        ("--layer-height 20%", "--layer-height 20%: expected a number\n"),
        ("--walls 1.5", "--walls 1.5: expected a whole number\n"),
        ("--heights a:b", "--heights a:b (quality.thinnest_layer=a): expected a number\n"),
        (
            "--set extrusion_multiplier=95",
            "--set extrusion_multiplier=95: a flow ratio of 95 is out of range\n  Write a number near 1\n",
        ),
        ("--set infill=20%", "--set infill=20%: unknown value '20%'\n  Did you mean infill_density=20%?"),
        ("--set infill_density=20", "expected a number <= 1\n  Did you mean infill_density=20%?"),
        ("--set perimeters=x", "--set perimeters=x: expected a whole number\n"),
    ],
)
def test_a_wrong_value_is_told_once_in_two_lines(flags: str, told: str) -> None:
    outcome = typed("slice", BOX, "-o", "-", *flags.split())

    assert outcome.code == 2
    assert is_message(outcome, told)
    assert len(outcome.err.splitlines()) == 2


def test_errors_of_a_rejected_file_are_listed_and_the_message_has_two_lines(tmp_path: Path) -> None:
    """A dry run counts the same errors as its list, in the words of `check`."""
    lines = ["G28", "M104 S400", "M109 S400", "M500", "G1 X5 F3000", "M104 S0"]
    (tmp_path / "x.gcode").write_text("\n".join(lines), encoding="utf-8")
    first = "line 2: M104 S400: nozzle temperature 400 °C is above the maximum of 260 °C"
    printed = typed("print", "x.gcode", "--port", "sim:", cwd=tmp_path)
    checked = typed("check", "x.gcode", cwd=tmp_path)
    dry = typed("dry-run", "x.gcode", cwd=tmp_path)

    assert printed.out.count("\nerror  ") == checked.out.count("\nerror  ") == 3
    assert len(printed.err.splitlines()) == 2
    assert is_message(
        printed, f"x.gcode: not printed: {first}. ", "(and 2 more errors)", "--allow temperature"
    )
    assert is_message(checked, first, "(and 2 more errors)")
    assert dry.out.count("\nerror  ") == 2
    assert is_message(dry, f"{first} (2 times)", "(and 1 more error)")


def test_the_doctor_tells_each_finding_once() -> None:
    told = typed("doctor", "COM33")
    quiet = typed("doctor", "COM33", "-q")

    assert told.code == quiet.code == 4
    assert (told.out + told.err).count("COM33 does not exist") == 1
    assert is_message(quiet, "printer-slicer: COM33 does not exist\n  Check cable")
