"""What a file makes the machine do: every mode, arcs, offsets, dwells, and the time of it all."""

from __future__ import annotations

from math import hypot, pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.extrusion import move_seconds
from printer_slicer.firmware import FLAVOURS
from printer_slicer.gcode import Moves, Timer, read_moves, write_gcode
from printer_slicer.gcode.reader import MoveReader
from printer_slicer.model import Mesh
from printer_slicer.motion.rules import limits_of
from printer_slicer.pipeline import slice_part
from tests.effort import crossed
from tests.parts import box, plain, profile, sphere, two_boxes
from tests.tiny_gcode import commands


def read(*lines: str) -> Moves:
    return read_moves([line.encode() for line in lines])


def ends(*lines: str) -> list[list[float]]:
    positions: list[list[float]] = np.round(read(*lines).end, 9).tolist()
    return positions


LIMITS = limits_of(plain().printer)

# --- straight lines ---


def test_absolute_moves_lead_to_their_coordinates() -> None:
    moves = read("G1 X10 Y20 Z0.2 F1200", "G0 X5", "G1 Y1 E2.5 F600")

    assert moves.end.tolist() == [[10, 20, 0.2], [5, 20, 0.2], [5, 1, 0.2]]
    assert moves.delta.tolist() == [[10, 20, 0.2, 0], [-5, 0, 0, 0], [0, -19, 0, 2.5]]
    assert moves.speed.tolist() == [20, 20, 10]
    assert moves.line.tolist() == [0, 1, 2]


def test_moves_that_go_nowhere_are_none() -> None:
    assert len(read("G1 X0 Y0", "G1 F900", "G1 X1", "G1 X1", "G92 E5", "G1 E5").speed) == 1


def test_relative_moves_add_up() -> None:
    assert ends("G91", "G1 X3", "G1 X3 Y1", "G90", "G1 X1") == [[3, 0, 0], [6, 1, 0], [1, 1, 0]]


def test_relative_extrusion_holds_for_e_only() -> None:
    moves = read("M83", "G1 X5 E1", "G1 X9 E1", "M82", "G1 X10 E1.5")

    assert moves.delta[:, 3].tolist() == [1, 1, -0.5]
    assert moves.end[:, 0].tolist() == [5, 9, 10]


def test_absolute_and_relative_positions_take_e_along_until_it_is_told_otherwise() -> None:
    assert read("G91", "G1 X1 E1", "G1 X1 E1").delta[:, 3].tolist() == [1, 1]
    assert read("G91", "M82", "G1 X1 E1", "G1 X1 E1").delta[:, 3].tolist() == [1, 0]
    assert read("M83", "G90", "G1 X1 E1", "G1 X2 E1").delta[:, 3].tolist() == [1, 0]


def test_inches_scale_positions_extrusion_and_speed() -> None:
    moves = read("G20", "G1 X1 E0.1 F60", "G21", "G1 X0 F60")

    assert moves.end[:, 0].tolist() == [25.4, 0]
    assert moves.delta[0, 3] == pytest.approx(2.54)
    assert moves.speed.tolist() == pytest.approx([25.4, 1])


def test_the_same_place_under_other_numbers() -> None:
    moves = read("G1 X10 Y10", "G92 X0 E100", "G1 X5 E101", "G1 Y12")

    assert moves.end[:, :2].tolist() == [[10, 10], [15, 10], [15, 12]]
    assert moves.delta[:, 3].tolist() == [0, 1, 0]


def test_offsets_hold_for_relative_moves_and_inches() -> None:
    assert ends("G1 X10", "G92 X1", "G91", "G1 X1", "G90", "G1 X0") == [[10, 0, 0], [11, 0, 0], [9, 0, 0]]
    assert ends("G1 X10", "G20", "G92 X1", "G1 X2") == [[10, 0, 0], [35.4, 0, 0]]


def test_homing_leads_to_zero_and_forgets_offsets() -> None:
    assert ends("G1 X10 Y20 Z5", "G92 X0", "G28", "G1 X1") == [[10, 20, 5], [1, 0, 0]]
    assert ends("G1 X10 Y20 Z5", "G28 X0", "G1 X1") == [[10, 20, 5], [1, 20, 5]]


def test_homing_one_axis_by_its_letter_alone_leaves_the_others() -> None:
    assert ends("G1 X10 Y20 Z5", "G28 X", "G1 X1") == [[10, 20, 5], [1, 20, 5]]
    assert ends("G1 X10 Y20 Z5", "G28 X Y", "G1 Z6") == [[10, 20, 5], [0, 0, 6]]


def test_spaces_leading_zeros_and_small_letters_do_not_matter() -> None:
    """Firmware reads them all; a file whose moves are passed over would be judged by what is left."""
    assert ends("G1X10Y5", "G01 X20", "G00 X25", "g1 x30 y1") == [
        [10, 5, 0],
        [20, 5, 0],
        [25, 5, 0],
        [30, 1, 0],
    ]


