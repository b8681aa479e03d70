"""Check that a job homes before it moves and heats before it extrudes.

The simulated printer finds the same problems from its state. Here whole arrays of moves are compared with the commands
that home, heat and switch motors off, so that `check` rejects the same jobs as a dry run. Macros with the names of
start macros are assumed to home and heat, because only the printer knows their contents.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from printer_slicer.arrays import Bool, Float
from printer_slicer.diagnostics import Diagnostic
from printer_slicer.firmware import FIRMWARES
from printer_slicer.gcode import Moves
from printer_slicer.gcode.commands import Effect, find_codes_as_text, find_heater
from printer_slicer.gcode.lexer import LintCommand
from printer_slicer.printer_macros import match_start_macro
from printer_slicer.values import Struct, field

__all__ = ["ReadinessChecker"]

_AXES: Final = "XYZ"
_HARMLESS_LIFT: Final = 10.0  # mm, upwards
_MIN_EXTRUSION_TEMPERATURE: Final = 170.0  # °C; Marlin's EXTRUDE_MINTEMP
# s; a hotend that is off cools by 1 to 3 °C per second, and then filament flows badly
_COOLING_TIME: Final = 10.0
_UNKNOWN, _HOMED, _MOTORS_OFF = range(3)
_COLD, _HEATING, _HOT, _COOLING, _COOLED = range(5)
_WAITS_FOR_HEAT: Final = find_codes_as_text(Effect.WAITS_FOR_HEAT) | {"G29"}  # G29 takes as long as heating
_RUNS_MACRO: Final = find_codes_as_text(Effect.RUNS_MACRO)
_HOMES: Final = find_codes_as_text(Effect.HOMES)


class _StateHistory(Struct):
    """The history of a state: the commands that change it, and the state before and after each."""

    since: list[int] = field(default_factory=list)
    states: list[int] = field(default_factory=lambda: [0])

    @property
    def last_state(self) -> int:
        """Number of the state after the last command so far."""
        return self.states[-1]

    def record_change(self, index: int, state: int) -> None:
        """Record that a command changes the state."""
        if state != self.last_state:
            self.since.append(index)
            self.states.append(state)

    def states_before(
        self, commands: np.ndarray[tuple[int], np.dtype[np.int64]]
    ) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
        """Return the state (K,) before each of the commands (K,)."""
        return np.asarray(self.states)[np.searchsorted(self.since, commands, side="left")]


class _Problem(Struct):
    """All occurrences of one problem: its first command, and the number of its commands."""

    index: int
    count: int


class ReadinessChecker:
    """Checks that a job homes and heats before it moves; process all commands first, then check moves.

    Args:
        flavour: flavour of the firmware; if it moves before homing, a slight lift of the nozzle is allowed.
    """

    def __init__(self, flavour: str = "marlin") -> None:
        self._may_lift = FIRMWARES[flavour].allows_unhomed_moves
        self._homed: set[str] = set()
        self._axes, self._heat = _StateHistory(), _StateHistory()
        self._cooling = 0.0
        self._found: dict[tuple[str, str, str], _Problem] = {}

    def process_command(self, index: int, command: LintCommand) -> None:
        """Process the next command of the job."""
        code = command.code
        if code in _RUNS_MACRO or match_start_macro(code):
            self._mark_homed(index, _AXES)
            self._heat.record_change(index, _HOT)
        elif code in _HOMES:
            self._mark_homed(index, "".join(axis for axis in _AXES if axis in command.words) or _AXES)
        elif code in {"M18", "M84"} and "S" not in command.words and self._axes.last_state == _HOMED:
            self._axes.record_change(index, _MOTORS_OFF)
        else:
            self._process_heating(index, command)

    def check_moves(self, moves: Moves) -> None:
        """Check the next batch of moves."""
        if not len(moves.line):
            return
        axes, heat = self._axes.states_before(moves.line), self._heat.states_before(moves.line)
        moves_axes = (moves.delta[:, :3] != 0).any(axis=1)
        feeds = moves.delta[:, 3] != 0
        extrudes = (moves.delta[:, 3] > 0) & (moves.delta[:, :2] != 0).any(axis=1)
        reason = "The position of the nozzle is unknown: home first (G28)"
        lifts = self._find_harmless_lifts(moves)
        self._record("homing", "moves before homing", reason, moves, moves_axes & (axes == _UNKNOWN) & ~lifts)
        self._record(
            "homing",
            "extrudes after the motors were switched off",
            reason,
            moves,
            extrudes & (axes == _MOTORS_OFF),
        )
        reason = "The firmware blocks cold extrusion: heat the nozzle and wait first (for example M109 S210)"
        self._record("cold", "extrudes before the nozzle is hot", reason, moves, feeds & (heat <= _HEATING))
        off = (heat == _COOLED) | self._find_moves_after_cooling(moves, heat == _COOLING)
        self._record(
            "cold",
            f"extrudes more than {_COOLING_TIME:g} s after the nozzle was switched off",
            reason,
            moves,
            extrudes & off,
        )

    def findings(self, commands: Sequence[bytes]) -> Iterator[Diagnostic]:
        """Yield one diagnostic for each kind of problem; `commands` are all commands of the job."""
        for (name, message, reason), one in self._found.items():
            command = commands[one.index].decode("latin-1")
            yield Diagnostic(
                name, "error", message, reason, times=one.count, index=one.index, command=command
            )

    def _mark_homed(self, index: int, axes: str) -> None:
        """Mark axes as homed after a command."""
        self._homed.update(axes)
        if len(self._homed) == len(_AXES):
            self._axes.record_change(index, _HOMED)

    def _process_heating(self, index: int, command: LintCommand) -> None:
        """Process a nozzle target or a wait for it; with several tools, the last target applies to all."""
        target = _nozzle_target(command)
        state = self._heat.last_state
        if target is not None and target >= _MIN_EXTRUSION_TEMPERATURE:
            state = _HOT if state in {_HOT, _COOLING} else _HEATING
        elif target is not None and not self._names_tool(command):
            cools = command.code in _WAITS_FOR_HEAT and "R" in command.words
            state = _COLD if state <= _HEATING else _COOLED if cools else _COOLING
        if command.code in _WAITS_FOR_HEAT and state == _HEATING:
            state = _HOT
        self._heat.record_change(index, state)

    @staticmethod
    def _names_tool(command: LintCommand) -> bool:
        """Return whether a command names a tool, which may differ from the active tool."""
        return "T" in command.words or "P" in command.words

    def _find_harmless_lifts(self, moves: Moves) -> Bool:
        """Return a mask (K,) of moves that only lift the nozzle slightly, as many files do before homing."""
        x, y, z = moves.delta[:, :3].T
        return np.asarray(self._may_lift & (x == 0) & (y == 0) & (z > 0) & (z <= _HARMLESS_LIFT))

    def _find_moves_after_cooling(self, moves: Moves, cooling: Bool) -> Bool:
        """Return a mask (K,) of moves that start when the nozzle has been off for too long to extrude."""
        seconds = np.where(cooling, _durations(moves), 0.0)
        total = self._cooling + np.cumsum(seconds)
        begins = cooling & ~np.append(True, cooling[:-1])
        since = total - np.maximum.accumulate(np.where(begins, total - seconds, 0.0))
        self._cooling = float(since[-1]) if cooling[-1] else 0.0
        return np.asarray(cooling & (since > _COOLING_TIME))

    def _record(self, name: str, message: str, reason: str, moves: Moves, fails: Bool) -> None:
        """Record the first failing move, and the number of failing commands; `fails` (K,) is a mask."""
        failing = np.flatnonzero(fails)
        if not len(failing):
            return
        count = len(np.unique(moves.line[failing]))
        found = self._found.setdefault((name, message, reason), _Problem(int(moves.line[failing[0]]), 0))
        found.count += count


def _nozzle_target(command: LintCommand) -> float | None:
    """Return the nozzle target that a command sets, °C; None if it sets none."""
    if find_heater(command.code) == "nozzle" or (command.code == "G10" and "P" in command.words):
        return command.find_largest_number("SR")
    if (
        command.code == "SET_HEATER_TEMPERATURE"
        and "BED" not in command.text
        and "CHAMBER" not in command.text
    ):
        return command.settings.get("TARGET")
    return None


def _durations(moves: Moves) -> Float:
    """Return the duration (K,) of each move at its feed rate, s."""
    length = np.sqrt((moves.delta[:, :3] ** 2).sum(axis=1))
    length = np.where(length > 0, length, np.abs(moves.delta[:, 3]))
    return np.asarray(length / np.maximum(moves.speed, 1e-9))
