"""Track the state of a machine command by command: units, modes, position, origin, tool, temperatures.

Commands are processed in the order in which the printer receives them. All lengths are mm, whatever unit the program
uses. A value that a command makes unknown (homing, another coordinate system) stays unknown until a command sets it
again, so nothing depends on a guess.

logical coordinate = machine coordinate + offset (G92, M206), as in Marlin and RepRapFirmware.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from copy import copy
from math import hypot, pi
from typing import ClassVar, Final, NamedTuple, TypeAlias

from printer_slicer.firmware import FLAVOURS
from printer_slicer.gcode.commands import (
    TABLE,
    Effect,
    HeaterName,
    find_codes,
)
from printer_slicer.gcode.lexer import find_letters, parse
from printer_slicer.motion.positioning_mode import PositioningMode
from printer_slicer.values import Struct

__all__ = [
    "FULL_FAN_SPEED",
    "HeaterTarget",
    "MachineState",
    "ModalState",
    "Move",
    "Place",
    "find_heater_target",
    "uses_inches",
]

Place: TypeAlias = tuple[float | None, float | None, float | None, float | None]
"""x, y, z, e in mm; None where unknown."""

_AXES: Final = (b"X", b"Y", b"Z", b"E")
_INCH: Final = 25.4
_INCHES: Final = b"G20"
_MOVES: Final = find_codes(Effect.MOVES)
_ARCS: Final = find_codes(Effect.ARC)
_MODES: Final = find_codes(Effect.MODE)
_MOVES_UNSEEN: Final = find_codes(Effect.MOVES_UNSEEN)
_MOVES_ORIGIN: Final = find_codes(Effect.MOVES_ORIGIN)
_TOOL_BY_P: Final = frozenset({b"G10", b"M568"})  # commands whose P, and not T, names a tool
FULL_FAN_SPEED: Final = 255.0
"""S of `M106` for full speed."""


class Move(NamedTuple):
    """One motion command: distance in x, y, z, e, mm, and feed rate, mm/s (0 if none was set yet).

    An arc counts as a line along x with the length of its full circle: an upper bound.
    """

    delta: tuple[float, float, float, float]
    speed: float


class HeaterTarget(NamedTuple):
    """A target temperature, °C, and the heater that it is for; `tool` None means the active tool."""

    heater: HeaterName
    tool: int | None
    celsius: float


def find_heater_target(word: bytes, values: Mapping[bytes, float]) -> HeaterTarget | None:
    """Return the target temperature that a parsed command sets; None if it sets none.

    G10 with a tool sets a target in RepRapFirmware. R is a target only if the command waits for it.
    """
    row, tool = TABLE.get(word), values.get(b"T")
    if row is None or not values:
        return None
    heater, celsius = row.heater, values.get(b"S")
    if Effect.RETRACTS in row.effect:
        heater = "nozzle" if b"P" in values else None
    if heater is None:
        return None
    if celsius is None and Effect.WAITS_FOR_HEAT in row.effect:
        celsius = values.get(b"R")
    if word in _TOOL_BY_P:
        tool = values.get(b"P")
    return None if celsius is None else HeaterTarget(heater, None if tool is None else int(tool), celsius)


def _compute_circle_length(values: Mapping[bytes, float], delta: Sequence[float]) -> float | None:
    """Return the length of the full circle of an arc, in units of the program; None if the arc has no centre.

    Firmware rejects an arc with R0, with R and no distance between start and end, or without I and J (Marlin's
    G2_G3.cpp).
    """
    if b"R" in values:
        radius = abs(values[b"R"]) if delta[0] or delta[1] else 0.0
    else:
        radius = hypot(values.get(b"I", 0.0), values.get(b"J", 0.0))
    return 2 * pi * radius or None


def uses_inches(commands: Iterable[bytes]) -> bool:
    """Return whether one of the commands switches to inches."""
    return any(b"20" in command[:6] and parse(command)[0] == _INCHES for command in commands)


class ModalState(Struct, frozen=True):
    """Position and modes between two commands, in mm and mm/s.

    Attributes:
        x, y, z: logical position; None where unknown.
        e: logical extruder position.
        relative, relative_e: whether x, y, z, and e, are relative.
        extruder: whether M83, and not M82, restores the mode of the extruder.
        speed: last feed rate, 0 if none.
        retracted: whether firmware retraction (G10) is active.
        pulled: filament retracted by E moves, mm.
        inches: whether the program uses inches (G20).
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
        """Whether the position is known."""
        return self.x is not None and self.y is not None and self.z is not None

    @property
    def place(self) -> tuple[float, float, float]:
        """x, y, z; unknown coordinates are 0."""
        return self.x or 0.0, self.y or 0.0, self.z or 0.0

    @property
    def unit(self) -> float:
        """Length of a unit of the program, mm."""
        return _INCH if self.inches else 1.0


