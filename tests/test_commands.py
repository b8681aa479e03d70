"""Commands are read from their text piece by piece, and are the same as if it were read at once."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.commands import Commands, find_lines, split_gcode
from printer_slicer.errors import UsageError
from printer_slicer.gcode.lexer import strip
from printer_slicer.profile import load_profile
from printer_slicer.slice_jobs import job_from

LINE = st.sampled_from(
    [
        b"G1 X1 Y2 E3",
        b"G0 X5 F3000",
        b"G1 X7 ; there",
        b" G28",
        b"N12 M105*31",
        b"M110 N3",
        b"",
        b"  ",
        b"; hello",
        b";LAYER_CHANGE",
        b";LAYER:4",
        b";TYPE:Perimeter",
        b"; FEATURE: Top surface",
        b"G1 " + b"X1" * 40,
        b"M117 a\0b",
    ]
)
TEXTS = st.builds(
    lambda lines, end, last: end.join(lines) + last,
    st.lists(LINE, max_size=30),
    st.sampled_from([b"\n", b"\r\n"]),
    st.sampled_from([b"", b"\n"]),
)
SIZES = st.integers(1, 60)


def plainly(text: bytes) -> tuple[list[bytes], list[int], dict[int, int], dict[int, str]]:
    """Commands, their lines, layers and roles, read line by line."""
    commands, numbers, marks, roles, layer = [], [], {}, {}, 0
    kind = b"LAYER_CHANGE" if b";LAYER_CHANGE" in text else b"LAYER:"
    if b";LAYER:" in text and text.find(b";LAYER:") < text.find(b";LAYER_CHANGE"):
        kind = b"LAYER:"
    for number, line in enumerate(text.split(b"\n"), 1):
        if command := strip(line):
            commands.append(command)
            numbers.append(number)
        elif line.startswith(b";" + kind):
            layer += 1
            marks[len(commands)] = layer
        elif line.startswith((b";TYPE:", b"; FEATURE:")):
            roles[len(commands)] = line.partition(b":")[2].decode().strip()
    return commands, numbers, marks, roles


@given(TEXTS, SIZES)
def test_pieces_of_any_size_hold_the_same(text: bytes, size: int) -> None:
    commands, numbers, marks, roles = plainly(text)

    told = split_gcode(text, size)

    assert list(told.commands) == commands
    assert (told.marks, told.roles) == (marks, roles)
    assert find_lines(text, range(len(commands)), size) == numbers
    assert told.suspect == [at for at, one in enumerate(commands) if len(one) > 60 or b"\0" in one]


@given(TEXTS, SIZES, st.integers(-40, 40), st.integers(-40, 40), st.sampled_from([None, 1, 2, -1, -3]))
def test_they_are_taken_like_those_of_a_list(
    text: bytes, size: int, first: int, last: int, step: int | None
) -> None:
    commands = split_gcode(text, size).commands
    plain, _, _, _ = plainly(text)

    assert len(commands) == len(plain)
    assert list(commands[first:last:step]) == plain[first:last:step]
    if -len(plain) <= first < len(plain):
        assert commands[first] == plain[first]
    else:
        with pytest.raises(IndexError):
            commands[first]


def test_a_command_is_found_in_any_piece() -> None:
    commands = split_gcode(b"G28\nG1 X1 ; G20\nG1 X2\n", 1).commands

    assert b"G1 X2" in commands
    assert b"G20" not in commands
    assert commands.index(b"G1 X2") == 2


def test_a_line_that_nobody_asked_for_is_not_looked_for() -> None:
    assert find_lines(b"G28\nG1 X1\n", []) == []
    assert find_lines(b"G28\nG1 X1\n", [1, 7, 1]) == [2, 0, 2]


def test_the_line_that_cannot_be_sent_is_named_far_behind(tmp_path: Path) -> None:
    lines = [b"G1 X%d" % (at % 100) for at in range(100_000)]
    lines[80_000] = b"M117 " + b"long " * 30
    path = tmp_path / "job.gcode"
    path.write_bytes(b"; head\n" + b"\n".join(lines))

    with pytest.raises(UsageError, match="line 80002"):
        job_from(path, load_profile())


def test_a_long_job_takes_no_more_memory_than_its_text(tmp_path: Path) -> None:
    path = tmp_path / "job.gcode"
    peaks, sizes = [], []
    for count in (10_000, 30_000):
        moves = b"".join(b"G1 X%.2f Y%.2f E.01\n" % (at % 97, at % 89) for at in range(count))
        path.write_bytes(b"G28\nM83\nG1 Z.2 F1800\n" + moves)
        sizes.append(path.stat().st_size)
        tracemalloc.start()
        job = job_from(path, load_profile())
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        assert isinstance(job.commands, Commands)
        assert len(job.commands) == count + 3

    assert peaks[1] - peaks[0] < 1.2 * (sizes[1] - sizes[0])
