"""Random G-code programs with units, offsets, modes, tools, lower case, comments, line numbers and checksums."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import inf

from hypothesis import strategies as st

from printer_slicer.firmware import FIRMWARES
from printer_slicer.gcode.lexer import strip
from printer_slicer.sim.firmware_state import FirmwareState
from printer_slicer.sim.firmwares import (
    KLIPPER,
    MARLIN_1_1,
    MARLIN_2_1,
    PRUSA_MK3,
    REPETIER,
    REPRAPFIRMWARE,
    SMOOTHIE,
)
from printer_slicer.sim.machine import Machine
from printer_slicer.sim.printer import SimulatedPrinter
from printer_slicer.stream.framing import compute_checksum

_SIMULATED = {
    "marlin": MARLIN_2_1,
    "marlin_legacy": MARLIN_1_1,
    "prusa": PRUSA_MK3,
    "klipper": KLIPPER,
    "reprapfirmware": REPRAPFIRMWARE,
    "repetier": REPETIER,
    "smoothie": SMOOTHIE,
}
# A flavour without a simulated printer of its own is tried on Marlin's wire, as a dry run does.
SIMULATED_FIRMWARES = {
    flavour: _SIMULATED.get(flavour, replace(MARLIN_2_1, dialect=flavour)) for flavour in FIRMWARES
}
LARGE = Machine(
    box_min=(-1e5,) * 3,
    box_max=(1e5,) * 3,
    coldest_extrusion=0.0,
    longest_extrusion=inf,
    extruders=3,
    tool_change=0.0,
)
"""A machine that refuses nothing."""


@dataclass(frozen=True)
class Line:
    """A command, and how its line is written."""

    code: str
    words: tuple[tuple[str, float], ...] = ()
    lower: bool = False
    tight: bool = False
    comment: str = ""
    numbered: bool = False

    def text(self, number: int) -> bytes:
        """As it stands in the file."""
        blank = "" if self.tight else " "
        text = blank.join([self.code, *(f"{letter}{value:.3f}" for letter, value in self.words)])
        line = (text.lower() if self.lower else text).encode()
        if self.numbered:
            line = b"N%d %s" % (number, line)
            line = b"%s*%d" % (line, compute_checksum(line))
        return line + self.comment.encode()


def words(
    letters: str, low: float = -50.0, high: float = 50.0
) -> st.SearchStrategy[tuple[tuple[str, float], ...]]:
    """Some of the letters with a number each."""
    chosen = st.lists(st.sampled_from(letters), unique=True, max_size=len(letters))
    number = st.floats(low, high).map(lambda value: round(value, 3))
    speed = st.integers(300, 6000).map(float)
    return chosen.flatmap(
        lambda names: st.tuples(
            *(st.tuples(st.just(name), speed if name == "F" else number) for name in names)
        )
    )


COMMANDS = st.one_of(
    st.tuples(st.sampled_from(["G0", "G1", "G01"]), words("XYZEF")),
    st.tuples(st.sampled_from(["G20", "G21", "G90", "G91", "M82", "M83", "G10", "G11"]), st.just(())),
    st.tuples(st.just("G92"), words("XYZE").filter(bool)),
    st.tuples(st.just("M206"), words("XYZ")),
    st.tuples(st.sampled_from(["G53 G1", "G53 G0"]), words("XYZ")),
    st.tuples(st.sampled_from(["T0", "T1", "T2"]), st.just(())),
    st.tuples(st.sampled_from(["M104", "M140"]), words("S", 0.0, 120.0)),
    st.tuples(st.just("M104 T1"), words("S", 0.0, 120.0)),
)
SMALL_ARCS = st.tuples(
    st.sampled_from(["G2", "G3", "G02"]),
    st.tuples(words("XYZEF"), st.one_of(words("IJ", -3.0, 3.0), words("R", -60.0, 60.0))).map(
        lambda parts: (*parts[0], *parts[1])
    ),
)
MORE_COMMANDS = st.one_of(
    SMALL_ARCS,
    st.tuples(st.sampled_from(["G28", "G28 X", "G28 Y0 Z", "G28 Z", "G4 P1", "M400"]), st.just(())),
    st.tuples(st.sampled_from(["M104", "M104 T2", "M140", "G10 P1", "M568 P2"]), words("S", 0.0, 120.0)),
    st.tuples(st.sampled_from(["M109", "M109 T1", "M190"]), words("SR", 20.0, 90.0)),
    st.tuples(st.sampled_from(["M104", "M140"]), words("R", 20.0, 90.0)),
    st.tuples(st.sampled_from(["M106", "M106 P1", "M107"]), words("S", 0.0, 255.0)),
)


def written(
    commands: st.SearchStrategy[tuple[str, tuple[tuple[str, float], ...]]],
) -> st.SearchStrategy[Line]:
    """Commands in lines of all kinds."""
    return st.builds(
        lambda command, *rest: Line(*command, *rest),
        commands,
        st.booleans(),
        st.booleans(),
        st.sampled_from(["", " ; note", ";G1 X9", "\t"]),
        st.booleans(),
    )


LINES = written(COMMANDS)
MORE_LINES = written(MORE_COMMANDS)
"""Commands that wait, home and turn besides."""


def program_of(lines: list[Line]) -> list[bytes]:
    """The lines of a file without what never reaches a printer."""
    return [strip(line.text(number)) for number, line in enumerate(lines, 1)]


class Executor:
    """A simulated printer that gets commands one by one.

    Args:
        flavour: of its firmware, which reads either case.
    """

    def __init__(self, flavour: str) -> None:
        self.printer = SimulatedPrinter(
            LARGE, replace(SIMULATED_FIRMWARES[flavour], any_case=True, boot_seconds=0.0)
        )
        self._now = 0.0
        self._number = 0

    def do(self, command: bytes) -> FirmwareState:
        """Execute a command; the state behind it."""
        printer = self.printer
        self._number += 1
        printer.receive_line(self._number, command.decode(), self._now)
        while printer.has_unanswered_command:
            self._now = max(printer.wakeup() or self._now, self._now) + 1e-6
            printer.send(self._now)
        printer.send(self._now)
        return printer.state


def simulated(commands: list[bytes], flavour: str) -> FirmwareState:
    """The state of a printer that has executed them."""
    executor = Executor(flavour)
    for command in commands:
        board = executor.do(command)
    return board
