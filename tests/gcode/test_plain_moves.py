"""Plain moves read all at once, against the careful reader that takes them one by one."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.gcode import read_moves
from printer_slicer.gcode.plain_moves import LETTERS, read_plain_moves
from printer_slicer.gcode.reader import MoveReader, Moves

NUMBERS = st.one_of(
    st.integers(-300, 300).map(str),
    st.floats(-300, 300).map(lambda value: f"{value:.3f}"),
    st.sampled_from(
        ["-.5", "+3", "0", "-0", "00012.50", ".125", "7.", "123456789012345", "1e5", "1.2.3", "-", "1x"]
    ),
)
WORDS = st.lists(st.tuples(st.sampled_from("XYZEFIJ"), NUMBERS), max_size=6)
MOVES = st.builds(
    lambda code, words: " ".join([code, *(letter + number for letter, number in words)]),
    st.sampled_from(["G0", "G1", "G1", "G1", "G01", "g1", "G10", "G2"]),
    WORDS,
)
OTHERS = st.sampled_from(
    [
        "G91",
        "G90",
        "M82",
        "M83",
        "G92 E0",
        "G92 X5",
        "G28",
        "G20",
        "G21",
        "M204 P500",
        "G4 P10",
        "T1",
        "M200 D1.75",
        "M220 S50",
    ]
)
JOBS = st.lists(st.one_of(MOVES, MOVES, MOVES, OTHERS), max_size=60)


def one_by_one(commands: list[bytes]) -> Moves:
    """The moves, read without any run of plain ones."""
    reader = MoveReader()
    for command in commands:
        reader.feed([command, b"M117"])  # a run of one is followed as any other command
    return reader.take_moves()


@given(JOBS)
def test_runs_of_moves_lead_where_single_moves_do(lines: list[str]) -> None:
    commands = [line.encode() for line in lines]
    together, apart = read_moves(commands), one_by_one(commands)

    assert together.dwell_seconds == apart.dwell_seconds
    np.testing.assert_array_equal(together.line, apart.line // 2)
    for name in ("end", "delta", "speed", "acceleration", "tool", "stop"):
        np.testing.assert_array_equal(getattr(together, name), getattr(apart, name))
    assert together.changes == apart.changes


@given(st.lists(st.tuples(st.sampled_from(LETTERS), st.floats(-1e5, 1e5)), min_size=1, max_size=5))
def test_numbers_are_those_that_python_reads(words: list[tuple[str, float]]) -> None:
    written = [(letter, f"{value:.6f}") for letter, value in words]
    plain = read_plain_moves([" ".join(["G1", *(letter + number for letter, number in written)]).encode()])
    last = dict(written)

    assert plain.index.tolist() == [0]
    for column, letter in enumerate(LETTERS):
        got = plain.words[0, column]
        assert got == float(last[letter]) if letter in last else np.isnan(got)


@pytest.mark.parametrize(
    "line",
    [
        b"G1",
        b"G1X5",
        b"G1 X",
        b"G1 X5 Y",
        b"G1 X1.2.3",
        b"G1  X5",
        b"G1 X5 ",
        b"G1 X 5",
        b"G1 X1e5",
        b"G1 x5",
        b"G1 A5",
        b"G11 X5",
        b"G1 X5*33",
        b"G1 X--5",
        b"G1 X.",
        b"G1 X5Y6",
        b"G1 X12345678901234567",
        b"G1 X2000000000",
        b"M104 S200",
        b"",
        b"G2 X5 I3",
    ],
)
def test_what_is_written_in_any_other_way_is_left_alone(line: bytes) -> None:
    plain = read_plain_moves([b"G1 X1", line, b"G0 Y2"])

    assert plain.index.tolist() == [0, 2]
    assert plain.words[:, :2].tolist()[1][1] == 2


def test_no_commands_have_no_plain_moves() -> None:
    assert len(read_plain_moves([]).index) == 0
