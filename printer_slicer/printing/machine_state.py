"""Track what is needed to resume a print: machine state, settings, and extent of the printed part.

The state is updated with each command in the order in which the printer receives them. So a print can be resumed
exactly: after a pause, or on a printer that has lost its state. Lengths in mm, speeds in mm/s.
"""

from __future__ import annotations

from collections import deque
from copy import copy
from typing import Final, NamedTuple

from printer_slicer import texts
from printer_slicer.gcode.commands import Effect, find_codes
from printer_slicer.gcode.lexer import parse, parse_extended_command, strip
from printer_slicer.gcode.state import MachineState, ModalState

__all__ = ["SCRIPT_ENTRY", "PrintState", "Step", "format_number"]

_MAX_RECENT_STEPS: Final = 256
"""Number of commands kept: more than the planner of any Marlin-like firmware holds, with commands between moves."""

_STICKY_COMMANDS: Final = find_codes(Effect.STICKY)
"""Settings that a resume restores; without SET_GCODE_OFFSET, because the nozzle height already contains baby steps."""

_WAITS: Final = find_codes(Effect.WAITS)
_MESH_COMMANDS: Final = frozenset({b"BED_MESH_PROFILE", b"BED_MESH_CALIBRATE"})


def format_number(value: float) -> bytes:
    """Format a number for G-code."""
    return texts.format_number(value).encode()


SCRIPT_ENTRY: Final = -2
"""Entry number of a command from a script of the host; later commands depend on it."""


class Step(NamedTuple):
    """A command, and the state of the printer before and after it.

    Attributes:
        entry: index in the job; SCRIPT_ENTRY: from a script of the host; -1: from a user.
        before, after: state.
        command: the command.
        origin: offset of the coordinates of the program from those of the machine after the command, mm.
    """

    entry: int
    before: ModalState
    after: ModalState
    command: bytes
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def loses_position(self) -> bool:
        """Return whether the command leads from a known position to an unknown one."""
        return self.before.known and not self.after.known


class PrintState:
    """State of a print, which `follow` updates by each command that is sent.

    Args:
        flavour: G-code flavour of the firmware.

    Attributes:
        machine: machine state.
        modal: position and modes.
        mesh: command that switches bed mesh compensation on; empty if it is off.
        sticky: name of a persistent setting -> command that restores it, and whether the command is in inches.
        recent: the last moves, which may still be waiting for execution, and the commands between them.
    """

    def __init__(self, flavour: str = "marlin") -> None:
        self.machine = MachineState(flavour)
        self.modal = self.machine.modal
        self.mesh = b""
        self.sticky: dict[bytes, tuple[bytes, bool]] = {}
        self.recent: deque[Step] = deque(maxlen=_MAX_RECENT_STEPS)
        self._highest_z: float | None = None
        self._bounding_box: tuple[float, float, float, float] | None = None
        self._frames = self.machine.frames

    @property
    def highest_z(self) -> float | None:
        """Highest z of any extrusion, in current coordinates; None if there is none or it is unknown."""
        return None if self._highest_z is None else self._highest_z + self.machine.shift[2]

    @property
    def bounding_box(self) -> tuple[float, float, float, float] | None:
        """Bounding box (x min, y min, x max, y max) of all extrusion in current coordinates; None if unknown."""
        if self._bounding_box is None:
            return None
        (low_x, low_y, high_x, high_y), (x, y, _) = self._bounding_box, self.machine.shift
        return low_x + x, low_y + y, high_x + x, high_y + y

    def fork(self) -> PrintState:
        """Return an independent copy of the state, whose list of recent moves is empty."""
        other = copy(self)
        other.machine = self.machine.fork()
        other.sticky = dict(self.sticky)
        other.recent = deque(maxlen=_MAX_RECENT_STEPS)
        return other

    @property
    def has_comparable_positions(self) -> bool:
        """Return whether the positions of all recent moves are known in the current coordinates."""
        shift = self.machine.shift
        return self.modal.known and all(
            step.origin == shift and not step.loses_position for step in self.recent
        )

    def stop_at(self, modal: ModalState) -> None:
        """Record that the machine stopped during a move, at the position in `modal`."""
        self.machine.set_stop_position(modal.x, modal.y, modal.z)
        self.modal = self.machine.modal

    def follow(self, command: bytes, entry: int = -1) -> None:
        """Update the state by a command; `entry` is its job index, or -1 (user), or SCRIPT_ENTRY (host)."""
        command = strip(command)
        word, values = parse(command)
        before = self.modal
        moved = self.machine.apply(word, values, command) is not None
        self.modal = self.machine.modal
        if self.machine.frames != self._frames:
            self._forget_extent()
        if moved:
            self._record_extent(before)
        elif word:
            self._record_setting(word, values, command)
            if entry >= 0 and word in _WAITS:
                self.recent.clear()
        else:
            self._record_extended_setting(command)
        if moved or entry != -1:
            begin = before if moved else self.modal
            self.recent.append(Step(entry, begin, self.modal, command, self.machine.shift))

    def _forget_extent(self) -> None:
        """Discard the extent of the part on axes whose origin is now unknown."""
        previous, self._frames = self._frames, self.machine.frames
        if previous[2] != self._frames[2]:
            self._highest_z = None
        if previous[:2] != self._frames[:2]:
            self._bounding_box = None

    def _record_extent(self, before: ModalState) -> None:
        """Add a move to the extent of the part if it extrudes."""
        after = self.modal
        if after.e > before.e and after.z is not None and (after.x, after.y) != (before.x, before.y):
            z = after.z - self.machine.shift[2]
            self._highest_z = z if self._highest_z is None else max(self._highest_z, z)
            self._extend_box(before)
            self._extend_box(after)

    def _extend_box(self, modal: ModalState) -> None:
        """Extend the bounding box so that it contains a position."""
        if modal.x is None or modal.y is None:
            return
        x, y = modal.x - self.machine.shift[0], modal.y - self.machine.shift[1]
        low_x, low_y, high_x, high_y = self._bounding_box or (x, y, x, y)
        if self._bounding_box is None or not (low_x < x < high_x and low_y < y < high_y):
            self._bounding_box = min(low_x, x), min(low_y, y), max(high_x, x), max(high_y, y)

    def _record_setting(self, word: bytes, values: dict[bytes, float], command: bytes) -> None:
        """Record a command if it changes the bed mesh or a persistent setting."""
        if word == b"G29":
            self.mesh = b"M420 S1"
        elif word == b"M420" and (b"S" in values or b"Z" in values):
            self.mesh = command if values.get(b"S", 1.0) else b""
        if word in _STICKY_COMMANDS:
            self.sticky[word + b"".join(sorted(values))] = command, self.machine.inches

    def _record_extended_setting(self, command: bytes) -> None:
        """Record a Klipper command if it changes the bed mesh or a persistent setting."""
        name, _ = parse_extended_command(command)
        if name in _STICKY_COMMANDS:
            self.sticky[name] = command, False
        elif name in _MESH_COMMANDS:
            # A measured mesh can be restored only by its name.
            self.mesh = command if b"LOAD" in command.upper() else b"BED_MESH_PROFILE LOAD=default"
