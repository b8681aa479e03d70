"""Text -> moves: what a file will make the machine do, for the time model and for checks before the print.

Knows straight lines and arcs, relative and absolute modes, inches, offsets, homing, dwells, changes of acceleration,
retraction by the firmware, tools, and extrusion by volume (M200). What does not move or wait is passed over.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

import numpy as np

from printer_slicer.gcode.dialect import Dialect
from printer_slicer.gcode.marlin import MARLIN
from printer_slicer.gcode.plain import plain_moves
from printer_slicer.gcode.reading import MARLIN_ACTIONS, Action, State
from printer_slicer.gcode.runs import follow_plain
from printer_slicer.model import Bool, Float, Int
from printer_slicer.motion.counting import Counting
from printer_slicer.motion.rules import Axes, Limits
from printer_slicer.motion.whole import durations

__all__ = ["Moves", "Reader", "changed_limits", "read_moves"]

_STOPS: Final = frozenset(
    {"G4", "G28", "G29", "M0", "M1", "M109", "M190", "M226", "M400", "M600", "M601", "PAUSE"}
)
_AT_ONCE: Final = 8192  # commands; more do not fit into the processor's cache
_NONSENSE: Final = 1e9  # no machine goes there; not-a-number is refused by the same comparison
_CODE: Final = re.compile(r" *([GMT]) *([0-9]+)", re.IGNORECASE)
_WORD: Final = re.compile(r"([A-Z]) *([-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+))?", re.IGNORECASE)
_EXTENDED: Final = re.compile(r" *([A-Z]{3,}(?:_[A-Z]+)*)\b", re.IGNORECASE)
_SETTING: Final = re.compile(r"\b([A-Z_]+) *= *([-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+))", re.IGNORECASE)


@dataclass(frozen=True, slots=True, eq=False)
class Moves:
    """The moves of a file.

    Attributes:
        end: (K, 3) position at the end of each move, mm.
        delta: (K, 4) x, y, z, e of each move, mm.
        speed: (K,) as the file asks, mm/s.
        acceleration: (K,) as the file set it by then, mm/s²; nan where it did not.
        line: (K,) index of the command that made it.
        tool: (K,) number of the tool in use.
        stop: (K,) whether the machine stands still after it.
        dwell_seconds: asked for with G4.
        changes: changes of the machine's limits: (first move they hold for, kind, axis -> value).
    """

    end: Float
    delta: Float
    speed: Float
    acceleration: Float
    line: Int
    tool: Int
    stop: Bool
    dwell_seconds: float
    changes: tuple[tuple[int, str, Mapping[str, float]], ...] = ()

    def seconds(self, limits: Limits) -> float:
        """Time for all moves and dwells; homing and heating are not counted."""
        total, begin = self.dwell_seconds, 0
        for first, kind, values in (*self.changes, (len(self.speed), "", {})):
            total += self._between(begin, first, limits)
            begin, limits = first, changed_limits(limits, kind, values)
        return total

    def _between(self, first: int, last: int, limits: Limits) -> float:
        """Time for some of the moves, from rest to rest: limits change rarely, and then the machine mostly stands."""
        if last <= first:
            return 0.0
        some = slice(first, last)
        delta, wanted = self.delta[some], self.acceleration[some]
        travels = (delta[:, :3] != 0).any(axis=1)
        laying = np.where(travels, limits.acceleration, limits.retract_acceleration)
        usual = np.where(delta[:, 3] != 0, laying, limits.travel_acceleration)
        acceleration = np.where(np.isnan(wanted), usual, wanted)
        stop = self.stop[some]
        return float(
            durations(delta, self.speed[some], limits, stop_after=stop, acceleration=acceleration).sum()
        )

    def heights(self) -> list[float]:
        """z at which plastic is laid while moving in x or y, mm, in order of the first time."""
        lays = (self.delta[:, 3] > 0) & (self.delta[:, :2] != 0).any(axis=1)
        return list(dict.fromkeys(np.round(self.end[lays, 2], 4).tolist()))


def changed_limits(limits: Limits, kind: str, values: Mapping[str, float]) -> Limits:
    """The limits after M201, M203 or M205, a change of `Moves.changes`."""

    def merged(axes: Axes) -> Axes:
        """The limits of all axes, new ones for those that are named."""
        x, y, z, e = (values.get(letter, old) for letter, old in zip("XYZE", axes, strict=True))
        return x, y, z, e

    if kind == "M201":
        return replace(limits, max_acceleration=merged(limits.max_acceleration))
    if kind == "M203":
        return replace(limits, max_speed=merged(limits.max_speed))
    if kind == "M205":
        deviation = values.get("J", limits.junction_deviation)
        return replace(limits, jerk=merged(limits.jerk), junction_deviation=deviation)
    return limits


def read_moves(
    commands: Iterable[bytes], home: tuple[float, float] = (0.0, 0.0), dialect: Dialect = MARLIN
) -> Moves:
    """The moves of commands without comments, one each, such as `stream` sends them.

    Args:
        commands: one per entry.
        home: x and y of the endstops, mm; the machine begins there, and G28 brings it back.
        dialect: what commands mean that differ from firmware to firmware.
    """
    reader = Reader(home, dialect)
    reader.feed(commands if isinstance(commands, Sequence) else list(commands))
    return reader.moves()


class Reader:
    """Follows commands and gives their moves, as often as it is asked.

    Args:
        home: x and y of the endstops, mm; the machine begins there, and G28 brings it back.
        dialect: what commands mean that differ from firmware to firmware.
    """

    def __init__(self, home: tuple[float, float] = (0.0, 0.0), dialect: Dialect = MARLIN) -> None:
        self._actions = {**MARLIN_ACTIONS, **dialect.reads}
        self._state = State(home=(*home, 0.0), counting=Counting(dialect.counting))
        self._state.position[:3] = self._state.home
        self._count = 0

    def feed(self, commands: Sequence[bytes]) -> None:
        """Follow some more commands."""
        for begin in range(0, len(commands), _AT_ONCE):
            some = commands[begin : begin + _AT_ONCE]
            plain = plain_moves(some)
            # Runs of plain moves, and what stands between them.
            cuts = np.flatnonzero(np.diff(plain.index) != 1) + 1
            done = 0
            for first, last in pairwise([0, *cuts.tolist(), len(plain.index)] if len(plain.index) else []):
                at = int(plain.index[first])
                self._follow(some[done:at])
                follow_plain(
                    self._state, plain.words[first:last], np.arange(self._count, self._count + last - first)
                )
                self._count += last - first
                done = at + last - first
            self._follow(some[done:])

    def moves(self) -> Moves:
        """The moves of what was fed since the last time."""
        state = self._state
        table = state.rows.table()
        stop = np.zeros(len(table), np.bool_)
        stop[state.stops] = True
        dwell, changes = state.dwell, tuple(state.changes)
        state.dwell, state.stops, state.changes = 0.0, [], []
        return Moves(
            end=table[:, 0:3],
            delta=table[:, 3:7],
            speed=table[:, 7],
            acceleration=table[:, 8],
            line=table[:, 9].astype(np.int64),
            tool=table[:, 10].astype(np.int64),
            stop=stop,
            dwell_seconds=dwell,
            changes=changes,
        )

    def _follow(self, commands: Sequence[bytes]) -> None:
        """Commands of any kind, one by one."""
        state = self._state
        for index, command in enumerate(commands, self._count):
            code, words = _parse(command, self._actions)
            action = self._actions.get(code)
            if action is not None:
                action(state, words, index)
            if code in _STOPS and len(state.rows):
                state.stops.append(len(state.rows) - 1)
        self._count += len(commands)


def _parse(command: bytes, actions: Mapping[str, Action]) -> tuple[str, dict[str, float]]:
    """Code and numeric words of a command, with or without blanks between them."""
    text = command.decode("latin-1")
    match = _CODE.match(text)
    if match is None:
        return _extended(text)
    code = f"{match[1].upper()}{int(match[2])}"
    if code[0] == "T":
        return "T", {"T": float(match[2][:3])}
    if code not in actions:
        return code, {}
    found = _WORD.findall(text, match.end())
    if code == "G28":  # axes are named by letters alone
        return code, {letter.upper(): 0.0 for letter, _ in found}
    return code, _numbers(found)


def _extended(text: str) -> tuple[str, dict[str, float]]:
    """Name and numeric settings of a command of words."""
    match = _EXTENDED.match(text)
    return (match[1].upper(), _numbers(_SETTING.findall(text))) if match else ("", {})


def _numbers(found: list[tuple[str, str]]) -> dict[str, float]:
    numbers = ((letter.upper(), float(number)) for letter, number in found if number)
    return {letter: value for letter, value in numbers if abs(value) < _NONSENSE}
