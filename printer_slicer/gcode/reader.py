"""Read the moves of G-code, all at once or in pieces.

Understands lines and arcs, relative and absolute modes, inches, offsets, homing, dwells, accelerations, firmware
retraction, tools and volumetric extrusion (M200). Commands that neither move nor wait are skipped.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Final

import numpy as np

from printer_slicer.firmware import FLAVOURS, Dialect
from printer_slicer.gcode.commands import Effect, find_codes_as_text
from printer_slicer.gcode.lexer import find_letters, parse, parse_extended_command
from printer_slicer.gcode.move_actions import Action, ReaderState, build_actions
from printer_slicer.gcode.moves import Moves
from printer_slicer.gcode.plain_moves import apply_plain_moves, read_plain_moves
from printer_slicer.motion.positioning_mode import PositioningMode

__all__ = ["MoveReader", "read_moves", "read_moves_in_pieces"]

_STOPS: Final = find_codes_as_text(Effect.WAITS)
_HOMES: Final = find_codes_as_text(Effect.HOMES)
_BATCH: Final = 8192  # commands; more do not fit into the processor's cache
_PIECE: Final = 1 << 15  # commands in a piece


def read_moves(
    commands: Sequence[bytes], home: tuple[float, float] = (0.0, 0.0), dialect: Dialect = FLAVOURS["marlin"]
) -> Moves:
    """Return the moves that a list of commands makes.

    Args:
        commands: without comments, one per entry.
        home: x and y of the endstops, mm: position at the start and after G28.
        dialect: how the firmware reads commands.
    """
    reader = MoveReader(home, dialect)
    reader.feed(commands)
    return reader.take_moves()


def read_moves_in_pieces(
    commands: Sequence[bytes], home: tuple[float, float] = (0.0, 0.0), dialect: Dialect = FLAVOURS["marlin"]
) -> Iterator[Moves]:
    """Yield the moves that a list of commands makes, in pieces to bound memory; arguments as for `read_moves`."""
    reader = MoveReader(home, dialect)
    for begin in range(0, len(commands), _PIECE):
        reader.feed(commands[begin : begin + _PIECE])
        yield reader.take_moves()


class MoveReader:
    """Reads commands in any number of steps and returns their moves.

    Args:
        home: x and y of the endstops, mm: position at the start and after G28.
        dialect: how the firmware reads commands.
    """

    def __init__(self, home: tuple[float, float] = (0.0, 0.0), dialect: Dialect = FLAVOURS["marlin"]) -> None:
        self._actions = build_actions(dialect)
        self._state = ReaderState(home=(*home, 0.0), counting=PositioningMode(dialect.counting))
        self._state.position[:3] = self._state.home
        self._count = 0

    def feed(self, commands: Sequence[bytes]) -> None:
        """Read more commands."""
        for begin in range(0, len(commands), _BATCH):
            some = commands[begin : begin + _BATCH]
            plain = read_plain_moves(some)
            # Runs of plain moves, and the commands between them.
            cuts = np.flatnonzero(np.diff(plain.index) != 1) + 1
            done = 0
            for first, last in pairwise([0, *cuts.tolist(), len(plain.index)] if len(plain.index) else []):
                at = int(plain.index[first])
                self._apply_commands(some[done:at])
                apply_plain_moves(
                    self._state, plain.words[first:last], np.arange(self._count, self._count + last - first)
                )
                self._count += last - first
                done = at + last - first
            self._apply_commands(some[done:])

    def take_moves(self) -> Moves:
        """Return the moves of the commands fed since the last call."""
        state = self._state
        table = state.rows.take()
        stop = np.zeros(len(table), np.bool_)
        stop[state.stops] = True
        dwell, changes, starts_at_rest = state.dwell, tuple(state.changes), state.starts_at_rest
        state.dwell, state.stops, state.changes, state.starts_at_rest = 0.0, [], [], False
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
            starts_at_rest=starts_at_rest,
        )

    def _apply_commands(self, commands: Sequence[bytes]) -> None:
        """Read commands of any kind one by one."""
        state = self._state
        for index, command in enumerate(commands, self._count):
            code, words = _parse_command(command, self._actions)
            action = self._actions.get(code)
            if action is not None:
                action(state, words, index)
            if code not in _STOPS:
                continue
            if len(state.rows):
                state.stops.append(len(state.rows) - 1)
            else:
                state.starts_at_rest = True
        self._count += len(commands)


def _parse_command(command: bytes, actions: Mapping[str, Action]) -> tuple[str, dict[str, float]]:
    """Return the code and the numbers of a command, or the name and the parameters of an extended command."""
    word, values = parse(command)
    if not word:
        word, values = parse_extended_command(command)
    code = word.decode()
    if code[:1] == "T" and code[1:].isdigit():
        return "T", {"T": float(code[1:4])}
    if code not in actions:
        return code, {}
    if code in _HOMES:  # axes are letters without numbers
        return code, {letter.decode(): 0.0 for letter in find_letters(command)}
    return code, {letter.decode(): value for letter, value in values.items()}
