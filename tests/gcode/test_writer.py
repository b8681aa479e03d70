"""The text of a file says what the program says: read back by a reader that shares nothing with the package."""

from __future__ import annotations

import re
import tomllib
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.firmware import FLAVOURS
from printer_slicer.gcode import write_gcode
from printer_slicer.gcode.inserted_lines import TYPE_NAMES
from printer_slicer.gcode_text import gcode_of
from printer_slicer.model import Fan, Heat, LayerPlan, Program
from printer_slicer.pipeline import slice_part
from printer_slicer.profile import Profile, profile_with
from printer_slicer.profile.tables import list_setting_definitions
from printer_slicer.roles import Role
from printer_slicer.texts import format_duration
from printer_slicer.version import VERSION
from tests.effort import crossed
from tests.parts import box, joined, profile, sphere, two_boxes
from tests.tiny_gcode import Step, body, commands, steps

PRINTERS = ["marlin_220", "marlin_220_06", "corexy_klipper"]
each_printer = pytest.mark.parametrize("printer", PRINTERS)
either = pytest.mark.parametrize("relative", [True, False], ids=["relative", "absolute"])


@cache
def wanted(printer: str, relative: bool) -> Profile:
    changes = {
        "start_gcode": "",
        "end_gcode": "",
        "brim_width": 2,
        "solid_infill_below_area": 0,
        "ironing": True,
    }
    return profile(printer, relative_extrusion=relative, **changes)


@cache
def sliced(printer: str) -> Program:
    """Two islands and a bridge: every role and every kind of move."""
    legs = two_boxes((5, 8, 2), gap=6)
    part = joined([legs, box((16, 8, 1), (0, 0, 2)), sphere(1.5).moved((30, 4, 0))])
    return slice_part(part, wanted(printer, relative=True))


@cache
def read(printer: str, relative: bool) -> list[Step]:
    text = write_gcode(sliced(printer), wanted(printer, relative))
    start = sliced(printer).origin
    return list(steps(body(text), (start[0], start[1], start[2]), relative=relative))


def visible(program: Program) -> Bool:
    """Moves that still change something after rounding."""
    xyz = np.rint(program.xyz * [1e3, 1e3, 1e4])
    fed = np.rint(np.cumsum(program.filament) * 1e5)
    moves = (np.diff(xyz, axis=0, prepend=xyz[:1] - 1) != 0).any(axis=1)
    return np.asarray(moves | ((program.role == Role.TRAVEL) & (np.diff(fed, prepend=0) != 0)))


@pytest.mark.parametrize(("printer", "relative"), crossed(PRINTERS, [True, False]))
def test_positions_filament_and_speeds_are_those_of_the_program(printer: str, relative: bool) -> None:
    program, moves = sliced(printer), read(printer, relative)
    seen = visible(program)

    assert len(moves) == seen.sum() > 1000
    assert np.array([move.xyz for move in moves]) == pytest.approx(program.xyz[seen], abs=5.1e-4)
    assert np.array([move.xyz[2] for move in moves]) == pytest.approx(program.xyz[seen, 2], abs=1e-9)
    assert np.array([move.fed for move in moves]) == pytest.approx(
        np.cumsum(program.filament)[seen], abs=1.1e-5
    )
    assert np.array([move.feed for move in moves]) == pytest.approx(program.speed[seen], abs=0.5 / 60 + 1e-9)
    assert moves[-1].fed == pytest.approx(program.filament.sum(), abs=1e-4)


@each_printer
def test_relative_and_absolute_extrusion_agree(printer: str) -> None:
    one, other = read(printer, True), read(printer, False)

    assert [move.xyz for move in one] == [move.xyz for move in other]
    assert [move.command for move in one] == [move.command for move in other]
    assert [move.fed for move in one] == pytest.approx([move.fed for move in other], abs=1e-6)


@each_printer
@either
def test_travels_extrude_nothing_and_say_so(printer: str, relative: bool) -> None:
    for move, before in zip(read(printer, relative)[1:], read(printer, relative)[:-1], strict=True):
        moves_head = bool({"X", "Y", "Z"} & move.words.keys())
        if move.command == "G0":
            assert "E" not in move.words
        else:
            assert "E" in move.words
            assert not moves_head or move.fed > before.fed


# --- the whole file ---


@pytest.mark.parametrize(("printer", "relative"), crossed(PRINTERS, [True, False]))
def test_two_runs_give_the_same_bytes(printer: str, relative: bool) -> None:
    first = gcode_of(sliced(printer), wanted(printer, relative))
    again = slice_part(
        joined([two_boxes((5, 8, 2), gap=6), box((16, 8, 1), (0, 0, 2)), sphere(1.5).moved((30, 4, 0))]),
        wanted(printer, relative),
    )

    assert gcode_of(again, wanted(printer, relative)) == first


