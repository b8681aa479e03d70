"""Check that a job homes before it moves and heats before it extrudes.

The simulated printer finds the same by its own state. Here whole arrays of moves are compared with the commands that
home, heat and switch motors off, so that `check` refuses what a dry run refuses. Macros whose names say that they
start prints are assumed to home and heat, because only the printer knows their contents.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from printer_slicer.arrays import Bool, Float
from printer_slicer.diagnostics import Diagnostic
from printer_slicer.firmware import FIRMWARES
from printer_slicer.gcode import Moves
from printer_slicer.gcode.commands import Effect, heater_of, names_that
from printer_slicer.gcode.lexer import LintCommand
from printer_slicer.printer_macros import match_start_macro

__all__ = ["Readiness"]

_AXES: Final = "XYZ"
_HARMLESS_LIFT: Final = 10.0  # mm, upwards
_COLDEST: Final = 170.0  # °C; Marlin's EXTRUDE_MINTEMP
_COOLS: Final = (
    10.0  # s after which filament no longer flows properly; a hotend cools by one to three °C per second
)
_UNKNOWN, _HOMED, _LOOSE = range(3)
_COLD, _HEATING, _HOT, _COOLING, _COOLED = range(5)
_WAITS: Final = names_that(Effect.WAITS_FOR_HEAT) | {"G29"}  # which takes as long as heating
_MACROS: Final = names_that(Effect.RUNS_MACRO)
_HOMES: Final = names_that(Effect.HOMES)


@dataclass(slots=True)
class _Track:
    """A state that changes with the commands: the indices of the changes, and the states."""

    since: list[int] = field(default_factory=list)
    states: list[int] = field(default_factory=lambda: [0])

    @property
    def now(self) -> int:
        """The state after all commands so far."""
        return self.states[-1]

    def set(self, index: int, state: int) -> None:
        """Change the state after this command."""
        if state != self.now:
            self.since.append(index)
            self.states.append(state)

    def at(
        self, commands: np.ndarray[tuple[int], np.dtype[np.int64]]
    ) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
        """Return the state (K,) before each of the commands (K,)."""
        return np.asarray(self.states)[np.searchsorted(self.since, commands, side="left")]


@dataclass(slots=True)
class _Found:
    """One kind of problem: its first command, and the number of commands with it."""

    index: int
    times: int


class Readiness:
    """Whether homing and heating precede the moves: takes all commands of a job first, then its moves in batches.

    Args:
        flavour: of the firmware; where it moves before homing, a slight lift of the nozzle is no fault.
    """

    def __init__(self, flavour: str = "marlin") -> None:
        self._may_lift = FIRMWARES[flavour].allows_unhomed_moves
        self._homed: set[str] = set()
        self._axes, self._heat = _Track(), _Track()
        self._cooling = 0.0
        self._found: dict[tuple[str, str, str], _Found] = {}

    def follow(self, index: int, command: LintCommand) -> None:
        """Process the next command of the job."""
        code = command.code
        if code in _MACROS or match_start_macro(code):
            self._home(index, _AXES)
            self._heat.set(index, _HOT)
        elif code in _HOMES:
            self._home(index, "".join(axis for axis in _AXES if axis in command.words) or _AXES)
        elif code in {"M18", "M84"} and "S" not in command.words and self._axes.now == _HOMED:
            self._axes.set(index, _LOOSE)
        else:
            self._follow_heat(index, command)

    def watch(self, moves: Moves) -> None:
        """Check the next batch of moves."""
        if not len(moves.line):
            return
        axes, heat = self._axes.at(moves.line), self._heat.at(moves.line)
        goes = (moves.delta[:, :3] != 0).any(axis=1)
        turns = moves.delta[:, 3] != 0
        lays = (moves.delta[:, 3] > 0) & (moves.delta[:, :2] != 0).any(axis=1)
        why = "The position of the nozzle is unknown: home first (G28)"
        lifts = self._lifts(moves)
        self._keep("homing", "moves before homing", why, moves, goes & (axes == _UNKNOWN) & ~lifts)
        self._keep(
            "homing", "extrudes after the motors were switched off", why, moves, lays & (axes == _LOOSE)
        )
        why = "The firmware blocks cold extrusion: heat the nozzle and wait first (for example M109 S215)"
        self._keep("cold", "extrudes before the nozzle is hot", why, moves, turns & (heat <= _HEATING))
        off = (heat == _COOLED) | self._cooled(moves, heat == _COOLING)
        self._keep(
            "cold",
            f"extrudes more than {_COOLS:g} s after the nozzle was switched off",
            why,
            moves,
            lays & off,
        )

    def findings(self, commands: Sequence[bytes]) -> Iterator[Diagnostic]:
        """Yield one finding for each kind of problem; `commands` are those of the job, for the text."""
        for (name, what, why), one in self._found.items():
            command = commands[one.index].decode("latin-1")
            yield Diagnostic(name, "error", what, why, times=one.times, index=one.index, command=command)

    def _home(self, index: int, axes: str) -> None:
        self._homed.update(axes)
        if len(self._homed) == len(_AXES):
            self._axes.set(index, _HOMED)

    def _follow_heat(self, index: int, command: LintCommand) -> None:
        """Process nozzle targets and commands that wait for them; with several tools the last target applies to all."""
        target = _target(command)
        state = self._heat.now
        if target is not None and target >= _COLDEST:
            state = _HOT if state in {_HOT, _COOLING} else _HEATING
        elif target is not None and not self._standby(command):
            cools = command.code in _WAITS and "R" in command.words
            state = _COLD if state <= _HEATING else _COOLED if cools else _COOLING
        if command.code in _WAITS and state == _HEATING:
            state = _HOT
        self._heat.set(index, state)

    @staticmethod
    def _standby(command: LintCommand) -> bool:
        """Return whether the command names a tool, which may not be the active one."""
        return "T" in command.words or "P" in command.words

    def _lifts(self, moves: Moves) -> Bool:
        """Return a mask (K,) of moves that only lift the nozzle slightly, as many start G-codes do before homing."""
        x, y, z = moves.delta[:, :3].T
        return np.asarray(self._may_lift & (x == 0) & (y == 0) & (z > 0) & (z <= _HARMLESS_LIFT))

    def _cooled(self, moves: Moves, cooling: Bool) -> Bool:
        """Return a mask (K,) of moves after the nozzle has been off long enough to be too cold."""
        seconds = np.where(cooling, _seconds(moves), 0.0)
        total = self._cooling + np.cumsum(seconds)
        begins = cooling & ~np.append(True, cooling[:-1])
        since = total - np.maximum.accumulate(np.where(begins, total - seconds, 0.0))
        self._cooling = float(since[-1]) if cooling[-1] else 0.0
        return np.asarray(cooling & (since > _COOLS))

    def _keep(self, name: str, what: str, why: str, moves: Moves, which: Bool) -> None:
        at = np.flatnonzero(which)
        if not len(at):
            return
        times = len(np.unique(moves.line[at]))
        found = self._found.setdefault((name, what, why), _Found(int(moves.line[at[0]]), 0))
        found.times += times


def _target(command: LintCommand) -> float | None:
    """Return the nozzle target that a command sets, °C; None if it sets none."""
    if heater_of(command.code) == "nozzle" or (command.code == "G10" and "P" in command.words):
        return command.largest_number("SR")
    if (
        command.code == "SET_HEATER_TEMPERATURE"
        and "BED" not in command.text
        and "CHAMBER" not in command.text
    ):
        return command.settings.get("TARGET")
    return None


def _seconds(moves: Moves) -> Float:
    """Return the duration (K,) of each move at its feed rate, s."""
    length = np.sqrt((moves.delta[:, :3] ** 2).sum(axis=1))
    length = np.where(length > 0, length, np.abs(moves.delta[:, 3]))
    return np.asarray(length / np.maximum(moves.speed, 1e-9))
