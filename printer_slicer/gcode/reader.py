"""Text -> moves: what a file will make the machine do, all at once or piece by piece.

Knows straight lines and arcs, relative and absolute modes, inches, offsets, homing, dwells, changes of acceleration,
retraction by the firmware, tools, and extrusion by volume (M200). What does not move or wait is passed over.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Final

import numpy as np

from printer_slicer.firmware import FLAVOURS, Dialect
from printer_slicer.gcode.commands import Effect, names_that
from printer_slicer.gcode.lexer import extended, letters, parse
from printer_slicer.gcode.moves import Moves
from printer_slicer.gcode.plain import follow_plain, plain_moves
from printer_slicer.gcode.reading import Action, ReadingState, actions_of
from printer_slicer.motion.positioning_mode import PositioningMode

__all__ = ["MoveReader", "pieces_of", "read_moves"]

_STOPS: Final = names_that(Effect.WAITS)
_HOMES: Final = names_that(Effect.HOMES)
_AT_ONCE: Final = 8192  # commands; more do not fit into the processor's cache
_PIECE: Final = 1 << 15  # commands whose moves are looked at together


def read_moves(
    commands: Sequence[bytes], home: tuple[float, float] = (0.0, 0.0), dialect: Dialect = FLAVOURS["marlin"]
) -> Moves:
    """The moves of commands without comments, one each, such as `stream` sends them.

    Args:
        commands: one per entry.
        home: x and y of the endstops, mm; the machine begins there, and G28 brings it back.
        dialect: what commands mean that differ from firmware to firmware.
    """
    reader = MoveReader(home, dialect)
    reader.feed(commands)
    return reader.moves()


def pieces_of(
    commands: Sequence[bytes], home: tuple[float, float] = (0.0, 0.0), dialect: Dialect = FLAVOURS["marlin"]
) -> Iterator[Moves]:
    """The same piece by piece, so that a long job needs no more memory than a short one."""
    reader = MoveReader(home, dialect)
    for begin in range(0, len(commands), _PIECE):
        reader.feed(commands[begin : begin + _PIECE])
        yield reader.moves()


class MoveReader:
    """Follows commands and gives their moves, as often as it is asked.

    Args:
        home: x and y of the endstops, mm; the machine begins there, and G28 brings it back.
        dialect: what commands mean that differ from firmware to firmware.
    """

    def __init__(self, home: tuple[float, float] = (0.0, 0.0), dialect: Dialect = FLAVOURS["marlin"]) -> None:
        self._actions = actions_of(dialect)
        self._state = ReadingState(home=(*home, 0.0), counting=PositioningMode(dialect.counting))
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
        dwell, changes, rested = state.dwell, tuple(state.changes), state.rested
        state.dwell, state.stops, state.changes, state.rested = 0.0, [], [], False
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
            rested=rested,
        )

    def _follow(self, commands: Sequence[bytes]) -> None:
        """Commands of any kind, one by one."""
        state = self._state
        for index, command in enumerate(commands, self._count):
            code, words = _parse(command, self._actions)
            action = self._actions.get(code)
            if action is not None:
                action(state, words, index)
            if code not in _STOPS:
                continue
            if len(state.rows):
                state.stops.append(len(state.rows) - 1)
            else:
                state.rested = True
        self._count += len(commands)


def _parse(command: bytes, actions: Mapping[str, Action]) -> tuple[str, dict[str, float]]:
    """Code and numeric words of a command; of a command of words its name and settings."""
    word, values = parse(command)
    if not word:
        word, values = extended(command)
    code = word.decode()
    if code[:1] == "T" and code[1:].isdigit():
        return "T", {"T": float(code[1:4])}
    if code not in actions:
        return code, {}
    if code in _HOMES:  # axes are named by letters alone
        return code, {letter.decode(): 0.0 for letter in letters(command)}
    return code, {letter.decode(): value for letter, value in values.items()}
