"""Every flavour in its own words, and the same moves in all of them."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from printer_slicer.arrays import Float
from printer_slicer.errors import ProfileError
from printer_slicer.firmware import FLAVOURS
from printer_slicer.gcode import Moves, read_moves, write_gcode
from printer_slicer.gcode_text import gcode_of
from printer_slicer.inspection.dry_run.runner import dry_run
from printer_slicer.jobs import Job
from printer_slicer.model import Acceleration, LayerPlan, PressureAdvance, Program
from printer_slicer.motion.rules import limits_of
from printer_slicer.pipeline import slice_part, slice_stages
from printer_slicer.profile import Profile
from printer_slicer.roles import Role
from printer_slicer.slice_jobs import job_of
from printer_slicer.stages import Stages
from tests.effort import examples
from tests.parts import plain, two_boxes
from tests.tiny_gcode import body, commands

ABLE = [name for name, dialect in FLAVOURS.items() if dialect.retraction]
LIMITS = {
    "max_speed_x": 300, "max_speed_y": 250, "max_speed_z": 10, "max_speed_e": 60, "max_acceleration_x": 3000,
    "max_acceleration_y": 2500, "max_acceleration_z": 100, "max_acceleration_e": 5000, "acceleration": 2000,
    "travel_acceleration": 2800, "retract_acceleration": 1500, "jerk_xy": 9, "jerk_z": 0.4, "jerk_e": 5,
    "junction_deviation": 0.02, "square_corner_velocity": 5.5, "minimum_cruise_ratio": 0.5, "retract_length": 0.8,
    "retract_speed": 35, "deretract_speed": 25,
}  # fmt: skip

# Flavour, settings, lines that must be there, source.
WORDS = [
    (
        "marlin",
        {"corner": "junction_deviation"},
        ["M201 X3000 Y2500 Z100 E5000", "M203 X300 Y250 Z10 E60", "M204 P2000 R1500 T2800", "M205 J0.02"],
        "marlinfw.org: M201 units/s², M203 units/s, M204 P printing R retraction T travel, M205 J junction deviation",
    ),
    ("marlin", {"corner": "jerk"}, ["M205 X9 Y9 Z0.4 E5"], "marlinfw.org: M205 X Y Z E, classic jerk, units/s"),
    (
        "marlin_legacy",
        {"corner": "jerk"},
        ["M201 X3000 Y2500 Z100 E5000", "M203 X300 Y250 Z10 E60", "M204 P2000 R1500 T2800", "M205 X9 Y9 Z0.4 E5"],
        "Marlin 1.1: M204 P R T, M205 X Y Z E",
    ),
    (
        "prusa",
        {"corner": "jerk"},
        ["M201 X3000 Y2500 Z100 E5000", "M203 X300 Y250 Z10 E60", "M204 P2000 R1500 T2800", "M205 X9 Y9 Z0.4 E5"],
        "Prusa-Firmware: M201, M203, M204, M205",
    ),
    (
        "klipper",
        {"corner": "square_corner"},
        [
            "SET_VELOCITY_LIMIT ACCEL=2000 SQUARE_CORNER_VELOCITY=5.5",
            "SET_VELOCITY_LIMIT MINIMUM_CRUISE_RATIO=0.5",
        ],
        "Klipper, G-Codes: SET_VELOCITY_LIMIT",
    ),
    (
        "reprapfirmware",
        {"corner": "jerk"},
        ["M201 X3000 Y2500 Z100 E5000", "M203 X18000 Y15000 Z600 E3600", "M204 P2000 T2800", "M566 X540 Y540 Z24 E300"],
        "Duet3D: M201 mm/s², M203 mm/min, M204 P T, M566 mm/min",
    ),
    (
        "repetier",
        {"corner": "jerk"},
        ["M201 X2000 Y2000", "M202 X2800 Y2500", "M207 X9 Z0.4 E5"],
        "Repetier-Firmware: M201 print moves, M202 travel moves, M207 X<XY jerk> Z E",
    ),
    (
        "smoothie",
        {"corner": "junction_deviation"},
        ["M203 X300 Y250 Z10", "M203 E60", "M204 S2000", "M204 E1500", "M205 X0.02"],
        "Smoothieware, M503: M204 acceleration mm/sec^2, M205 X junction deviation, M203 mm/sec, M203 E, M204 E",
    ),
]  # fmt: skip
ADVANCE = {
    "marlin": "M900 K0.045",
    "marlin_legacy": "M900 K0.045",
    "prusa": "M900 K0.045",
    "klipper": "SET_PRESSURE_ADVANCE ADVANCE=0.045",
    "reprapfirmware": "M572 D0 S0.045",
}
RETRACTION = {
    "marlin": ["M207 S0.8 F2100 Z0", "M208 S0 F1500"],
    "marlin_legacy": ["M207 S0.8 F2100 Z0", "M208 S0 F1500"],
    "prusa": ["M207 S0.8 F2100 Z0", "M208 S0 F1500"],
    "smoothie": ["M207 S0.8 F2100 Z0", "M208 S0 F1500"],
    "reprapfirmware": ["M207 S0.8 R0 F2100 T1500 Z0"],
    "klipper": [
        "SET_RETRACTION RETRACT_LENGTH=0.8 RETRACT_SPEED=35",
        "SET_RETRACTION UNRETRACT_EXTRA_LENGTH=0 UNRETRACT_SPEED=25",
    ],
}
FASTER = {
    "marlin": "M204 P1234.5",
    "marlin_legacy": "M204 P1234.5",
    "prusa": "M204 P1234.5",
    "reprapfirmware": "M204 P1234.5",
    "smoothie": "M204 S1234.5",
    "repetier": "M201 X1234.5 Y1234.5",
    "klipper": "SET_VELOCITY_LIMIT ACCEL=1234.5",
}
PROGRESS = {
    "marlin": "M73 P50 R1",
    "marlin_legacy": "M73 P50",
    "klipper": "M73 P50",
    "reprapfirmware": "M73 P50 R1",
    "prusa": "M73 Q50 S1 P50 R1",
}


def wanted(flavour: str, **changes: object) -> Profile:
    return plain(flavour=flavour, **{**LIMITS, **changes})


@cache
def sliced() -> Program:
    return slice_part(two_boxes((5, 8, 1), gap=8), plain(**LIMITS))


@cache
def straight() -> Program:
    """A line of 5000 beads, to be printed in any time."""
    xyz = np.column_stack([np.arange(1, 5001) / 50, np.zeros(5000), np.full(5000, 0.2)])
    each = {"filament": np.full(5000, 0.01), "speed": np.full(5000, 20.0), "width": np.full(5000, 0.5)}
    kinds = {"layer": np.zeros(5000, int), "role": np.full(5000, int(Role.INTERNAL_INFILL))}
    plan = LayerPlan.from_tops(np.array([0.2]))
    return Program(plan, np.zeros(3), xyz, **each, **kinds, height=np.full(5000, 0.2))


@cache
def corner_stages(**changes: object) -> Stages:
    """The same for all flavours, on a bed that begins in a corner."""
    return slice_stages(
        two_boxes((5, 8, 1), gap=8), plain(**{**LIMITS, "printer.origin": "corner", **changes})
    )


@cache
def job(flavour: str, **changes: object) -> Job:
    start = {
        "start_gcode": "G28\nM109 S{first_layer_nozzle_temperature}",
        "end_gcode": "M104 S0",
        "printer.origin": "corner",
    }
    return job_of(corner_stages(), wanted(flavour, **start, **changes))


def lines_of(program: Program, profile: Profile, seconds: Float | None = None) -> list[str]:
    return [line.decode() for line in commands(write_gcode(program, profile, seconds))]


def test_every_flavour_has_words_for_its_limits() -> None:
    assert {row[0] for row in WORDS} == set(FLAVOURS)


@pytest.mark.parametrize(("flavour", "changes", "expected", "source"), WORDS)
def test_limits_are_told_as_the_firmware_documents_them(
    flavour: str, changes: dict[str, object], expected: list[str], source: str
) -> None:
    lines = lines_of(sliced(), wanted(flavour, **changes))
    told = [line for line in lines if line.startswith(("M20", "M566", "SET_"))]

    assert [line for line in expected if line not in lines] == [], source
    if len(expected) > 1:
        assert told == expected


@pytest.mark.parametrize("flavour", FLAVOURS)
def test_pressure_advance_is_told_or_refused(flavour: str) -> None:
    if flavour not in ADVANCE:
        with pytest.raises(ProfileError, match=rf"material\.pressure_advance=\S+: flavour {flavour}"):
            wanted(flavour, pressure_advance=0.045)
        return
    lines = lines_of(sliced(), wanted(flavour, pressure_advance=0.045, start_gcode="M117 start"))

    assert lines.index(ADVANCE[flavour]) > lines.index("M117 start")
    assert ADVANCE[flavour] not in lines_of(sliced(), wanted(flavour))


@pytest.mark.parametrize("flavour", FLAVOURS)
def test_events_of_acceleration_and_pressure_advance_stand_before_their_moves(flavour: str) -> None:
    plan = LayerPlan.from_tops(np.array([0.2]))
    xyz = np.array([(1, 0, 0.2), (2, 0, 0.2), (3, 0, 0.2)], dtype=float)
    events = (Acceleration(1, 1234.5), PressureAdvance(2, 0.045))
    each = {
        "filament": np.ones(3),
        "speed": np.full(3, 20.0),
        "width": np.full(3, 0.5),
        "height": np.full(3, 0.2),
    }
    kinds = {"layer": np.zeros(3, int), "role": np.full(3, int(Role.INTERNAL_INFILL))}
    program = Program(plan, np.zeros(3), xyz, **each, **kinds, events=events)
    lines = lines_of(program, wanted(flavour))
    moves = [i for i, line in enumerate(lines) if line.startswith("G1")]

    assert moves[0] < lines.index(FASTER[flavour]) < moves[1]
    if flavour in ADVANCE:
        assert moves[1] < lines.index(ADVANCE[flavour]) < moves[2]
    read = read_moves([b"M83", *(line.encode() for line in lines[moves[0] :])], dialect=FLAVOURS[flavour])
    assert read.acceleration[1:].tolist() == [1234.5, 1234.5]


def progress(flavour: str, seconds: float, **changes: object) -> list[str]:
    lines = lines_of(straight(), wanted(flavour, **changes), np.full(5000, seconds / 5000))
    return [line for line in lines if line.startswith("M73")]


@pytest.mark.parametrize("flavour", FLAVOURS)
def test_progress_is_told_as_the_display_understands_it(flavour: str) -> None:
    told = progress(flavour, 120)

    assert (PROGRESS.get(flavour) in told) == (flavour in PROGRESS)
    assert len(told) == len(set(told)) <= 25
    assert not told or (" P0" in told[0] and " P100" in told[-1])
    assert progress(flavour, 120, progress=False) == []


def test_every_percent_and_every_minute_of_a_long_print_is_told() -> None:
    told = [[int(word[1:]) for word in line.split()[1:]] for line in progress("marlin", 36000)]

    assert [percent for percent, _ in told] == sorted(percent for percent, _ in told)
    assert {percent for percent, _ in told} == set(range(101))
    assert {minutes for _, minutes in told} == set(range(601))


@pytest.mark.parametrize("seconds", [1, 30, 200, 499])
def test_the_share_of_a_short_print_is_told_every_five_seconds_at_most(seconds: int) -> None:
    told = [int(line.split()[1][1:]) for line in progress("marlin_legacy", seconds)]

    assert told[0] == 0
    assert told[-1] == 100
    assert all(step * seconds / 100 >= 5 for step in np.diff(told)[:-1])


# The same moves


def positions(moves: Moves) -> Float:
    """Where each move ends, and what was fed by then."""
    return np.hstack([moves.end, np.cumsum(moves.delta[:, 3])[:, None]])


@pytest.mark.parametrize("flavour", FLAVOURS)
@pytest.mark.parametrize("relative", [True, False])
def test_a_file_read_back_is_the_program(flavour: str, relative: bool) -> None:
    program = sliced()
    text = write_gcode(program, wanted(flavour, relative_extrusion=relative))
    moves = read_moves([b"M83" if relative else b"M82", *commands(body(text))], dialect=FLAVOURS[flavour])
    seen = np.flatnonzero((np.diff(np.rint(program.xyz * 1e3), axis=0, prepend=-1e9) != 0).any(axis=1))
    walked = (moves.delta[:, :3] != 0).any(axis=1)

    assert positions(moves)[walked, :3] == pytest.approx(program.xyz[seen], abs=5.1e-4)
    assert positions(moves)[walked, 3] == pytest.approx(np.cumsum(program.filament)[seen], abs=2e-5)
    assert moves.delta[:, 3].sum() == pytest.approx(program.filament.sum(), abs=1e-4)


@pytest.mark.parametrize("flavour", ABLE)
@pytest.mark.parametrize("relative", [True, False])
def test_retractions_by_the_firmware_are_those_of_the_program(flavour: str, relative: bool) -> None:
    usual = wanted(flavour, relative_extrusion=relative)
    other = wanted(flavour, relative_extrusion=relative, firmware_retraction=True)
    lines = lines_of(sliced(), other)
    dialect = FLAVOURS[flavour]
    plainly, told = (
        read_moves(commands(write_gcode(sliced(), one)), dialect=dialect) for one in (usual, other)
    )

    assert [line for line in RETRACTION[flavour] if line not in lines] == []
    assert lines.count("G10") == lines.count("G11") + 1 > 5
    assert not [line for line in lines if line.startswith("G1 E")]
    assert positions(told) == pytest.approx(positions(plainly), abs=2e-5)
    assert told.speed == pytest.approx(plainly.speed)
    limits = limits_of(other.printer)
    assert told.seconds(limits) == pytest.approx(plainly.seconds(limits), rel=1e-6)


@pytest.mark.parametrize("flavour", ABLE)
def test_the_firmware_is_told_what_more_to_push_forward(flavour: str) -> None:
    changes: dict[str, object] = {
        "deretract_extra": 0.05,
        "printer.origin": "corner",
        "start_gcode": "G28\nM109 S210",
        "end_gcode": "M104 S0",
    }
    usual, other = wanted(flavour, **changes), wanted(flavour, firmware_retraction=True, **changes)
    stages = corner_stages(deretract_extra=0.05)
    plainly, told = (job_of(stages, one) for one in (usual, other))
    verdict = dry_run(told, other)

    assert b"G10" in told.commands
    assert verdict.problems == ()
    assert verdict.report.filament_fed == pytest.approx(dry_run(plainly, usual).report.filament_fed, rel=1e-6)
    assert told.seconds == pytest.approx(plainly.seconds, rel=1e-6)


def test_the_firmware_does_not_pull_back_while_wiping() -> None:
    with pytest.raises(ProfileError, match=r"printer\.wipe_distance=\S+: a wipe cannot be combined"):
        wanted("marlin", firmware_retraction=True, wipe_distance=2)


def test_a_printer_that_cannot_be_told_how_to_retract_is_not_asked_to() -> None:
    with pytest.raises(ProfileError, match=r"printer\.firmware_retraction=True: flavour repetier"):
        wanted("repetier", firmware_retraction=True)


def test_retractions_of_several_lengths_are_left_to_the_moves() -> None:
    program = sliced()
    once = np.flatnonzero((program.role == Role.TRAVEL) & (program.filament < 0))[2]
    other = program.filament.copy()
    other[once] *= 0.5
    other[once + np.flatnonzero(program.filament[once:] > 0)[0]] -= program.filament[once] * 0.5
    columns = {name: getattr(program, name) for name in ("speed", "layer", "role", "width", "height")}
    lines = lines_of(
        Program(program.plan, program.origin, program.xyz, other, **columns),
        wanted("marlin", firmware_retraction=True),
    )

    assert "G10" not in lines
    assert "G1 E-0.4" in [line.partition(" F")[0] for line in lines]


@pytest.mark.parametrize("flavour", FLAVOURS)
def test_every_flavour_prints_as_intended(flavour: str) -> None:
    changes: dict[str, object] = {"pause_at": "0.5"}
    changes |= {"pressure_advance": 0.04} if flavour in ADVANCE else {}
    changes |= {"firmware_retraction": True} if flavour in ABLE else {}
    made = job(flavour, **changes)
    profile = wanted(flavour, **{"printer.origin": "corner", **changes})
    verdict = dry_run(made, profile)

    assert verdict.problems == ()
    assert verdict.simulated_seconds == pytest.approx(verdict.modelled_seconds, rel=1e-3)
    assert made.program is not None
    assert verdict.report.filament_fed == pytest.approx(made.program.filament.clip(0).sum(), rel=1e-4)


@pytest.mark.parametrize("flavour", FLAVOURS)
def test_files_of_every_flavour_are_the_same_every_time(flavour: str) -> None:
    assert gcode_of(sliced(), wanted(flavour)) == gcode_of(sliced(), wanted(flavour))


# Anything that can be written


@st.composite
def programs(draw: st.DrawFn) -> Program:
    """Moves over the bed: beads, travels, retractions, of any size and sign."""
    n_moves = draw(st.integers(1, 30))
    number = st.floats(-90, 90, allow_subnormal=False)
    xyz, fed, role = np.zeros((n_moves, 3)), np.zeros(n_moves), np.zeros(n_moves, np.int64)
    at = np.array([draw(number), draw(number), draw(st.floats(0.05, 60))])
    for move in range(n_moves):
        kind = draw(st.sampled_from(["bead", "travel", "turn"]))
        length = 0.0
        if kind != "turn" or move == 0:
            step = np.array([draw(st.floats(-20, 20)), draw(st.floats(-20, 20)), 0.0])
            step[2] = draw(st.sampled_from([0.0, 0.0, 0.05, -0.05])) if kind == "travel" else 0.0
            to = np.clip(at + step, [-99, -99, 0], [99, 99, 99])
            length, at = float(np.linalg.norm(to - at)), to
        xyz[move] = at
        share = draw(st.floats(0.01, 0.06))
        fed[move] = {"bead": share * length, "travel": 0.0, "turn": draw(st.floats(-5, 5))}[kind]
        role[move] = Role.INTERNAL_INFILL if kind == "bead" else Role.TRAVEL
    beads = role != Role.TRAVEL
    speed = np.array([draw(st.floats(0.1, 500)) for _ in range(n_moves)])
    plan = LayerPlan.from_tops(np.array([0.2]))
    layer = np.zeros(n_moves, np.int64)
    return Program(plan, np.zeros(3), xyz, fed, speed, layer, role, 0.5 * beads, 0.2 * beads)


@given(programs(), st.sampled_from(list(FLAVOURS)), st.booleans())
@settings(max_examples=examples(25))
def test_any_program_comes_back_from_its_text(program: Program, flavour: str, relative: bool) -> None:
    """Every position within half the last digit, all the filament, every speed within half a millimetre a minute."""
    text = write_gcode(program, wanted(flavour, relative_extrusion=relative))
    moves = read_moves([b"M83" if relative else b"M82", *commands(body(text))], dialect=FLAVOURS[flavour])
    half = np.array([0.5e-3, 0.5e-3, 0.5e-4]) + 1e-9
    ends = np.rint(program.xyz * [1e3, 1e3, 1e4]).astype(np.int64)
    seen = (np.diff(ends, axis=0, prepend=ends[:1] - 1) != 0).any(axis=1)
    walked = (moves.delta[:, :3] != 0).any(axis=1)

    assert walked.sum() in (seen.sum(), seen.sum() - 1)  # the first may end where the reader begins
    found = np.vstack([np.zeros(3), moves.end[walked]])
    assert all((np.abs(found - one) <= half).all(axis=1).any() for one in program.xyz)
    assert moves.delta[:, 3].sum() == pytest.approx(program.filament.sum(), abs=1e-4)