@each_printer
@either
def test_every_line_can_be_sent_and_every_number_is_one(printer: str, relative: bool) -> None:
    text = gcode_of(sliced(printer), profile(printer, relative_extrusion=relative))

    text.decode("ascii")
    assert text.endswith(b"\n")
    assert b"\r" not in text
    assert max(len(line) for line in commands(text)) <= 95
    for line in body(gcode_of(sliced(printer), wanted(printer, relative))).splitlines():
        if line.startswith((b"G0", b"G1")):
            assert re.fullmatch(rb"G[01]( [XYZ]-?\d+(\.\d+)?)*( E-?\d+(\.\d+)?)?( F[1-9]\d*)?", line), line
            assert not re.search(rb"\.\d*0\b|-0\b(?!\.)", line), line


def tail_of(wanted: Profile, program: Program, seconds: float) -> dict[str, str]:
    """What stands behind the moves as key = value."""
    text = write_gcode(program, wanted, np.full(program.n_moves, seconds / program.n_moves)).decode("ascii")
    return dict(re.findall(r"^; (.+?) = (.*)$", text[text.rindex("\nG") :], re.MULTILINE))


def test_the_first_lines_say_who_how_long_and_how_many_layers() -> None:
    program, usual = sliced("marlin_220"), wanted("marlin_220", True)
    head = write_gcode(program, usual, np.full(program.n_moves, 3723.4 / program.n_moves)).decode("ascii")

    assert head.splitlines()[:5] == [
        f"; generated by printer_slicer {VERSION}",
        "; printing time = 1h 2m 3s",
        ";TIME:3723",
        f"; layers = {program.plan.n_layers}",
        "; planner = uniform",
    ]


def test_the_version_is_that_of_the_package() -> None:
    text = (Path(__file__).parents[2] / "pyproject.toml").read_text("utf-8")

    assert tomllib.loads(text)["project"]["version"] == VERSION


def test_what_programs_look_for_stands_behind_the_moves() -> None:
    program = sliced("marlin_220")
    usual = profile_with(wanted("marlin_220", True), {"material.cost": 25, "material.type": "PETG"})
    told, used = tail_of(usual, program, 3723.4), program.filament_used
    grams = used * np.pi * 1.75**2 / 4000 * 1.24

    assert told["filament used [mm]"] == f"{used:.2f}"
    assert told["filament used [cm3]"] == f"{used * np.pi * 1.75**2 / 4000:.3f}"
    assert told["filament used [g]"] == told["total filament used [g]"] == f"{grams:.2f}"
    assert told["filament cost"] == told["total filament cost"] == f"{grams * 0.025:.2f}"
    assert told["estimated printing time (normal mode)"] == "1h 2m 3s"
    assert told["total layers count"] == str(program.plan.n_layers)
    assert told["layer_height"] == told["first_layer_height"] == "0.2"
    assert told["max_layer_z"] == f"{program.plan.top[-1]:g}"
    assert told["filament_type"] == "PETG"
    assert told["printer_model"] == usual.printer.name
    assert told["fill_density"] == "15%"
    assert (told["temperature"], told["first_layer_temperature"]) == ("210", "215")


def test_the_layer_height_told_is_that_of_most_of_the_part() -> None:
    tops = np.concatenate(
        [[0.25], 0.25 + np.arange(1, 11) * 0.1, [1.35, 1.45, 1.65, 1.95, 2.25, 2.55, 2.85, 3.15]]
    )
    program = slice_part(box((10, 10, 3.15)), wanted("marlin_220", True), plan=LayerPlan.from_tops(tops))
    told = tail_of(wanted("marlin_220", True), program, 10)

    assert (told["layer_height"], told["first_layer_height"]) == (
        "0.3",
        "0.25",
    )  # 1.5 mm of it, in fewer layers


def test_a_cost_that_is_not_known_is_not_told() -> None:
    assert not [
        key for key in tail_of(wanted("marlin_220", True), sliced("marlin_220"), 10) if "cost]" in key
    ]
    assert "filament cost" not in tail_of(wanted("marlin_220", True), sliced("marlin_220"), 10)


def test_a_time_that_is_not_known_is_not_claimed() -> None:
    assert b"estimated" not in write_gcode(sliced("marlin_220"), wanted("marlin_220", True))


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (0, "0s"),
        (59.4, "59s"),
        (59.6, "1m 0s"),
        (3600, "1h 0m 0s"),
        (3599.6, "1h 0m 0s"),
        (90061, "1d 1h 1m 1s"),
        (864000, "10d 0h 0m 0s"),
    ],
)
def test_durations_are_spoken_without_leading_zeros(seconds: float, text: str) -> None:
    assert format_duration(seconds) == text