def test_what_neither_moves_nor_waits_is_passed_over() -> None:
    assert ends("M117 X99 Y99", "T0", "", "SET_PIN PIN=led VALUE=1", "M104 S200", "G1 X1") == [[1, 0, 0]]


def test_words_that_are_no_numbers_are_left_out() -> None:
    assert ends("G1 X1 Y", "G1 Xnan Y2", "G1 Einf Z1") == [[1, 0, 0], [1, 2, 0], [1, 2, 1]]


def test_heights_are_those_where_plastic_is_laid() -> None:
    moves = read(
        "M83", "G1 Z0.2", "G1 X5 E1", "G1 Z5 E1", "G1 X6", "G1 Z0.5", "G1 X7 E0.1", "G1 Z0.2", "G1 X8 E1"
    )

    assert moves.heights() == [0.2, 0.5]


# --- arcs ---


def length(moves: Moves) -> float:
    return float(np.linalg.norm(moves.delta[:, :3], axis=1).sum())


def test_a_quarter_circle_has_its_length_and_stays_on_its_circle() -> None:
    moves = read("G1 X10 Y0", "G3 X0 Y10 I-10 J0 E3")

    assert length(moves) - 10 == pytest.approx(pi * 5, rel=1e-3)
    assert np.hypot(*moves.end[1:, :2].T) == pytest.approx(10)
    assert moves.end[-1].tolist() == [0, 10, 0]
    assert moves.delta[:, 3].sum() == pytest.approx(3)
    assert set(moves.line[1:].tolist()) == {1}


def test_the_other_direction_is_the_long_way_round() -> None:
    assert length(read("G1 X10 Y0", "G2 X0 Y10 I-10 J0")) - 10 == pytest.approx(3 * pi * 5, rel=1e-3)


def test_a_spiral_climbs_evenly() -> None:
    moves = read("G1 X10 Y0", "G3 X-10 Y0 Z2 I-10 J0")

    assert (np.diff(moves.end[:, 2]) > 0).all()
    assert np.diff(moves.end[:, 2]) == pytest.approx(2 / (len(moves.speed) - 1))


def test_arcs_in_inches_and_relative_positions() -> None:
    assert length(read("G20", "G91", "G3 X1 Y1 I0 J1")) == pytest.approx(25.4 * pi / 2, rel=1e-3)


@pytest.mark.parametrize("code", ["G2", "G3"])
@pytest.mark.parametrize(("x", "y", "i", "j"), [(0, 0, 5, 0), (50, 20, 0, -3), (10, 10, -4, 3)])
def test_an_arc_that_ends_where_it_begins_is_a_full_circle(
    code: str, x: float, y: float, i: float, j: float
) -> None:
    moves = read(f"G1 X{x} Y{y}", f"{code} I{i} J{j}")

    assert length(moves) - hypot(x, y) == pytest.approx(2 * pi * hypot(i, j), rel=2e-3)


@given(
    code=st.sampled_from(["G2", "G3"]),
    x=st.integers(0, 200_000),
    y=st.integers(0, 200_000),
    i=st.integers(-20_000, 20_000),
    j=st.integers(-20_000, 20_000),
)
def test_a_full_circle_is_full_wherever_it_is(code: str, x: int, y: int, i: int, j: int) -> None:
    radius = hypot(i, j) / 1000
    if radius < 1:
        return

    moves = read(f"G1 X{x / 1000} Y{y / 1000}", f"{code} I{i / 1000} J{j / 1000}")

    assert length(moves) - hypot(x, y) / 1000 == pytest.approx(2 * pi * radius, rel=2e-3)


def test_a_full_circle_that_once_was_lost() -> None:
    """The end lies a rounding error beyond the beginning: a sweep of nearly nothing, not of nearly a turn."""
    found = [
        length(read(f"G1 X{x} Y{y}", f"G3 I{i} J{j}")) - hypot(x, y) - 2 * pi * hypot(i, j)
        for x, y, i, j in [
            (110.3, 57.1, 2.7, 1.3),
            (33.1, 7.7, 0.3, 0.7),
            (120.7, 80.2, 5.1, -2.2),
            (99.9, 1.1, -1.7, 3.3),
        ]
    ]

    assert found == pytest.approx([0] * 4, abs=0.1)


# --- waiting and acceleration ---


def test_dwells_add_up_in_seconds_and_milliseconds() -> None:
    assert read("G4 S2", "G4 P500", "G4").dwell_seconds == 2.5
    assert read("G4 S2").seconds(LIMITS) == 2


def test_the_machine_stands_still_before_a_dwell() -> None:
    through, stopped = read("G1 X50 F3000", "G1 X100"), read("G1 X50 F3000", "G4 P0", "G1 X100")

    assert stopped.stop.tolist() == [True, False]
    assert stopped.seconds(LIMITS) > through.seconds(LIMITS) + 0.05


@pytest.mark.parametrize("wait", ["G28 X0", "M400", "M109 S200", "M190 S60", "M0", "G29", "M600"])
def test_commands_that_wait_for_the_machine_stop_it(wait: str) -> None:
    assert read("G1 X50", wait, "G1 X90").stop[0]


