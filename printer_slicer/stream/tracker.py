"""Where the commands lead: enough of G-code to know how long a move is and where the job ends.

mm, and x, y, z, e. What a command makes unknown (homing, another coordinate system) stays unknown until a
command says it again, so a comparison with the printer's own report never rests on a guess.
"""

from __future__ import annotations

import re
from math import hypot, pi
from typing import TYPE_CHECKING, Final, NamedTuple, TypeAlias

from printer_slicer.motion.counting import Counting

if TYPE_CHECKING:
    from printer_slicer.motion.counting import Rule
    from printer_slicer.stream.events import Spot

__all__ = ["MOVES_UNSEEN", "Move", "Place", "Tracker", "is_macro", "parse"]

Place: TypeAlias = tuple[float | None, float | None, float | None, float | None]
"""x, y, z, e in mm; None where it is not known."""

_NOWHERE: Final[Place] = (None, None, None, None)

_WORD: Final = re.compile(rb"([GMT])\s*(\d+)")
_VALUE: Final = re.compile(rb"([A-Z])\s*([-+]?(?:\d+\.?\d*|\.\d+))")
_AXES: Final = (b"X", b"Y", b"Z", b"E")
_MOVES: Final = frozenset({b"G0", b"G1", b"G2", b"G3"})
_COUNTING: Final = frozenset({b"G90", b"G91", b"M82", b"M83"})
MOVES_UNSEEN: Final = frozenset(
    {
        b"G5",
        b"G12",
        b"G26",
        b"G27",
        b"G28",
        b"G29",
        b"G30",
        b"G32",
        b"G33",
        b"G34",
        b"G35",
        b"G38",
        b"G42",
        b"G61",
    }
    | {b"G76", b"G80", b"G425", b"M48", b"M98", b"M125", b"M701", b"M702"}
)
"""They move the machine to a place that they do not name."""

_SETS_ONLY: Final = re.compile(
    rb"(SET_|EXCLUDE_OBJECT|RESPOND\b|SAVE_GCODE_STATE|TURN_OFF_HEATERS|M\d|T\d|@|;|$)"
)

_OTHER_COORDINATES: Final = frozenset(
    {b"G20", b"G53", b"G54", b"G55", b"G56", b"G57", b"G58", b"G59", b"M206", b"M428"}
)


class Move(NamedTuple):
    """One motion command: travel of x, y, z, e and wanted speed (0 if none was named yet), mm and mm/s.

    An arc counts as if it were unrolled along x, at the length of its full circle: an upper bound.
    """

    delta: tuple[float, float, float, float]
    speed: float


def parse(command: bytes) -> tuple[bytes, dict[bytes, float]]:
    """The word (`G1`, `M104`; empty if there is none) and the values of a command."""
    found = _WORD.match(command)
    if not found:
        return b"", {}
    values = {letter: float(value) for letter, value in _VALUE.findall(command, found.end())}
    return b"%s%d" % (found[1], int(found[2])), values


def is_macro(command: bytes) -> bool:
    """Whether a command is a name that the printer's owner, or its maker, gave to several: it may do anything."""
    return not _WORD.match(command) and _SETS_ONLY.match(command) is None


class Tracker:
    """Follows commands in the order in which the printer gets them."""

    def __init__(self, rule: Rule = "together") -> None:
        self._position: list[float | None] = [None, None, None, 0.0]
        self._e_told = False  # 0 is a guess that is good enough for lengths, but no place
        self._counting = Counting(rule)
        self._speed = 0.0
        self._comparable = True

    @property
    def place(self) -> Place:
        """Where the motion so far ends: x, y, z and e as the program counts it, mm; None where it is not known."""
        x, y, z, e = self._position if self._comparable else _NOWHERE
        return (x, y, z, e if self._e_told else None)

    def relative(self, values: dict[bytes, float]) -> bool:
        """Whether one of the axes in `values` is counted from where it is, so that a move twice is not a move once."""
        return any(self._from_here(axis) for axis, letter in enumerate(_AXES) if letter in values)

    def speak(self, rule: Rule) -> None:
        """The firmware is known now, and with it how it reads G90, G91, M82 and M83."""
        self._counting = self._counting._replace(rule=rule)

    def lose_place(self) -> None:
        """Something moved the machine, and did not say where to."""
        self._position[:3] = [None, None, None]

    def _from_here(self, axis: int) -> bool:
        return self._counting.e if axis == 3 else self._counting.axes

    @property
    def position(self) -> Spot:
        """Where the motion so far ends: x, y, z, mm; None where it is not known."""
        if not self._comparable:
            return (None, None, None)
        x, y, z, _ = self._position
        return (x, y, z)

    def follow(self, word: bytes, values: dict[bytes, float]) -> Move | None:
        """The move that a parsed command makes, None for any other command."""
        if word in _MOVES:
            return self._move(word, values)
        if word in _COUNTING:
            self._counting = self._counting.after(word.decode())
        elif word == b"G92":
            for axis, letter in enumerate(_AXES):
                if letter in values:
                    self._position[axis] = values[letter]
            self._e_told = self._e_told or b"E" in values
        elif word in MOVES_UNSEEN:
            self.lose_place()
        elif word in _OTHER_COORDINATES:
            self._comparable = False
        return None

    def _move(self, word: bytes, values: dict[bytes, float]) -> Move:
        feed = values.get(b"F", 0.0)
        if feed > 0.0:
            self._speed = feed / 60
        delta = [0.0, 0.0, 0.0, 0.0]
        for axis, letter in enumerate(_AXES):
            value = values.get(letter)
            if value is None:
                continue
            here = self._position[axis]
            if self._from_here(axis):
                delta[axis] = value
                self._position[axis] = None if here is None else here + value
            else:
                # From an unknown place: the distance from zero is as good a guess of the length as any.
                delta[axis] = value - (here or 0.0)
                self._position[axis] = value
                self._e_told = self._e_told or axis == 3
        if word in {b"G2", b"G3"}:
            radius = values.get(b"R") or hypot(values.get(b"I", 0.0), values.get(b"J", 0.0))
            delta[:2] = [max(hypot(*delta[:2]), 2 * pi * abs(radius)), 0.0]
        x, y, z, e = delta
        return Move((x, y, z, e), self._speed)