def test_all_settings_stand_at_the_end_on_one_line_each() -> None:
    from printer_slicer.profile import list_settings

    usual = profile("marlin_220")
    tail = (
        write_gcode(sliced("marlin_220"), usual)
        .decode("ascii", "replace")
        .partition("; settings\n")[2]
        .splitlines()
    )

    assert [line.split(" = ")[0] for line in tail] == [f"; {key}" for key, _ in list_settings(usual)]
    assert "; quality.layer_height = 0.2" in tail
    assert sum("start_gcode" in line for line in tail) == 1


def test_start_and_end_gcode_stand_before_and_after_the_moves() -> None:
    usual = profile("marlin_220", start_gcode="M117 begins", end_gcode="M117 ends")
    lines = write_gcode(sliced("marlin_220"), usual).splitlines()
    first, last = lines.index(b"M117 begins"), lines.index(b"M117 ends")

    moves = [i for i, line in enumerate(lines) if line.startswith((b"G0 ", b"G1 "))]
    assert first < moves[0] < moves[-1] < last


def test_modes_are_set_after_the_start_gcode_whatever_it_left() -> None:
    for relative, mode in ((True, b"M83"), (False, b"M82")):
        usual = profile("marlin_220", start_gcode="G91\nM82\nG92 E7", relative_extrusion=relative)
        lines = commands(write_gcode(sliced("marlin_220"), usual))
        left = lines.index(b"G92 E7")

        assert lines[left + 1 : left + 4] == [b"G90", mode, b"G92 E0"]


def test_the_fan_is_off_before_the_first_layer_whatever_the_print_before_left() -> None:
    usual = profile("marlin_220", fan_off_below=5)
    lines = commands(write_gcode(sliced("marlin_220"), usual))
    counting = len(lines) - lines[::-1].index(b"G92 E0")
    first_bead = next(i for i in range(counting, len(lines)) if b" E" in lines[i])

    assert b"M107" in lines[:first_bead]


# --- comments for previewers ---


@each_printer
@either
def test_every_layer_is_announced_before_its_first_move(printer: str, relative: bool) -> None:
    plan = sliced(printer).plan
    announced = [move for move in read(printer, relative) if ";LAYER_CHANGE" in move.notes]

    assert len(announced) == plan.n_layers
    for layer, move in enumerate(announced):
        at = move.notes.index(";LAYER_CHANGE")
        assert move.notes[at + 1 : at + 3] == [f";Z:{plan.top[layer]:g}", f";HEIGHT:{plan.height[layer]:g}"]


@each_printer
def test_moves_lie_on_the_layer_announced_last(printer: str) -> None:
    program, z, previous = sliced(printer), 0.0, -1.0
    for move, fed in zip(read(printer, True), np.cumsum(program.filament)[visible(program)], strict=True):
        if ";LAYER_CHANGE" in move.notes:
            z = float(next(note for note in move.notes if note.startswith(";Z:"))[3:])
        if fed > previous and "X" in move.words and move.command == "G1":
            assert move.xyz[2] == pytest.approx(z)
        previous = fed


@each_printer
@either
def test_every_bead_has_the_type_and_width_announced_last(printer: str, relative: bool) -> None:
    program = sliced(printer)
    seen = visible(program)
    role, width = program.role[seen], program.width[seen]
    kind, wide = "", 0.0
    types = set()
    for i, move in enumerate(read(printer, relative)):
        for note in move.notes:
            kind = note[6:] if note.startswith(";TYPE:") else kind
            wide = float(note[7:]) if note.startswith(";WIDTH:") else wide
        if role[i] != Role.TRAVEL:
            assert kind == TYPE_NAMES[Role(int(role[i]))]
            assert wide == pytest.approx(width[i])
            types.add(kind)

    # A raft would be instead of the brim, and supports are off.
    absent = {TYPE_NAMES[role] for role in (Role.RAFT, Role.SUPPORT, Role.SUPPORT_INTERFACE)}
    assert types == set(TYPE_NAMES.values()) - absent


def test_types_and_widths_are_said_only_when_they_change() -> None:
    """Two roles may share a name; the name may then be said twice."""
    program = sliced("marlin_220")
    beads, widths = (column[program.role != Role.TRAVEL] for column in (program.role, program.width))
    notes = [note for move in read("marlin_220", True) for note in move.notes]

    assert sum(note.startswith(";TYPE:") for note in notes) == 1 + (np.diff(beads) != 0).sum()
    assert sum(note.startswith(";WIDTH:") for note in notes) == 1 + (np.diff(widths) != 0).sum()