def test_accelerations_set_in_the_file_hold_from_there_on() -> None:
    moves = read(
        "G1 X1", "M204 P100 T200 R300", "G1 X2 E1", "G0 X3", "G1 E0", "M204 S50", "G1 X4", "G1 X5 E1"
    )

    assert moves.acceleration[1:4].tolist() == [100, 200, 300]
    assert moves.acceleration[4:].tolist() == [50, 50]
    assert np.isnan(moves.acceleration[0])


def test_a_lower_acceleration_takes_longer() -> None:
    fast, slow = (read(f"M204 T{a}", "G0 X100 F6000").seconds(LIMITS) for a in (500, 50))

    assert slow > fast + 0.5


def test_a_single_move_takes_the_time_of_its_trapezoid() -> None:
    # 100 mm at 50 mm/s with 500 mm/s²: 0.1 s up, 0.1 s down, 95 mm between.
    assert read("G0 X100 F3000").seconds(LIMITS) == pytest.approx(0.2 + 95 / 50)


def test_nothing_takes_no_time() -> None:
    assert read().seconds(LIMITS) == 0
    assert len(read().end) == 0


@pytest.mark.parametrize(
    ("printer", "relative", "mesh"),
    crossed(
        ["marlin_220", "marlin_220_06", "corexy_klipper"],
        [True, False],
        [box((12, 12, 3)), two_boxes((5, 5, 2)), sphere(4)],
    ),
)
def test_the_text_of_a_program_takes_as_long_as_the_program(printer: str, relative: bool, mesh: Mesh) -> None:
    wanted = profile(printer, relative_extrusion=relative, start_gcode="", end_gcode="")
    program = slice_part(mesh, wanted)
    x, y, z = program.origin
    text, dialect = commands(write_gcode(program, wanted)), FLAVOURS[wanted.printer.flavour]

    seconds = read_moves([b"G92 X%f Y%f Z%f" % (x, y, z), *text], dialect=dialect).seconds(
        limits_of(wanted.printer)
    )

    assert seconds == pytest.approx(float(move_seconds(program, wanted).sum()), rel=1e-3)


def test_the_moves_of_a_file_are_those_of_the_program() -> None:
    wanted = profile(start_gcode="", end_gcode="")
    program = slice_part(box((12, 12, 3)), wanted)

    moves = read_moves(commands(write_gcode(program, wanted)))

    assert moves.delta[:, 3].sum() == pytest.approx(program.filament.sum(), abs=1e-4)
    assert moves.end[-1] == pytest.approx(program.xyz[-1], abs=1e-3)
    assert moves.heights() == pytest.approx(program.plan.top.tolist(), abs=1e-4)


# --- tools and extrusion by volume ---


def test_e_counts_volume_after_m200_and_filament_again_after_d0() -> None:
    section = pi * 1.75**2 / 4
    moves = read("M83", "M200 D1.75", "G1 X1 E2", "M200 D0", "G1 X2 E2", "M200 S1", "G1 X3 E2")

    assert moves.delta[:, 3].tolist() == pytest.approx([2 / section, 2, 2 / section])


def test_absolute_volumes_and_g92_count_in_the_same_unit() -> None:
    section = pi * 1.75**2 / 4
    moves = read("M82", "M200 D1.75", "G92 E10", "G1 X1 E12", "G1 X2 E13")

    assert moves.delta[:, 3].tolist() == pytest.approx([2 / section, 1 / section])


def test_every_move_knows_its_tool() -> None:
    moves = read("G1 X1", "T1", "G1 X2", "G1 X3", "T0", "G1 X4")

    assert moves.tool.tolist() == [0, 1, 1, 0]


# Piece by piece


def read_in_pieces(lines: list[str], size: int) -> tuple[float, np.ndarray]:
    """Time and ends of the moves of commands that come some at a time."""
    reader, timer, ends = MoveReader(), Timer(LIMITS), [np.zeros((0, 3))]
    for at in range(0, len(lines), size):
        reader.feed([line.encode() for line in lines[at : at + size]])
        piece = reader.take_moves()
        timer.add(piece)
        ends.append(piece.end)
    return timer.seconds(), np.concatenate(ends)


@pytest.mark.parametrize("size", [1, 2, 3, 7])
def test_stops_and_limits_between_pieces_hold(size: int) -> None:
    lines = [
        "G1 X50 F6000",
        "M400",
        "G1 X100",
        "M203 X20",
        "G1 X150",
        "G4 P500",
        "G1 X200",
        "G92 X0",
        "G1 X10",
    ]
    lines += [f"G1 X{10 + 0.1 * at:.1f} E{0.01 * at:.2f}" for at in range(30)]

    seconds, places = read_in_pieces(lines, size)

    assert seconds == pytest.approx(read(*lines).seconds(LIMITS), rel=1e-12)
    np.testing.assert_array_equal(places, read(*lines).end)
