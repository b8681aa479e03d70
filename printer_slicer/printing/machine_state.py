"""State of a print that a resume needs: machine state, settings, and the extent of the printed part.

It is updated with each command in the order in which the printer receives them, so that a print can be resumed without
a difference: after a pause, or on a printer that has lost its state. Lengths in mm, speeds in mm/s.
"""

from __future__ import annotations

from collections import deque
from copy import copy
from typing import Final, NamedTuple

from printer_slicer import texts
from printer_slicer.gcode.commands import Effect, commands_that
from printer_slicer.gcode.lexer import parse, parse_extended, strip
from printer_slicer.gcode.state import MachineState, ModalState

__all__ = ["SCRIPT", "PrintState", "Step", "number"]

_HISTORY: Final = 256
"""Number of commands kept: more than the moves in the planner of any Marlin-like firmware, and what lies between."""

_STICKY: Final = commands_that(Effect.STICKY)
"""Without SET_GCODE_OFFSET: a baby step is part of the nozzle height, which a resume restores."""

_WAITS: Final = commands_that(Effect.WAITS)
_MESHES: Final = frozenset({b"BED_MESH_PROFILE", b"BED_MESH_CALIBRATE"})


def number(value: float) -> bytes:
    """Format a number for G-code."""
    return texts.number(value).encode()


SCRIPT: Final = -2
"""Entry number of a command from a script of the host, on which later commands depend."""


class Step(NamedTuple):
    """A command, with the printer's state before and after it.

    Attributes:
        entry: index in the job; -1: not from the job, or SCRIPT.
        before, after: state.
        command: the command.
        origin: offset of the program's coordinates from the machine's after it, mm.
    """

    entry: int
    before: ModalState
    after: ModalState
    command: bytes
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def loses_place(self) -> bool:
        """Return whether it moves from a known position to an unknown one."""
        return self.before.known and not self.after.known


class PrintState:
    """State of a print, updated by `follow` with each command.

    Args:
        flavour: G-code flavour of the firmware.

    Attributes:
        machine: machine state.
        stand: position and modes.
        mesh: command that switches bed mesh compensation on, empty for none.
        sticky: key of a setting -> command to repeat after a printer restart, and whether it is in inches.
        recent: the last moves, which may not have been executed yet, and the commands between them.
    """

    def __init__(self, flavour: str = "marlin") -> None:
        self.machine = MachineState(flavour)
        self.stand = self.machine.modal
        self.mesh = b""
        self.sticky: dict[bytes, tuple[bytes, bool]] = {}
        self.recent: deque[Step] = deque(maxlen=_HISTORY)
        self._top: float | None = None
        self._box: tuple[float, float, float, float] | None = None
        self._frames = self.machine.frames

    @property
    def highest(self) -> float | None:
        """Highest z of any extrusion, in current coordinates; None if there is none or it is unknown."""
        return None if self._top is None else self._top + self.machine.shift[2]

    @property
    def box(self) -> tuple[float, float, float, float] | None:
        """Bounding box (x min, y min, x max, y max) of all extrusion, in current coordinates; None as above."""
        if self._box is None:
            return None
        (low_x, low_y, high_x, high_y), (x, y, _) = self._box, self.machine.shift
        return low_x + x, low_y + y, high_x + x, high_y + y

    def fork(self) -> PrintState:
        """Return an independent copy without the remembered moves."""
        other = copy(self)
        other.machine = self.machine.fork()
        other.sticky = dict(self.sticky)
        other.recent = deque(maxlen=_HISTORY)
        return other

    @property
    def comparable(self) -> bool:
        """Return whether the positions of all unconfirmed moves are known in current coordinates."""
        shift = self.machine.shift
        return self.stand.known and all(step.origin == shift and not step.loses_place for step in self.recent)

    def stop_at(self, stand: ModalState) -> None:
        """Record that the machine stopped during a move."""
        self.machine.set_stop_position(stand.x, stand.y, stand.z)
        self.stand = self.machine.modal

    def follow(self, command: bytes, entry: int = -1) -> None:
        """Apply a command; `entry` is its index in the job, -1 for a command of a user, SCRIPT for one of the host."""
        command = strip(command)
        word, values = parse(command)
        before = self.stand
        moved = self.machine.apply(word, values, command) is not None
        self.stand = self.machine.modal
        if self.machine.frames != self._frames:
            self._forget_extent()
        if moved:
            self._record_extent(before)
        elif word:
            self._set(word, values, command)
            if entry >= 0 and word in _WAITS:
                self.recent.clear()
        else:
            self._set_extended(command)
        if moved or entry != -1:
            begin = before if moved else self.stand
            self.recent.append(Step(entry, begin, self.stand, command, self.machine.shift))

    def _forget_extent(self) -> None:
        """Forget the extent of the part, because an axis has an unknown origin."""
        was, self._frames = self._frames, self.machine.frames
        if was[2] != self._frames[2]:
            self._top = None
        if was[:2] != self._frames[:2]:
            self._box = None

    def _record_extent(self, before: ModalState) -> None:
        """Record the extent of an extruding move."""
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
        if word in _STICKY:
            self.sticky[word + b"".join(sorted(values))] = command, self.machine.inches

    def _set_extended(self, command: bytes) -> None:
        """Process an extended command, such as Klipper's."""
        name, _ = parse_extended(command)
        if name in _STICKY:
            self.sticky[name] = command, False
        elif name in _MESHES:
            # A measured mesh can be restored only by its name.
            self.mesh = command if b"LOAD" in command.upper() else b"BED_MESH_PROFILE LOAD=default"