@each_printer
def test_fan_and_heat_stand_before_the_move_they_belong_to(printer: str) -> None:
    program = sliced(printer)
    seen = visible(program)
    place: Int = np.cumsum(seen, dtype=np.int64) - seen.astype(np.int64)
    moves = read(printer, True)

    for event in program.events:
        notes = moves[int(place[event.index])].notes
        if isinstance(event, Fan):
            assert (f"M106 S{round(event.ratio * 255)}" if event.ratio else "M107") in notes
        elif isinstance(event, Heat):
            assert event.nozzle is None or f"M104 S{event.nozzle:g}" in notes
            assert event.bed is None or f"M140 S{event.bed:g}" in notes
    fans = [note for move in moves[1:] for note in move.notes if note.startswith(("M106", "M107"))]
    assert len(fans) == sum(isinstance(event, Fan) for event in program.events)
    assert any(isinstance(event, Heat) for event in program.events)


# --- dialects ---


def test_every_flavour_a_printer_may_have_is_in_the_table() -> None:
    known = next(row[3] for row in list_setting_definitions() if row[0] == "printer.flavour")

    assert sorted(FLAVOURS) == known.split(" | ")


def test_marlin_is_told_its_limits() -> None:
    usual = wanted("marlin_220", True).printer
    lines = commands(write_gcode(sliced("marlin_220"), wanted("marlin_220", True)))

    assert b"M201 X500 Y500 Z100 E5000" in lines
    assert b"M203 X500 Y500 Z5 E25" in lines
    assert (
        f"M204 P{usual.acceleration:g} R{usual.retract_acceleration:g} T{usual.travel_acceleration:g}".encode()
        in lines
    )
    assert b"M205 X10 Y10 Z0.3 E5" in lines


def test_marlin_with_junction_deviation_is_told_it() -> None:
    deviating = profile_with(
        wanted("marlin_220", True), {"corner": "junction_deviation", "junction_deviation": 0.02}
    )

    assert b"M205 J0.02" in commands(write_gcode(sliced("marlin_220"), deviating))


def test_klipper_is_told_its_limits_in_its_own_words() -> None:
    lines = commands(write_gcode(sliced("corexy_klipper"), wanted("corexy_klipper", True)))
    limit = b" ".join(line for line in lines if line.startswith(b"SET_VELOCITY_LIMIT"))

    assert b"SQUARE_CORNER_VELOCITY=5" in limit
    assert b"MINIMUM_CRUISE_RATIO=0.5" in limit
    assert not any(line.startswith((b"M201", b"M203", b"M204", b"M205")) for line in lines)


def test_klipper_travels_as_fast_as_the_time_model_says() -> None:
    """It has one acceleration for all moves: what the model takes for travels must be what the file asks for."""
    usual = wanted("corexy_klipper", True)
    lines = commands(write_gcode(sliced("corexy_klipper"), usual))
    asked = {float(match.group(1)) for line in lines if (match := re.search(rb"ACCEL=(\S+)", line))}

    assert usual.printer.travel_acceleration in asked


def absolute(moves: list[Step]) -> Float:
    return np.array([move.fed for move in moves])


@each_printer
def test_no_move_feeds_faster_than_the_nozzle_melts(printer: str) -> None:
    program, moves = sliced(printer), read(printer, True)
    material = wanted(printer, True).material
    fed = np.diff(absolute(moves), prepend=0)
    xyz = np.array([move.xyz for move in moves])
    way = np.linalg.norm(np.diff(xyz, axis=0, prepend=xyz[:1]), axis=1)
    beads = (program.role != Role.TRAVEL)[visible(program)] & (way > 0.05)

    speed = np.array([move.feed for move in moves])
    flow = (fed / np.maximum(way, 1e-9) * speed)[beads] * np.pi * material.filament_diameter**2 / 4
    # Positions are rounded to 1 µm, so a bead of 0.05 mm may be 2 % longer in the program than in the text.
    assert flow.max() <= wanted(printer, True).max_flow * 1.03


def test_beads_that_are_not_as_high_as_their_layer_say_so() -> None:
    """One bead of 0.3 mm in a layer of 0.2, then one as high as the layer again, then the next layer."""
    plan = LayerPlan.from_tops(np.array([0.2, 0.4]))
    program = Program(
        plan,
        np.zeros(3),
        np.array([(1, 0, 0.2), (2, 0, 0.2), (3, 0, 0.2), (4, 0, 0.4)], dtype=float),
        filament=np.ones(4),
        speed=np.full(4, 20.0),
        layer=np.array([0, 0, 0, 1]),
        role=np.full(4, int(Role.INTERNAL_INFILL)),
        width=np.full(4, 0.5),
        height=np.array([0.2, 0.3, 0.2, 0.2]),
    )

    text = write_gcode(program, wanted("marlin_220", relative=True)).decode()

    assert re.findall(r"^;HEIGHT:(.*)$", text, re.MULTILINE) == ["0.2", "0.3", "0.2", "0.2"]
