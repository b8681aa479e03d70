"""What a machine knows after a command: units, modes, place, origin, tool, temperatures; in plain Python.

Followed command by command in the order in which the printer gets them. All lengths are mm, whatever unit the program
counts in. What a command makes unknown (homing, another coordinate system) stays unknown until a command says it
again, so nothing that is done with it rests on a guess.

logical coordinate = coordinate of the machine + offset (G92, M206), as Marlin and RepRapFirmware have it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from copy import copy
from dataclasses import dataclass
from math import hypot, pi
from typing import ClassVar, Final, NamedTuple, TypeAlias

from printer_slicer.gcode.commands import (
    COUNTING_CODES,
    HOME_OFFSET,
    MACHINE_COORDINATES,
    MOVES,
    MOVES_UNSEEN,
    OTHER_COORDINATES,
)
from printer_slicer.gcode.lexer import letters, parse
from printer_slicer.motion.counting import COUNTING, Counting

__all__ = ["MachineState", "ModalState", "Move", "Place"]

Place: TypeAlias = tuple[float | None, float | None, float | None, float | None]
"""x, y, z, e in mm; None where it is not known."""

_AXES: Final = (b"X", b"Y", b"Z", b"E")
_INCH: Final = 25.4


class Move(NamedTuple):
    """One motion command: travel of x, y, z, e and wanted speed (0 if none was named yet), mm and mm/s.

    An arc counts as if it were unrolled along x, at the length of its full circle: an upper bound.
    """

    delta: tuple[float, float, float, float]
    speed: float


@dataclass(frozen=True, slots=True)
class ModalState:
    """Where and how the machine stands between two commands. Lengths mm, speeds mm/s.

    Attributes:
        x, y, z: logical place; None where it is not known.
        e: filament as the program counts it.
        relative, relative_e: whether x, y, z, and e, count from where they are.
        extruder: what M82 or M83 must say so that it is as it was.
        speed: asked for last, 0 for never.
        retracted: whether the firmware has pulled back (G10).
        pulled: mm of filament that are pulled back by E.
        inches: the program counts in inches (G20).
    """

    x: float | None = None
    y: float | None = None
    z: float | None = None
    e: float = 0.0
    relative: bool = False
    relative_e: bool = False
    extruder: bool = False
    speed: float = 0.0
    retracted: bool = False
    pulled: float = 0.0
    inches: bool = False

    @property
    def known(self) -> bool:
        """Whether the place is known."""
        return self.x is not None and self.y is not None and self.z is not None

    @property
    def place(self) -> tuple[float, float, float]:
        """x, y, z; what is not known counts as 0."""
        return self.x or 0.0, self.y or 0.0, self.z or 0.0

    @property
    def unit(self) -> float:
        """Mm in a unit of the program."""
        return _INCH if self.inches else 1.0


class MachineState:
    """Follows commands.

    Args:
        flavour: of the firmware, which decides how it reads some of them.

    Attributes:
        unit: mm in a unit of the program.
        counting: whether its numbers count from where the machine is.
        speed: mm/s asked for last, 0 for never.
        retracted: whether G10 was the last of G10 and G11.
        pulled: mm of filament that are pulled back by E.
        tool: number of the tool in use.
        tool_command: what selected it, empty for nothing.
        hotends: tool -> wanted °C.
        bed, chamber: wanted °C.
        shift: mm by which logical x, y and z are higher than in the present frame; see `frames`.
        frames: of x, y, z: goes up when an axis begins to count from an origin whose place is not known against the
            one before. Places of two commands can be compared where their frame is the same.
    """

    __slots__ = (
        *("_anchored", "_e_told", "_home_offset", "_next_unseen", "_position"),
        *("bed", "chamber", "counting", "flavour", "frames", "hotends", "pulled", "retracted", "shift"),
        *("speed", "tool", "tool_command", "unit"),
    )

    def __init__(self, flavour: str = "marlin") -> None:
        self.flavour = flavour
        self.unit = 1.0
        self.counting = Counting(COUNTING[flavour])
        self.speed = self.pulled = self.bed = self.chamber = 0.0
        self.retracted = False
        self.tool, self.tool_command = 0, b""
        self.hotends: dict[int, float] = {}
        self.shift, self.frames = (0.0, 0.0, 0.0), (0, 0, 0)
        self._position: list[float | None] = [None, None, None, 0.0]
        self._e_told = False  # 0 is a guess that is good enough for lengths, but no place
        self._home_offset = (0.0, 0.0, 0.0)
        self._anchored = (True, True, True)
        self._next_unseen = False

    def fork(self) -> MachineState:
        """Another one that goes on from here by itself."""
        other = copy(self)
        other._position = list(self._position)  # noqa: SLF001 - of its own kind
        other.hotends = dict(self.hotends)
        return other

    @property
    def place(self) -> Place:
        """Where the motion so far ends: x, y, z and e as the program counts it, mm; None where it is not known."""
        x, y, z, e = self._position
        return (x, y, z, e if self._e_told else None)

    @property
    def position(self) -> tuple[float | None, float | None, float | None]:
        """The same without e."""
        x, y, z, _ = self._position
        return (x, y, z)

    @property
    def offset(self) -> tuple[float | None, float | None, float | None]:
        """Mm by which logical x, y and z are higher than the machine's; None where that is not known."""
        x, y, z = (
            shift if anchored else None for shift, anchored in zip(self.shift, self._anchored, strict=True)
        )
        return (x, y, z)

    @property
    def home_offset(self) -> tuple[float, float, float]:
        """What M206 has set, mm."""
        return self._home_offset

    @property
    def hotend(self) -> float:
        """Wanted °C of the tool in use."""
        return self.hotends.get(self.tool, 0.0)

    @property
    def inches(self) -> bool:
        """Whether the program counts in inches."""
        return self.unit != 1.0

    @property
    def modal(self) -> ModalState:
        """How the machine stands now."""
        x, y, z, e = self._position
        counting = self.counting
        return ModalState(
            *(x, y, z, e or 0.0, counting.axes, counting.e, counting.extruder),
            *(self.speed, self.retracted, self.pulled, self.inches),
        )

    def relative(self, values: Mapping[bytes, float]) -> bool:
        """Whether one of the axes in `values` is counted from where it is, so that a move twice is not a move once."""
        return any(self._from_here(axis) for axis, letter in enumerate(_AXES) if letter in values)

    def speak(self, flavour: str) -> None:
        """The firmware is known now, and with it how it reads what firmwares read differently."""
        self.flavour = flavour
        self.counting = self.counting._replace(rule=COUNTING[flavour])

    def move_to(self, x: float | None, y: float | None, z: float | None) -> None:
        """The machine stopped at a logical place, mm, that no command names."""
        self._position[:3] = [x, y, z]

    def lose_place(self) -> None:
        """Something moved the machine, and did not say where to."""
        self._position[:3] = [None, None, None]

    def follow(self, command: bytes) -> Move | None:
        """The move that a command makes, None for any other command."""
        word, values = parse(command)
        return self.apply(word, values, command)

    def apply(self, word: bytes, values: Mapping[bytes, float], command: bytes = b"") -> Move | None:
        """The same for a command that was parsed already."""
        if word in MOVES:
            return self._move(word, values)
        if word == b"G53":
            return self._move_in_machine_coordinates(values)
        if (action := self._ACTIONS.get(word)) is not None:
            action(self, word, values, command)
        elif word in COUNTING_CODES:
            self.counting = self.counting.after(word.decode())
        elif word in MOVES_UNSEEN:
            self.lose_place()
        elif word in OTHER_COORDINATES:
            self._lose_origin()
        elif word[:1] == b"T":
            self.tool, self.tool_command = int(word[1:]), command.strip()
        return None

    def _from_here(self, axis: int) -> bool:
        return self.counting.e if axis == 3 else self.counting.axes

    def _move(self, word: bytes, values: Mapping[bytes, float]) -> Move:
        unit, position = self.unit, self._position
        feed = values.get(b"F", 0.0)
        if feed > 0.0:
            self.speed = feed * unit / 60
        relative, relative_e = self.counting.axes, self.counting.e
        delta = [0.0, 0.0, 0.0, 0.0]
        for axis, letter in enumerate(_AXES):
            value = values.get(letter)
            if value is None:
                continue
            value *= unit
            here = position[axis]
            if relative_e if axis == 3 else relative:
                delta[axis] = value
                position[axis] = None if here is None else here + value
            else:
                # From an unknown place: the distance from zero is as good a guess of the length as any.
                delta[axis] = value - (here or 0.0)
                position[axis] = value
                self._e_told = self._e_told or axis == 3
        if delta[3]:
            self.pulled = max(self.pulled - delta[3], 0.0)
        if word in {b"G2", b"G3"}:
            radius = values.get(b"R") or hypot(values.get(b"I", 0.0), values.get(b"J", 0.0))
            delta[:2] = [max(hypot(*delta[:2]), 2 * pi * abs(radius * unit)), 0.0]
        if self._next_unseen:
            self._next_unseen = False
            self._forget(values)
        x, y, z, e = delta
        return Move((x, y, z, e), self.speed)

    def _forget(self, named: Iterable[bytes]) -> None:
        """A move went to a place that nobody here can tell, along the axes with these letters."""
        for letter in named:
            if letter in _AXES[:3]:
                self._position[_AXES.index(letter)] = None

    def _move_in_machine_coordinates(self, values: Mapping[bytes, float]) -> Move | None:
        """G53 in front of a move; alone it means the next one, or selects these coordinates for good."""
        if b"G" not in values:
            self._lose_origin()
            self._next_unseen = True
            return None
        word = b"G%d" % values[b"G"]
        if word not in MOVES:
            return None
        move = self._move(word, values)
        if self.flavour not in MACHINE_COORDINATES:
            self._forget(values)  # most builds do not know the command, and do nothing
        elif not self.counting.axes:
            self._forget(
                letter
                for axis, letter in enumerate(_AXES[:3])
                if letter in values and not self._anchored[axis]
            )
            for axis, letter in enumerate(_AXES[:3]):
                at = self._position[axis]
                if letter in values and at is not None:
                    self._position[axis] = at + self.shift[axis]
        return move

    def _lose_origin(self) -> None:
        """The origin is somewhere else now, nobody knows where."""
        self.lose_place()
        for axis in range(3):
            self._set_origin(axis, 0.0, anchored=False)

    def _set_origin(self, axis: int, shift: float, *, anchored: bool) -> None:
        """Another origin for one axis; its frame ends unless both are known against the machine."""
        frames, anchors = list(self.frames), list(self._anchored)
        frames[axis] += not (anchored and anchors[axis])
        anchors[axis] = anchored
        self.frames = (frames[0], frames[1], frames[2])
        self._anchored = (anchors[0], anchors[1], anchors[2])
        self._shift_origin(axis, shift - self.shift[axis])

    def _shift_origin(self, axis: int, by: float) -> None:
        """The same origin, moved by so much."""
        x, y, z = (shift + by * (axis == at) for at, shift in enumerate(self.shift))
        self.shift = (x, y, z)

    def _set_position(self, _word: bytes, values: Mapping[bytes, float], _command: bytes) -> None:
        """G92: the same place under other numbers."""
        if b"E" in values:
            self._position[3] = values[b"E"] * self.unit
            self._e_told = True
        for axis, letter in enumerate(_AXES[:3]):
            if letter not in values:
                continue
            here, new = self._position[axis], values[letter] * self.unit
            self._position[axis] = new
            if here is None:
                self._set_origin(axis, 0.0, anchored=False)
            else:
                self._shift_origin(axis, new - here)

    def _home(self, _word: bytes, _values: Mapping[bytes, float], command: bytes) -> None:
        """G28: the axes that are named, or all, stand at their endstops, without G92; where these are, nobody says."""
        named = letters(command)
        axes = [axis for axis, letter in enumerate(_AXES[:3]) if letter in named] or [0, 1, 2]
        for axis in axes:
            self._position[axis] = None
            self._set_origin(axis, self._home_offset[axis], anchored=True)

    def _offset_home(self, _word: bytes, values: Mapping[bytes, float], _command: bytes) -> None:
        """M206: the endstops are so much farther on than the program thinks."""
        when = HOME_OFFSET[self.flavour]
        if when == "never":
            return
        new = list(self._home_offset)
        for axis, letter in enumerate(_AXES[:3]):
            if letter not in values:
                continue
            if when == "when homed":
                self._set_origin(axis, self.shift[axis], anchored=False)
                continue
            offset = values[letter] * self.unit
            by, new[axis] = offset - new[axis], offset
            here = self._position[axis]
            self._position[axis] = None if here is None else here + by
            self._shift_origin(axis, by)
        self._home_offset = (new[0], new[1], new[2])

    def _retract(self, word: bytes, values: Mapping[bytes, float], _command: bytes) -> None:
        """G10 and G11, and what RepRapFirmware makes of G10 with letters: temperatures of a tool, origins."""
        if not values:
            self.retracted = word == b"G10"
        elif word == b"G10" and b"L" in values:
            self._lose_origin()
        elif word == b"G10" and b"P" in values and b"S" in values:
            self.hotends[int(values[b"P"])] = values[b"S"]

    def _heat(self, word: bytes, values: Mapping[bytes, float], _command: bytes) -> None:
        """M104 and M109, M140 and M190, M141 and M191."""
        wanted = values.get(b"S", values.get(b"R"))
        if wanted is None:
            return
        if word in {b"M104", b"M109"}:
            self.hotends[int(values.get(b"T", self.tool))] = wanted
        elif word in {b"M140", b"M190"}:
            self.bed = wanted
        else:
            self.chamber = wanted

    def _set_unit(self, word: bytes, _values: Mapping[bytes, float], _command: bytes) -> None:
        """G20 and G21."""
        self.unit = _INCH if word == b"G20" else 1.0

    _ACTIONS: ClassVar[
        Mapping[bytes, Callable[[MachineState, bytes, Mapping[bytes, float], bytes], None]]
    ] = {
        **dict.fromkeys((b"G10", b"G11"), _retract),
        **dict.fromkeys((b"G20", b"G21"), _set_unit),
        b"G28": _home,
        b"G92": _set_position,
        b"M206": _offset_home,
        **dict.fromkeys((b"M104", b"M109", b"M140", b"M190", b"M141", b"M191"), _heat),
    }
