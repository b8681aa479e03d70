"""G-code of the printer between layers and at pauses."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from printer_slicer.arrays import Float
from printer_slicer.commands import split_gcode
from printer_slicer.errors import ProfileError
from printer_slicer.firmware import FLAVOURS
from printer_slicer.gcode import Moves, read_moves, write_gcode
from printer_slicer.gcode.facts import collect_end_facts, collect_layer_facts, collect_print_facts
from printer_slicer.gcode_text import gcode_of
from printer_slicer.inspection.dry_run.runner import dry_run
from printer_slicer.macros import Value, get_placeholder_names, read_template
from printer_slicer.macros.functions import FUNCTIONS
from printer_slicer.macros.names import FACTS
from printer_slicer.model import Program
from printer_slicer.motion.rules import limits_of
from printer_slicer.pipeline import slice_part
from printer_slicer.profile import list_settings
from printer_slicer.slice_jobs import job_of
from tests.parts import box, plain, profile
from tests.tiny_gcode import commands

DOCUMENT = Path(__file__).parents[2] / "docs" / "gcode.md"
PARK = "G91\nM82\nG1 Z5 F600\nG90\nG1 X0 Y0 F9000\nG92 E0\nG1 E0 F300\nG4 P100"


@cache
def sliced() -> Program:
    """Ten layers of 0.2 mm."""
    return slice_part(box((20, 10, 2)), plain())


def lines_with(**changes: object) -> list[str]:
    return gcode_of(sliced(), plain(**changes)).decode().splitlines()


def test_the_macro_before_a_layer_stands_behind_its_comments_and_before_its_first_move() -> None:
    lines = lines_with(
        before_layer_gcode="M117 {layer_num + 1} of {layer_count} {fixed(layer_z, 2)} {layer_height}"
    )
    places = [i for i, line in enumerate(lines) if line.startswith("M117")]

    assert [lines[i] for i in places] == [f"M117 {n} of 10 {0.2 * n:.2f} 0.2" for n in range(1, 11)]
    assert all(lines[i - 5] == ";LAYER_CHANGE" for i in places)


def test_the_macro_of_a_layer_stands_where_the_nozzle_has_come_to_its_height() -> None:
    lines = lines_with(layer_gcode=";here {layer_z}", relative_extrusion=True)
    seen, z, beads = [], 0.0, 0
    for line in lines:
        if line.startswith("G") and " Z" in line:
            z = float(line.split(" Z")[1].split()[0])
        if line == ";LAYER_CHANGE":
            beads = 0
        beads += line.startswith("G1 X")
        if line.startswith(";here "):
            seen.append((float(line[6:]), z, beads))

    assert [at for at, _, _ in seen] == pytest.approx(0.2 * np.arange(1, 11))
    assert all(z >= at - 1e-9 and beads == 0 for at, z, beads in seen)


def test_filament_and_time_count_up_from_layer_to_layer() -> None:
    lines = lines_with(before_layer_gcode=";so far {filament_so_far} {seconds_so_far} {print_seconds}")
    told = np.array([line.split()[2:] for line in lines if line.startswith(";so far")], float)

    assert told[0, :2].tolist() == [0, 0]
    assert (np.diff(told[:, :2], axis=0) > 0).all()
    assert (told[:, 1] < told[:, 2]).all()


def test_layer_facts_are_unknown_where_there_is_no_layer() -> None:
    with pytest.raises(ProfileError, match=r"start_gcode: line 1, column 2: unknown placeholder \{layer_z\}"):
        lines_with(start_gcode="{layer_z}")


def beads_of(moves: Moves) -> Float:
    """From where to where every bead lies, how much filament is in it, and how fast."""
    lays = (moves.delta[:, 3] > 0) & (moves.delta[:, :2] != 0).any(axis=1)
    return np.hstack([moves.end - moves.delta[:, :3], moves.end, moves.delta[:, 3:], moves.speed[:, None]])[
        lays
    ]


@pytest.mark.parametrize("relative", [True, False])
@pytest.mark.parametrize("macro", ["layer_gcode", "before_layer_gcode"])
def test_a_macro_that_moves_does_not_change_the_part(macro: str, relative: bool) -> None:
    """It goes away and changes modes and speed: beads are where they were, as fast as they were."""
    usual, other = plain(relative_extrusion=relative), plain(relative_extrusion=relative, **{macro: PARK})
    before, after = (read_moves(commands(write_gcode(sliced(), wanted))) for wanted in (usual, other))

    assert beads_of(after) == pytest.approx(beads_of(before), abs=1e-9)
    assert len(after.speed) > len(before.speed)


@pytest.mark.parametrize("macro", ["M117 next", "TIMELAPSE_TAKE_FRAME", "; G1 X0", "M240"])
def test_a_macro_that_does_not_move_is_all_there_is(macro: str) -> None:
    plainly, told = lines_with(), lines_with(layer_gcode=macro)
    settings = plainly.index("; settings")

    assert [line for line in told[: told.index("; settings")] if line != macro] == plainly[:settings]


def test_a_file_whose_macro_announces_layers_too_has_as_many_layers() -> None:
    marks = split_gcode(gcode_of(sliced(), plain(layer_gcode=";LAYER:{layer_num}"))).marks

    assert list(marks.values()) == list(range(1, 11))


# The document


def examples() -> list[tuple[str, str]]:
    text = DOCUMENT.read_text("utf-8").partition("<!-- examples:")[2].partition("<!-- end -->")[0]
    return re.findall(r"^\| `(.+)` \| `(.+)` \|$", text, re.MULTILINE)


@pytest.mark.parametrize(("macro", "expected"), examples())
def test_the_examples_of_the_document_are_true(macro: str, expected: str) -> None:
    known: dict[str, Value] = {
        "nozzle_temperature": 210.0,
        "layer_z": 0.6,
        "layer_num": 2,
        "on": True,
        "material_name": "PLA",
        "tops": (0.2, 0.4, 0.6),
    }

    assert read_template(macro, "example").render(known) == [expected]


def test_the_document_names_every_fact_and_every_function() -> None:
    text = DOCUMENT.read_text("utf-8")
    settings = {name for key, _ in list_settings(plain()) for name in (key, key.partition(".")[2])}
    facts = FACTS | set(collect_layer_facts(sliced(), 0, 0, 0))
    short = {"first_layer_min_y", "first_layer_max_y"}  # told as `first_layer_min_x` and `_y`

    assert len(examples()) > 10
    assert [name for name in facts - settings - short if f"`{name}`" not in text] == []
    assert [name for name in FUNCTIONS if f"{name}(" not in text] == []


def test_every_name_that_imports_count_on_has_a_value() -> None:
    everywhere, layers = collect_print_facts(sliced(), plain()), collect_layer_facts(sliced(), 0, 0, 0)
    end = collect_end_facts(sliced(), plain())
    settings = {name for key, _ in list_settings(plain()) for name in (key, key.partition(".")[2])}

    assert get_placeholder_names("start_gcode") <= everywhere.keys()
    assert get_placeholder_names("layer_gcode") == get_placeholder_names("start_gcode") | layers.keys()
    assert get_placeholder_names("end_gcode") == get_placeholder_names("start_gcode") | end.keys()
    assert everywhere.keys() - settings - get_placeholder_names("start_gcode") <= {"speeds.raft"}


def test_global_variables_count_from_macro_to_macro_in_the_order_of_the_print() -> None:
    lines = lines_with(
        start_gcode="{global n = 0}M117 begin {n}",
        before_layer_gcode="{n = n + 1}M117 before {n}",
        layer_gcode="{n = n + 1}M117 at {n}",
    )
    told = [line.removeprefix("M117 ") for line in lines[: lines.index("; settings")] if "M117" in line]

    assert told == ["begin 0", *(f"{word} {n}" for n, word in enumerate(["before", "at"] * 10, 1))]


# Tools


def test_the_tool_that_prints_is_selected_before_anything_heats() -> None:
    assert not [line for line in lines_with() if line.startswith("T")]

    other = lines_with(tool="2", start_gcode="M109 S{nozzle_temperature}")
    assert other.index("T2") < other.index("M109 S210")

    own = lines_with(
        tool="1", tool_gcode="T{tool} P0 ; no macro of its own\n{if tool > 0}M116 P{tool}{endif}"
    )
    assert own.index("T1 P0 ; no macro of its own") + 1 == own.index("M116 P1")
    assert "T1" not in own


# Pauses


def test_a_print_pauses_before_it_goes_on_above_a_height() -> None:
    lines = lines_with(pause_at="0.5, 1.2, 1.21")
    layers, layer = [], 0
    for line in lines:
        layer += line == ";LAYER_CHANGE"
        layers += [layer] if line == "M0" else []

    assert layers == [3, 7]  # from 0.4 to 0.6 mm, and from 1.2 to 1.4 mm


def test_a_pause_is_what_the_flavour_or_the_printer_says() -> None:
    assert "PAUSE" in gcode_of(sliced(), profile("corexy_klipper", pause_at="1")).decode().splitlines()
    assert "M600 Z1.2" in lines_with(pause_at="1", pause_gcode="{if layer_num > 2}\nM600 Z{layer_z}\n{endif}")


def test_a_pause_above_the_part_is_refused() -> None:
    with pytest.raises(ProfileError, match=r"quality\.pause_at: 2 mm is above the top of the part at 2 mm"):
        lines_with(pause_at="1, 2")


def test_a_print_with_macros_and_a_pause_comes_out_as_intended() -> None:
    wanted = profile(layer_gcode=PARK, before_layer_gcode="M117 {layer_num}", pause_at="1")
    verdict = dry_run(job_of(box((20, 10, 2)), wanted), wanted)

    assert verdict.problems == ()


def _time_told(text: bytes) -> float:
    return next(float(line[6:]) for line in text.decode().split("\n") if line.startswith(";TIME:"))


@pytest.mark.parametrize("macro", [PARK, "G4 P1500", "G1 X0 Y0 F3000\nG4 S1\nG1 X20 Y20 E0.5 F300"])
def test_the_time_in_the_file_counts_what_macros_between_the_moves_take(macro: str) -> None:
    wanted = plain(layer_gcode=macro)
    text = gcode_of(sliced(), wanted)

    told = _time_told(text)
    moves = read_moves(
        split_gcode(text).commands, wanted.printer.corners[0], FLAVOURS[wanted.printer.flavour]
    )
    seconds = moves.seconds(limits_of(wanted.printer))
    without = gcode_of(sliced(), plain())
    plainly = _time_told(without)
    assert told == pytest.approx(seconds, abs=0.51)
    assert told > plainly + 10
