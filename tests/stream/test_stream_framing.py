"""Lines on the wire, checked against what was sent to real firmware."""

from __future__ import annotations

from functools import reduce
from operator import xor

import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.errors import UsageError
from printer_slicer.gcode.lexer import strip
from printer_slicer.stream.framing import (
    MAX_LINE_BYTES,
    check_commands,
    compute_checksum,
    find_max_command_length,
    frame,
)

COMMANDS = st.binary(min_size=1, max_size=80).filter(lambda c: not set(c) & set(b"\n\r\0"))


@pytest.mark.parametrize(
    "line",
    [b"N0 M110 N0*125", b"N1 M105*38", b"N2 G90*18", b"N3 G1 X10 F3000*55", b"N5 M83*29", b"N7 M105*32"],
)
def test_lines_look_as_real_firmware_accepted_them(line: bytes) -> None:
    number, _, rest = line[1:].partition(b" ")
    command, _, _ = rest.rpartition(b"*")

    assert frame(int(number), command) == line


@given(st.binary())
def test_the_checksum_of_a_whole_and_its_checksum_is_zero(data: bytes) -> None:
    assert compute_checksum(data + bytes([compute_checksum(data)])) == 0
    assert compute_checksum(data) == reduce(xor, data, 0)


@given(COMMANDS, st.integers(0, 999_999_999))
def test_a_command_that_passes_the_check_fits_into_the_line_buffer_whatever_its_number(
    command: bytes, number: int
) -> None:
    check_commands([command])

    line = frame(number, strip(command))
    assert len(line) <= MAX_LINE_BYTES
    assert (
        len(strip(command)) <= find_max_command_length(number, len(line) + 1) + 2
    )  # a checksum may be short


@pytest.mark.parametrize(
    ("line", "command"),
    [
        (b"G1 X10 ; to the right", b"G1 X10"),
        (b"; only a comment", b""),
        (b"  G28\r\n", b"G28"),
        (b"", b""),
        (b"N12 G1 X10*33", b"G1 X10"),
        (b"N12G28 *7", b"G28"),
        (b"M110 N5", b""),
        (b"M110", b""),
        (b"M1100", b"M1100"),
        (b"m110 n5", b""),
        (b"n12 g1 x10*33", b"g1 x10"),
        (b"NAME*12", b"NAME*12"),
        (b"M117 50% * 2", b"M117 50% * 2"),
        (b"NOTHING", b"NOTHING"),
    ],
)
def test_only_what_the_printer_needs_is_kept(line: bytes, command: bytes) -> None:
    assert strip(line) == command


@pytest.mark.parametrize("bad", [b"G28\nG90", b"G28\rG90", b"G\0", b"M117 " + b"x" * 76])
def test_what_can_never_be_sent_is_refused_with_its_place(bad: bytes) -> None:
    with pytest.raises(UsageError, match="line 3"):
        check_commands([b"G28", b"; " + b"long comment" * 20, bad])


def test_line_breaks_around_a_command_do_no_harm() -> None:
    check_commands([b"G28\r\n", b"\n", b"G90" + b" " * 90 + b"; far away"])
