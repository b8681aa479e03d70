"""What of a print must be known so that it can be taken up again: the state of the machine, settings, what was laid.

Followed command by command in the order in which the printer gets them, so that a print can be taken up again as if
it had never been left: after a pause, or on a machine that has lost everything. Lengths in mm, speeds in mm/s.
"""

from __future__ import annotations

import re
from collections import deque
from copy import copy
from typing import Final, NamedTuple

from printer_slicer.gcode.commands import WAITS_FOR_MOTION
from printer_slicer.gcode.lexer import parse
from printer_slicer.gcode.state import MachineState, ModalState
from printer_slicer.stream.framing import strip

__all__ = ["SCRIPT", "Modes", "Step", "number"]

_HISTORY: Final = 256
"""Commands that are remembered: more than the moves in any planner of Marlin's kind, and what lies between."""

_STICKY: Final = frozenset(
    {
        b"M201",
        b"M203",
        b"M204",
        b"M205",
        b"M220",
        b"M221",
        b"M207",
        b"M208",
        b"M900",
        b"M572",
        b"M566",
    }
    | {b"G17", b"M200", b"M92", b"M302", b"M851"}
)
"""Settings that stay and say themselves what they set: the last of each with the same letters is enough."""

_WORDS: Final = re.compile(rb"([A-Z][A-Z_]{2,})\b")
_STICKY_WORDS: Final = frozenset({b"SET_PRESSURE_ADVANCE", b"SET_VELOCITY_LIMIT", b"SET_RETRACTION"})
"""Not SET_GCODE_OFFSET: a baby-step is in the height at which the nozzle stands, and that is what is told anew."""

_MESHES: Final = frozenset({b"BED_MESH_PROFILE", b"BED_MESH_CALIBRATE"})


def number(value: float) -> bytes:
    """A number as G-code says it: five decimals at most, no zeros behind."""
    return f"{value:.5f}".rstrip("0").rstrip(".").replace("-0", "0" if abs(value) < 5e-6 else "-0").encode()


SCRIPT: Final = -2
"""Instead of an entry: a command of the host's own scripts, without which what follows would be wrong."""


class Step(NamedTuple):
    """A command, and how the printer stands before and after it.

    Attributes:
        entry: its index in the job; -1: not of the job, or SCRIPT.
        before, after: how it stands.
        command: itself.
        origin: mm by which its coordinates are higher than the machine's behind it.
    """

    entry: int
    before: ModalState
    after: ModalState
    command: bytes
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def loses_place(self) -> bool:
        """Whether it is a move from a known place to one that is not."""
        return self.before.known and not self.after.known


