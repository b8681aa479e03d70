"""The rest of a move that was interrupted ends where the move ends, on the same circle if it is an arc."""

from __future__ import annotations

from math import hypot

import pytest
from hypothesis import given
from hypothesis import strategies as st

from printer_slicer.gcode.lexer import parse
from printer_slicer.printing.machine_state import PrintState, Step
from printer_slicer.printing.move_geometry import build_remaining_move, interpolate_state


def last_of(*commands: bytes) -> Step:
    modes = PrintState()
    for command in commands:
        modes.follow(command)
    return modes.recent[-1]


@given(share=st.floats(0.05, 0.95), inches=st.booleans(), relative=st.booleans())
@pytest.mark.parametrize("word", [b"G2", b"G3"])
def test_the_rest_of_an_arc_has_the_same_centre(
    word: bytes, share: float, inches: bool, relative: bool
) -> None:
    unit = 25.4 if inches else 1.0
    modes = [b"G20" if inches else b"G21", b"G1 X30 Y20 Z1 F600", b"G91" if relative else b"G90", b"M83"]
    goal = b"X-10 Y10" if relative else b"X20 Y30"
    step = last_of(b"G92 X0 Y0 Z0 E0", *modes, word + b" " + goal + b" I-10 J0 E5")

    _, values = parse(build_remaining_move(step, share))
    here = interpolate_state(step, share)
    assert here.x is not None
    assert here.y is not None
    centre = here.x + values[b"I"] * unit, here.y + values[b"J"] * unit
    end = [
        values[letter] * unit + (at if relative else 0.0) if letter in values else at
        for letter, at in ((b"X", here.x), (b"Y", here.y))
    ]

    assert centre == pytest.approx((20 * unit, 20 * unit), abs=0.01)
    assert end == pytest.approx([20 * unit, 30 * unit], abs=0.01)
    assert hypot(here.x - centre[0], here.y - centre[1]) == pytest.approx(10 * unit, abs=0.01)
    assert values[b"E"] * unit == pytest.approx(5 * unit * (1 - share), abs=0.01)
