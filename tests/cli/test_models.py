"""Models on the command line: units, scale, turns, places, several at once, and what is told about them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from command_line import BOX, MACHINE, PARTS, QUICK, Outcome, is_message, typed

from printer_slicer.cli.arguments import attach_values
from printer_slicer.mesh_io import export_stl, load_mesh
from printer_slicer.model import Mesh
from tests.mesh_io.tiny_files import CORNERS, binary_stl, item, mesh_xml, model_xml, three_mf, write
from tests.parts import box, box_with_hole, joined

CONE = PARTS / "cone.stl"


def part(folder: Path, name: str, low: tuple[float, ...], high: tuple[float, ...]) -> Path:
    """A box between two corners, as binary STL."""
    box = load_mesh(BOX)
    bounds = np.array([low, high])
    export_stl(
        Mesh((box.triangles - box.bounds[0]) / box.size * (bounds[1] - bounds[0]) + bounds[0]), folder / name
    )
    return folder / name


def bounds(folder: Path, *arguments: object) -> Any:
    """(2, 3) where the contours of the command lie, as lists."""
    outcome = typed("contours", *arguments, "-o", folder / "x.svg", "--json", *QUICK)
    assert outcome.code == 0, outcome.err
    return json.loads(outcome.out)["bounds"]


def fact(outcome: Outcome) -> dict[str, Any]:
    assert outcome.code == 0, outcome.err
    return dict(json.loads(outcome.out))


# Where it goes


@pytest.mark.parametrize(
    ("flags", "expected"),
    [
        ((), [[100, 95, 0], [120, 125, 6]]),
        (("--center", "30,40"), [[20, 25, 0], [40, 55, 6]]),
        (("--as-placed",), [[5, 6, 0], [25, 36, 6]]),
        (("--no-drop",), [[100, 95, 0], [120, 125, 9]]),
        (("--scale", "2"), [[90, 80, 0], [130, 140, 12]]),
        (("--scale", "50%"), [[105, 102.5, 0], [115, 117.5, 3]]),
        (("--scale", "1,100%,0.5"), [[100, 95, 0], [120, 125, 3]]),
        (("--units", "cm", "--scale", "0.1"), [[100, 95, 0], [120, 125, 6]]),
        (("--rotate", "90"), [[95, 100, 0], [125, 120, 6]]),
        (("--rotate", "-90,0,0"), [[100, 107, 0], [120, 113, 30]]),
        (("--rotate", "0,90,0", "--as-placed", "--scale", "1"), [[3, 6, 0], [9, 36, 20]]),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, tuple) else "",
)
def test_the_part_is_where_it_was_asked_for(flags: tuple[str, ...], expected: Any, tmp_path: Path) -> None:
    model = part(tmp_path, "a.stl", (5, 6, 3), (25, 36, 9))

    np.testing.assert_allclose(bounds(tmp_path, model, *flags), expected, atol=0.002)


def test_slice_plan_and_dry_run_take_the_same_flags(tmp_path: Path) -> None:
    model = part(tmp_path, "a.stl", (5, 6, 3), (25, 36, 9))
    flags = ("--scale", "0.5", "--rotate", "90,0,0", "--center", "40,30", "--json", *QUICK)
    sliced = fact(typed("slice", model, "-o", tmp_path / "x.gcode", *flags))
    planned = fact(typed("plan", model, *flags))
    printed = fact(typed("dry-run", model, *flags))

    assert sliced["layers"] == len(planned["layers"]["top"])
    assert planned["part"]["size"] == [10, 3, 15]
    assert max(printed["heights"]) == pytest.approx(15, abs=0.2)
    for told in (sliced, planned, printed):
        assert told["warnings"] == []
        assert [one["file"] for one in told["models"]] == [str(model)]


@pytest.mark.parametrize(
    ("flags", "what"),
    [
        (("--as-placed",), "from x -100"),
        (("--center", "0,0"), "from x -10"),
        (("--no-drop", "--rotate", "180,0,0"), "below the bed"),
    ],
)
def test_what_leaves_the_bed_is_refused(flags: tuple[str, ...], what: str, tmp_path: Path) -> None:
    model = part(tmp_path, "a.stl", (-100, 0, 3), (-80, 20, 9))
    outcome = typed("slice", model, *flags, *QUICK)

    assert outcome.code == 3
    assert is_message(outcome, "a: the part extends", what)
    assert len(outcome.err.splitlines()) == 2


# Several models


def test_several_models_are_one_plate_as_their_files_place_them(tmp_path: Path) -> None:
    left = part(tmp_path, "left.stl", (0, 0, 0), (10, 10, 6))
    right = part(tmp_path, "right.stl", (50, 0, 0), (60, 20, 3))

    np.testing.assert_allclose(bounds(tmp_path, left, right), [[80, 100, 0], [140, 120, 6]], atol=0.002)
    told = fact(typed("slice", left, right, "-o", tmp_path / "plate.gcode", "--json", *QUICK))
    assert told["volume_mm3"] == pytest.approx(600 + 600)
    assert [one["facets"] for one in told["models"]] == [12, 12]
    assert told["warnings"] == []


def test_the_plate_is_called_after_the_first_model(tmp_path: Path) -> None:
    left = part(tmp_path, "left.stl", (0, 0, 0), (10, 10, 6))
    right = part(tmp_path, "right.stl", (50, 0, 0), (60, 20, 3))
    outcome = typed("slice", left, right, *QUICK)

    assert outcome.code == 0, outcome.err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["left.gcode", "left.stl", "right.stl"]


def test_no_model_is_overwritten(tmp_path: Path) -> None:
    left = part(tmp_path, "left.stl", (0, 0, 0), (10, 10, 6))
    right = part(tmp_path, "right.stl", (50, 0, 0), (60, 20, 3))
    before = right.read_bytes()

    assert is_message(typed("slice", left, right, "-o", right, *QUICK), "right.stl: is an input file")
    assert right.read_bytes() == before


def test_a_model_over_the_bed_is_told(tmp_path: Path) -> None:
    low = part(tmp_path, "low.stl", (0, 0, 0), (10, 10, 6))
    high = part(tmp_path, "high.stl", (50, 0, 2.5), (60, 20, 6))
    outcome = typed("slice", low, high, "--json", *QUICK)

    above = "high.stl: the part starts 2.5 mm above the bed, because of its position in the file"
    assert outcome.err.startswith(f"printer-slicer: warning: {above}\n")
    assert fact(outcome)["warnings"][0] == above
    assert "unsupported extrusion" in fact(outcome)["warnings"][1]
    assert typed("slice", low, high, "-q", *QUICK).err == ""


def test_parts_that_overlap_are_arranged_unless_they_shall_fuse(tmp_path: Path) -> None:
    one = part(tmp_path, "one.stl", (0, 0, 0), (20, 20, 6))
    inside = part(tmp_path, "two.stl", (2, 2, 0), (10, 10, 6))
    beside = part(tmp_path, "three.stl", (18, 5, 0), (40, 20, 6))
    touching = part(tmp_path, "four.stl", (20, 0, 0), (30, 20, 6))

    for command in ("slice", "plan", "dry-run"):
        outcome = typed(command, one, inside, beside, *QUICK)
        assert outcome.code == 0
        assert "two.stl overlaps one.stl by 8 x 8 mm; others overlap as well, at" in outcome.err
        assert "arranged 3 parts on 1 plate" in outcome.err
        kept = typed(command, one, inside, beside, "--as-placed", *QUICK)
        assert kept.code == 3
        assert "two.stl overlaps one.stl by 8 x 8 mm; three.stl overlaps one.stl by 2 x 15 mm" in kept.err
        assert "--fuse" in kept.err
    assert typed("slice", one, inside, "--fuse", *QUICK).err == ""
    assert typed("slice", one, touching, *QUICK).code == 0


def test_parts_of_one_name_that_overlap_are_told_apart_by_their_folders(tmp_path: Path) -> None:
    for folder in ("left", "right"):
        (tmp_path / folder).mkdir()
        part(tmp_path / folder, "part.stl", (0, 0, 0), (20, 20, 6))
    left, right = (tmp_path / folder / "part.stl" for folder in ("left", "right"))

    assert f"{right} overlaps {left} by 20 x 20 mm" in typed("slice", left, right, *QUICK).err


def test_a_part_in_a_hole_of_another_does_not_overlap(tmp_path: Path) -> None:
    write(tmp_path, binary_stl(box_with_hole((40, 40, 6), (20, 20)).triangles), "frame.stl")
    low, high = 11, 29
    inside = part(tmp_path, "inside.stl", (low, low, 0), (high, high, 6))
    outside = part(tmp_path, "outside.stl", (9, low, 0), (high, high, 6))
    frame = tmp_path / "frame.stl"

    assert typed("slice", frame, inside, *QUICK).code == 0
    assert "outside.stl overlaps frame.stl by 1 x 18 mm" in typed("slice", frame, outside, *QUICK).err


def test_of_several_places_where_parts_overlap_the_largest_is_told(tmp_path: Path) -> None:
    """Beams over a frame with walls of 2 mm: across two of them, over a corner, along one of them."""
    write(tmp_path, binary_stl(box_with_hole((24, 24, 6), (20, 20)).triangles), "frame.stl")
    across = part(tmp_path, "across.stl", (-3, 5, 0), (27, 7, 6))
    longer = part(tmp_path, "longer.stl", (-3, 21.5, 0), (5, 40, 6))
    short = part(tmp_path, "short.stl", (21, -3, 0), (23.5, 23, 6))
    frame = tmp_path / "frame.stl"

    for beam, told in (
        (across, "across.stl overlaps frame.stl by 2 x 2 mm, the largest of 2 places,"),
        (longer, "longer.stl overlaps frame.stl by 5 x 2.5 mm,"),
        (short, "short.stl overlaps frame.stl by 2.5 x 23 mm,"),
    ):
        assert told in typed("slice", frame, beam, *QUICK).err
        name = told.partition(" ")[0]
        turned = told.replace(name, "frame.stl", 1).replace("overlaps frame.stl", f"overlaps {name}")
        assert turned in typed("slice", beam, frame, *QUICK).err


def test_objects_of_one_file_may_overlap(tmp_path: Path) -> None:
    both = joined([box((20, 20, 6)), box((8, 8, 6), at=(16, 2, 0))])
    path = write(tmp_path, binary_stl(both.triangles), "both.stl")

    assert typed("slice", path, *QUICK).code == 0


def test_objects_of_one_3mf_may_touch_but_not_occupy_the_same_space(tmp_path: Path) -> None:
    """Two boxes of 2 x 3 x 4 mm, the second one moved."""
    size = np.ptp(CORNERS, axis=0)
    both = {1: mesh_xml(), 2: mesh_xml()}

    def sliced(*by: float) -> Outcome:
        build = item(1) + item(2, (1, 0, 0, 0, 1, 0, 0, 0, 1, *by))
        path = write(tmp_path, three_mf(model_xml(both, build)), "plate.3mf")
        return typed("slice", path, "-o", tmp_path / "plate.gcode", *QUICK)

    assert sliced(float(size[0]) + 5, 0, 0).code == 0
    assert sliced(float(size[0]), 0, 0).code == 0
    assert sliced(0, 0, float(size[2])).code == 0
    overlapping = sliced(float(size[0]) - 2, 0, 0)
    assert overlapping.code == 3
    assert f"overlaps plate by 2 x {size[1]:.4g} mm" in overlapping.err
    assert "--fuse" in overlapping.err


def test_a_factor_that_leads_nowhere_is_refused_without_noise(tmp_path: Path) -> None:
    for factor in ("1e300", "1e150", "1,1,1e9"):
        outcome = typed("slice", BOX, "--scale", factor, *QUICK, cwd=tmp_path)  # warnings are errors

        assert outcome.code == 2
        assert is_message(outcome, "moves box to", "Choose a smaller factor")
        assert "Warning" not in outcome.err
    assert outcome.err == (
        "printer-slicer: scale 1,1,1e+09: this moves box to 1e+10 mm from the origin of its file\n"
        "  Choose a smaller factor; coordinates up to 10 km are allowed\n"
    )


def test_a_plate_is_printed_by_the_simulated_printer(tmp_path: Path) -> None:
    low = part(tmp_path, "low.stl", (0, 0, 0), (10, 10, 2.1))
    high = part(tmp_path, "high.stl", (50, 0, 0), (60, 20, 1.2))
    outcome = typed("print", low, high, "--port", "sim:", "--json", *QUICK)
    events = [json.loads(line) for line in outcome.out.splitlines()]

    assert outcome.code == 0, outcome.err
    assert events[0]["event"] == "models"
    assert [one["file"] for one in events[0]["models"]] == [str(low), str(high)]
    assert events[-1]["job"] == "low.stl and 1 more"
    assert events[-1]["ok"]


# Doubtful sizes


def test_a_tiny_part_is_told_with_a_guess(tmp_path: Path) -> None:
    model = part(tmp_path, "a.stl", (0, 0, 0), (2, 2, 2))
    outcome = typed("slice", model, "--json", *QUICK)
    warning = "a.stl: the part is only 2 x 2 x 2 mm; if the file is in inches,"

    assert outcome.err.startswith(
        f"printer-slicer: warning: {warning} --units inch makes the part 50.8 x 50.8 x 50.8 mm"
    )
    assert fact(outcome)["warnings"][0].startswith(warning)
    assert typed("slice", model, "--units", "inch", *QUICK).err == ""
    assert typed("slice", model, "--units", "mm", *QUICK).err == ""
    assert typed("slice", model, "--scale", "25.4", *QUICK).err == ""


@pytest.mark.parametrize("command", ["slice", "plan", "dry-run"])
def test_a_part_in_metres_is_told_before_it_is_refused(command: str, tmp_path: Path) -> None:
    model = part(tmp_path, "a.stl", (0, 0, 0), (0.04, 0.03, 0.02))
    outcome = typed(command, model, *QUICK)

    assert outcome.code == 3
    assert is_message(
        outcome, "in metres, --units m makes the part 40 x 30 x 20 mm", "thinner than the thinnest layer"
    )


def test_a_part_of_three_metres_is_refused_with_a_guess(tmp_path: Path) -> None:
    model = part(tmp_path, "a.stl", (0, 0, 0), (3000, 2000, 2000))

    assert is_message(
        typed("slice", model, *QUICK),
        "3000 x 2000",
        "micrometres, --units micron makes the part 3 x 2 x 2 mm",
    )
    outcome = typed("slice", model, "--units", "m", *QUICK)
    assert is_message(outcome, "--scale 0.0073% would just fit", "--units micron")


@pytest.mark.parametrize(
    ("flags", "fits"),
    [
        (("--scale", "2"), "0.91"),
        (("--scale", "200%"), "91%"),
        (("--scale", "1,1,4"), "0.78,0.78,3.1"),
        (("--scale", "2, 200%,50%"), "0.91,91%,22%"),
        (("--scale", "1200%"), "91%"),
        (("--units", "cm"), "9.1%"),
        (("--units", "cm", "--scale", "20%"), "9.1%"),
    ],
    ids="".join,
)
def test_what_would_just_fit_can_be_given_in_place_of_what_was(
    flags: tuple[str, ...], fits: str, tmp_path: Path
) -> None:
    model = part(tmp_path, "a.stl", (0, 0, 0), (240, 120, 80))
    refused = typed("slice", model, *flags, *QUICK)

    assert is_message(refused, "does not fit", f": --scale {fits} would just fit")
    assert "is it in" not in refused.err
    given = list(flags)
    if "--scale" in flags:
        given[given.index("--scale") + 1] = fits
    else:
        given += ["--scale", fits]
    assert typed("contours", model, "-o", tmp_path / "x.svg", *given, *QUICK).code == 0


def test_a_part_that_does_not_fit_is_asked_about_the_unit_it_was_taken_for(tmp_path: Path) -> None:
    model = part(tmp_path, "a.stl", (0, 0, 0), (3000, 10, 10))

    assert typed("slice", model, *QUICK).err.endswith("; is it in millimetres?\n")
    assert typed("slice", model, "--units", "mm", *QUICK).err.endswith("would just fit\n")


def test_only_flags_that_were_given_are_to_be_left_out(tmp_path: Path) -> None:
    model = part(tmp_path, "a.stl", (-100, 0, 3), (-80, 20, 9))

    as_placed = typed("slice", model, "--as-placed", *QUICK).err
    assert "Omit --as-placed to use the middle of the bed, or set the position with --center" in as_placed
    centered = typed("slice", model, "--center", "0,0", *QUICK).err
    assert "Omit --center to use the middle of the bed, or choose another position" in centered


def test_a_long_thin_part_is_not_taken_for_micrometres(tmp_path: Path) -> None:
    outcome = typed("slice", part(tmp_path, "a.stl", (0, 0, 0), (3000, 10, 10)), *QUICK)

    assert is_message(outcome, "3000 x 10 x 10", "--scale 7.3% would just fit")
    assert "micron" not in outcome.err


# What cannot be


@pytest.mark.parametrize(
    "flags",
    [
        ("--scale", "0"),
        ("--scale=-1",),
        ("--scale", "big"),
        ("--scale", "1,2"),
        ("--scale", "nan"),
        ("--scale", "inf"),
        ("--rotate", "1,2"),
        ("--rotate", "x"),
        ("--center", "5"),
        ("--center", "5,inf"),
        ("--center", "5,5", "--as-placed"),
        ("--units", "furlong"),
    ],
    ids=" ".join,
)
def test_flags_that_make_no_sense_are_refused(flags: tuple[str, ...]) -> None:
    outcome = typed("slice", BOX, *flags)

    assert (outcome.code, outcome.out) == (2, "")
    assert flags[0].partition("=")[0] in outcome.err


@pytest.mark.parametrize(
    ("flags", "flag"),
    [(("--scale", "2"), "--scale"), (("--no-drop",), "--no-drop"), (("--as-placed",), "--as-placed")],
)
@pytest.mark.parametrize("command", [("dry-run",), ("print", "--port", "sim:")], ids=lambda words: words[0])
def test_gcode_is_not_changed(
    command: tuple[str, ...], flags: tuple[str, ...], flag: str, tmp_path: Path
) -> None:
    (tmp_path / "x.gcode").write_text("G28\nG1 X5 F3000\n", encoding="utf-8")
    outcome = typed(command[0], tmp_path / "x.gcode", *command[1:], *flags, *MACHINE)

    assert outcome.code == 2
    assert is_message(outcome, f"{flag} does not apply to G-code")


def test_gcode_is_printed_alone(tmp_path: Path) -> None:
    (tmp_path / "x.gcode").write_text("G28\n", encoding="utf-8")
    outcome = typed("dry-run", BOX, tmp_path / "x.gcode", *QUICK)

    assert outcome.code == 2
    assert is_message(outcome, "only one G-code file can be printed at a time")


def test_values_with_a_minus_sign_stay_with_their_flag() -> None:
    assert attach_values(["slice", "--rotate", "-90,0,0", "a.stl"]) == ["slice", "--rotate=-90,0,0", "a.stl"]
    assert attach_values(["--center", "-.5,-3", "-q"]) == ["--center=-.5,-3", "-q"]
    assert attach_values(["--rotate", "-q"]) == ["--rotate", "-q"]
    assert attach_values(["--rotate=-9", "-9"]) == ["--rotate=-9", "-9"]