class MachineState:
    """Tracks the state of a machine command by command, in plain Python.

    Args:
        flavour: determines how the firmware reads some commands.

    Attributes:
        unit: length of a unit of the program, mm.
        counting: absolute or relative mode of the axes and the extruder.
        speed: last feed rate, mm/s; 0 if none.
        retracted: whether firmware retraction (G10) is active.
        pulled: filament retracted by E moves, mm.
        tool: active tool.
        tool_command: the command that selected it; empty if none.
        hotends: tool -> target, °C.
        bed, chamber: targets, °C.
        fan: part fan, 0 to 255.
        fans: other fans: number -> command that set it last.
        shift: logical x, y and z minus those in the current frame, mm; see `frames`.
        frames: number of the frame of x, y, z; it increases when the origin of an axis moves by an unknown amount.
            Positions of two commands are comparable only within the same frame.
    """

    __slots__ = (
        *("_anchored", "_e_known", "_home_offset", "_next_unseen", "_position"),
        *("bed", "chamber", "counting", "fan", "fans", "flavour", "frames", "hotends", "pulled", "retracted"),
        *("shift", "speed", "tool", "tool_command", "unit"),
    )

    def __init__(self, flavour: str = "marlin") -> None:
        self.flavour = flavour
        self.unit = 1.0
        self.counting = PositioningMode(FLAVOURS[flavour].counting)
        self.speed = self.pulled = self.bed = self.chamber = self.fan = 0.0
        self.fans: dict[float, bytes] = {}
        self.retracted = False
        self.tool, self.tool_command = 0, b""
        self.hotends: dict[int, float] = {}
        self.shift, self.frames = (0.0, 0.0, 0.0), (0, 0, 0)
        self._position: list[float | None] = [None, None, None, 0.0]
        self._e_known = False  # 0 is good enough for lengths, but not a known position
        self._home_offset = (0.0, 0.0, 0.0)
        self._anchored = (True, True, True)
        self._next_unseen = False

    def fork(self) -> MachineState:
        """Return an independent copy."""
        other = copy(self)
        other._position = list(self._position)  # noqa: SLF001 - of its own kind
        other.hotends, other.fans = dict(self.hotends), dict(self.fans)
        return other

    @property
    def place(self) -> Place:
        """Logical position after all motion so far: x, y, z, e, mm; None where unknown."""
        x, y, z, e = self._position
        return (x, y, z, e if self._e_known else None)

    @property
    def position(self) -> tuple[float | None, float | None, float | None]:
        """Logical x, y, z, mm; None where unknown."""
        x, y, z, _ = self._position
        return (x, y, z)

    @property
    def offset(self) -> tuple[float | None, float | None, float | None]:
        """Logical minus machine coordinates of x, y and z, mm; None where unknown."""
        x, y, z = (
            shift if anchored else None for shift, anchored in zip(self.shift, self._anchored, strict=True)
        )
        return (x, y, z)

    @property
    def home_offset(self) -> tuple[float, float, float]:
        """Home offset set by M206, mm."""
        return self._home_offset

    @property
    def hotend(self) -> float:
        """Target temperature of the active tool, °C."""
        return self.hotends.get(self.tool, 0.0)

    @property
    def inches(self) -> bool:
        """Whether the program uses inches."""
        return self.unit != 1.0

    @property
    def modal(self) -> ModalState:
        """The current position and modes."""
        x, y, z, e = self._position
        counting = self.counting
        return ModalState(
            *(
                x,
                y,
                z,
                e or 0.0,
                counting.has_relative_axes,
                counting.has_relative_e,
                counting.has_relative_extruder,
            ),
            *(self.speed, self.retracted, self.pulled, self.inches),
        )

    def is_relative(self, values: Mapping[bytes, float]) -> bool:
        """Return whether one of the axes in `values` is relative, so that repeating the move would move it again."""
        return any(self._is_relative_axis(axis) for axis, letter in enumerate(_AXES) if letter in values)

    def set_flavour(self, flavour: str) -> None:
        """Set the flavour once the firmware is known."""
        self.flavour = flavour
        self.counting = self.counting._replace(rule=FLAVOURS[flavour].counting)

    def set_stop_position(self, x: float | None, y: float | None, z: float | None) -> None:
        """Set the logical position, mm, at which the machine stopped."""
        self._position[:3] = [x, y, z]

    def forget_position(self) -> None:
        """Mark the position as unknown."""
        self._position[:3] = [None, None, None]

    def follow(self, command: bytes) -> Move | None:
        """Process a command; return its move, or None if it is not a move."""
        word, values = parse(command)
        return self.apply(word, values, command)

    def apply(self, word: bytes, values: Mapping[bytes, float], command: bytes = b"") -> Move | None:
        """Process a parsed command; return its move, or None if it is not a move."""
        if word in _MOVES:
            return self._apply_move(word, values)
        if word == b"G53":
            return self._move_in_machine_coordinates(values)
        if (action := self._ACTIONS.get(word)) is not None:
            action(self, word, values, command)
        elif word in _MODES:
            self.counting = self.counting.with_command(word.decode())
        elif word in _MOVES_UNSEEN:
            self.forget_position()
        elif word in _MOVES_ORIGIN:
            self._forget_origin()
        elif word[:1] == b"T":
            self.tool, self.tool_command = int(word[1:]), command.strip()
        return None

    def _is_relative_axis(self, axis: int) -> bool:
        """Return whether an axis (0 to 3 for x, y, z, e) is in relative mode."""
        return self.counting.has_relative_e if axis == 3 else self.counting.has_relative_axes

    def _apply_move(self, word: bytes, values: Mapping[bytes, float]) -> Move:
        """G0 to G3: update the position, and return the move."""
        unit, position = self.unit, self._position
        feed = values.get(b"F", 0.0)
        if feed > 0.0:
            self.speed = feed * unit / 60
        relative, relative_e = self.counting.has_relative_axes, self.counting.has_relative_e
        goal, delta = list(position), [0.0, 0.0, 0.0, 0.0]
        for axis, letter in enumerate(_AXES):
            value = values.get(letter)
            if value is None:
                continue
            value *= unit
            here = position[axis]
            if relative_e if axis == 3 else relative:
                delta[axis] = value
                goal[axis] = None if here is None else here + value
            else:
                # From an unknown position, the distance from zero is only a guess of the length.
                delta[axis] = value - (here or 0.0)
                goal[axis] = value
        # Firmware rejects an arc that ends at its start. From an unknown position this cannot be decided.
        doubtful = word in _ARCS and b"R" in values and None in position[:2] and not relative
        if word in _ARCS:
            turn = _compute_circle_length(values, delta)
            if turn is None and not doubtful:
                return Move((0.0, 0.0, 0.0, 0.0), self.speed)
            delta[:2] = [max(hypot(*delta[:2]), (turn or 0.0) * unit), 0.0]
        self._position = goal
        self._e_known = (self._e_known or (b"E" in values and not relative_e)) and not doubtful
        if doubtful:
            self._forget_axes(values)
        if delta[3]:
            self.pulled = max(self.pulled - delta[3], 0.0)
        if self._next_unseen:
            self._next_unseen = False
            self._forget_axes(values)
        x, y, z, e = delta
        return Move((x, y, z, e), self.speed)

    def _forget_axes(self, named: Iterable[bytes]) -> None:
        """Mark the position along these axes as unknown."""
        for letter in named:
            if letter in _AXES[:3]:
                self._position[_AXES.index(letter)] = None

    def _move_in_machine_coordinates(self, values: Mapping[bytes, float]) -> Move | None:
        """Apply G53: its move is in machine coordinates; without a move, G53 applies to the next move or to all."""
        if b"G" not in values:
            self._forget_origin()
            self._next_unseen = True
            return None
        word = b"G%d" % values[b"G"]
        if word not in _MOVES:
            return None
        move = self._apply_move(word, values)
        if not FLAVOURS[self.flavour].machine_coordinates:
            self._forget_axes(values)  # most builds do not support the command and ignore it
        elif not self.counting.has_relative_axes:
            self._forget_axes(
                letter
                for axis, letter in enumerate(_AXES[:3])
                if letter in values and not self._anchored[axis]
            )
            for axis, letter in enumerate(_AXES[:3]):
                at = self._position[axis]
                if letter in values and at is not None:
                    self._position[axis] = at + self.shift[axis]
        return move

    def _forget_origin(self) -> None:
        """Mark the origin as unknown."""
        self.forget_position()
        for axis in range(3):
            self._set_origin(axis, 0.0, anchored=False)

    def _set_origin(self, axis: int, shift: float, *, anchored: bool) -> None:
        """Set the origin of one axis; start a new frame unless old and new origin are known in machine coordinates."""
        frames, anchors = list(self.frames), list(self._anchored)
        frames[axis] += not (anchored and anchors[axis])
        anchors[axis] = anchored
        self.frames = (frames[0], frames[1], frames[2])
        self._anchored = (anchors[0], anchors[1], anchors[2])
        self._shift_origin(axis, shift - self.shift[axis])

    def _shift_origin(self, axis: int, by: float) -> None:
        """Move the origin of one axis."""
        x, y, z = (shift + by * (axis == at) for at, shift in enumerate(self.shift))
        self.shift = (x, y, z)

    def _set_position(self, _word: bytes, values: Mapping[bytes, float], _command: bytes) -> None:
        """G92: set the coordinates of the current position without moving."""
        if b"E" in values:
            self._position[3] = values[b"E"] * self.unit
            self._e_known = True
        for axis, letter in enumerate(_AXES[:3]):
            if letter not in values:
                continue
            here, new = self._position[axis], values[letter] * self.unit
            self._position[axis] = new
            if here is None:
                self._set_origin(axis, 0.0, anchored=False)
            else:
                self._shift_origin(axis, new - here)

    def _home_axes(self, _word: bytes, _values: Mapping[bytes, float], command: bytes) -> None:
        """G28: the named axes, or all, lose the offset of G92; their position at the endstops is unknown."""
        named = find_letters(command)
        axes = [axis for axis, letter in enumerate(_AXES[:3]) if letter in named] or [0, 1, 2]
        for axis in axes:
            self._position[axis] = None
            self._set_origin(axis, self._home_offset[axis], anchored=True)

    def _apply_home_offset(self, _word: bytes, values: Mapping[bytes, float], _command: bytes) -> None:
        """M206: set the home offset."""
        when = FLAVOURS[self.flavour].home_offset
        if when == "never":
            return
        new = list(self._home_offset)
        for axis, letter in enumerate(_AXES[:3]):
            if letter not in values:
                continue
            if when == "when homed":  # Smoothieware takes it in mm even after G20 (Endstops.cpp)
                new[axis] = values[letter]
                continue
            offset = values[letter] * self.unit
            by, new[axis] = offset - new[axis], offset
            here = self._position[axis]
            self._position[axis] = None if here is None else here + by
            self._shift_origin(axis, by)
        self._home_offset = (new[0], new[1], new[2])

    def _apply_retraction(self, word: bytes, values: Mapping[bytes, float], command: bytes) -> None:
        """G10 and G11: retract or deretract; in RepRapFirmware, G10 with letters sets tool temperatures and origins."""
        if not values:
            self.retracted = word == b"G10"
        elif word == b"G10" and b"L" in values:
            self._forget_origin()
        else:
            self._set_heater_target(word, values, command)

    def _set_heater_target(self, word: bytes, values: Mapping[bytes, float], _command: bytes) -> None:
        """M104, M140 and others: set the target of a heater."""
        target = find_heater_target(word, values)
        if target is None or (word in _TOOL_BY_P and not FLAVOURS[self.flavour].tool_temperatures):
            return
        if target.heater == "nozzle":
            self.hotends[self.tool if target.tool is None else target.tool] = target.celsius
        elif target.heater == "bed":
            self.bed = target.celsius
        else:
            self.chamber = target.celsius

    def _set_fan(self, word: bytes, values: Mapping[bytes, float], command: bytes) -> None:
        """M106 and M107: set the speed of a fan."""
        if number := values.get(b"P", 0.0):
            self.fans[number] = command
        else:
            self.fan = values.get(b"S", FULL_FAN_SPEED) if word == b"M106" else 0.0

    def _select_unit(self, word: bytes, _values: Mapping[bytes, float], _command: bytes) -> None:
        """G20 and G21: switch to inches or mm."""
        self.unit = _INCH if word == _INCHES else 1.0

    _ACTIONS: ClassVar[
        Mapping[bytes, Callable[[MachineState, bytes, Mapping[bytes, float], bytes], None]]
    ] = {
        **dict.fromkeys(find_codes(Effect.RETRACTS), _apply_retraction),
        **dict.fromkeys(find_codes(Effect.UNITS), _select_unit),
        **dict.fromkeys(find_codes(Effect.HOMES), _home_axes),
        **dict.fromkeys(find_codes(Effect.SETS_POSITION), _set_position),
        **dict.fromkeys(find_codes(Effect.SETS_HOME_OFFSET), _apply_home_offset),
        **dict.fromkeys(find_codes(Effect.FAN), _set_fan),
        **dict.fromkeys((code for code, row in TABLE.items() if row.heater), _set_heater_target),
    }