class Modes:
    """Follows commands.

    Args:
        flavour: of the firmware.

    Attributes:
        machine: its state.
        stand: where and how it stands.
        fan: 0 to 255, of the part fan.
        fans: number -> command, of others.
        mesh: the command that has the bed's unevenness followed, empty for none.
        sticky: settings to be said again to a printer that has lost them, by what they set, and whether in inches.
        recent: the last moves that may not have been made yet, and what belongs between them.
    """

    def __init__(self, flavour: str = "marlin") -> None:
        self.machine = MachineState(flavour)
        self.stand = self.machine.modal
        self.fan = 0.0
        self.fans: dict[float, bytes] = {}
        self.mesh = b""
        self.sticky: dict[bytes, tuple[bytes, bool]] = {}
        self.recent: deque[Step] = deque(maxlen=_HISTORY)
        self._top: float | None = None
        self._box: tuple[float, float, float, float] | None = None
        self._frames = self.machine.frames

    @property
    def highest(self) -> float | None:
        """Greatest z at which plastic was laid, as the program counts now; None where none was, or nobody knows."""
        return None if self._top is None else self._top + self.machine.shift[2]

    @property
    def box(self) -> tuple[float, float, float, float] | None:
        """X from, y from, x to, y to of all plastic laid while moving, as the program counts now; None as above."""
        if self._box is None:
            return None
        (low_x, low_y, high_x, high_y), (x, y, _) = self._box, self.machine.shift
        return low_x + x, low_y + y, high_x + x, high_y + y

    def fork(self) -> Modes:
        """Another one that goes on from here by itself; it remembers no moves."""
        other = copy(self)
        other.machine = self.machine.fork()
        other.fans, other.sticky = dict(self.fans), dict(self.sticky)
        other.recent = deque(maxlen=_HISTORY)
        return other

    @property
    def comparable(self) -> bool:
        """Whether all places of moves that may not have been made yet are known, from the origin of now."""
        shift = self.machine.shift
        return self.stand.known and all(step.origin == shift and not step.loses_place for step in self.recent)

    def stop_at(self, stand: ModalState) -> None:
        """The machine was stopped on its way."""
        self.machine.move_to(stand.x, stand.y, stand.z)
        self.stand = self.machine.modal

    def follow(self, command: bytes, entry: int = -1) -> None:
        """One more command, entry `entry` of the job; -1: somebody said it, SCRIPT: the host did."""
        command = strip(command)
        word, values = parse(command)
        before = self.stand
        moved = self.machine.apply(word, values, command) is not None
        self.stand = self.machine.modal
        if self.machine.frames != self._frames:
            self._forget_laid()
        if moved:
            self._lay(before)
        elif word:
            self._set(word, values, command)
            if entry >= 0 and word in WAITS_FOR_MOTION:
                self.recent.clear()
        else:
            self._set_in_words(command)
        if moved or entry != -1:
            begin = before if moved else self.stand
            self.recent.append(Step(entry, begin, self.stand, command, self.machine.shift))

    def _forget_laid(self) -> None:
        """An axis counts from an unknown place: how that lies to what was laid, nobody knows."""
        was, self._frames = self._frames, self.machine.frames
        if was[2] != self._frames[2]:
            self._top = None
        if was[:2] != self._frames[:2]:
            self._box = None

    def _lay(self, before: ModalState) -> None:
        """Remember where a move that pushes filament has laid it."""
        after = self.stand
        if after.e > before.e and after.z is not None and (after.x, after.y) != (before.x, before.y):
            z = after.z - self.machine.shift[2]
            self._top = z if self._top is None else max(self._top, z)
            self._grow(before)
            self._grow(after)

    def _grow(self, stand: ModalState) -> None:
        if stand.x is None or stand.y is None:
            return
        x, y = stand.x - self.machine.shift[0], stand.y - self.machine.shift[1]
        low_x, low_y, high_x, high_y = self._box or (x, y, x, y)
        if self._box is None or not (low_x < x < high_x and low_y < y < high_y):
            self._box = min(low_x, x), min(low_y, y), max(high_x, x), max(high_y, y)

    def _set(self, word: bytes, values: dict[bytes, float], command: bytes) -> None:
        if word == b"G29":
            self.mesh = b"M420 S1"
        elif word == b"M420" and (b"S" in values or b"Z" in values):
            self.mesh = command if values.get(b"S", 1.0) else b""
        elif word in {b"M106", b"M107"} and values.get(b"P", 0.0) == 0.0:
            self.fan = values.get(b"S", 255.0) if word == b"M106" else 0.0
        elif word in {b"M106", b"M107"}:
            self.fans[values[b"P"]] = command
        if word in _STICKY:
            self.sticky[word + b"".join(sorted(values))] = command, self.machine.inches

    def _set_in_words(self, command: bytes) -> None:
        """A command of words, such as Klipper's."""
        said = command.upper()
        found = _WORDS.match(said)
        if found and found[1] in _STICKY_WORDS:
            self.sticky[found[1]] = command, False
        elif found and found[1] in _MESHES:
            # What was measured is kept by name at best.
            self.mesh = command if b"LOAD" in said else b"BED_MESH_PROFILE LOAD=default"
