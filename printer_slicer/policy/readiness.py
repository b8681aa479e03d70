"""Whether the machine is ready when a job needs it: homed before it moves, hot before it extrudes.

The simulated printer tells the same by its own state; here whole arrays of moves are held against the commands that
home, heat and switch motors off, so that `check` refuses what a dry run refuses. Macros whose name says that they
start prints are taken for homing and heating, for what they hold is in the printer.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from printer_slicer.gcode import Moves
from printer_slicer.geometry import Bool, Float
from printer_slicer.own_macros import starts_prints
from printer_slicer.policy.findings import Finding
from printer_slicer.policy.words import Command
from printer_slicer.sim.moves import HARMLESS_LIFT

__all__ = ["Readiness"]

_AXES: Final = "XYZ"
_COLDEST: Final = 170.0  # °C; Marlin's EXTRUDE_MINTEMP
_COOLS: Final = (
    10.0  # s after which plastic flows no more as it should; a hotend falls by one to three °C each second
)
_UNKNOWN, _HOMED, _LOOSE = range(3)
_COLD, _HEATING, _HOT, _COOLING, _COOLED = range(5)
_WAITS: Final = frozenset({"M109", "M116", "M190", "M191", "G29", "TEMPERATURE_WAIT"})
_MACROS: Final = frozenset({"M98", "G32"})
"""RepRapFirmware's: what they hold is in the printer."""


@dataclass(slots=True)
class _Track:
    """A state that changes with the commands: from which command on, and what it is."""

    since: list[int] = field(default_factory=list)
    states: list[int] = field(default_factory=lambda: [0])

    @property
    def now(self) -> int:
        """The state after all commands so far."""
        return self.states[-1]

    def set(self, index: int, state: int) -> None:
        """From this command on it is another."""
        if state != self.now:
            self.since.append(index)
            self.states.append(state)

    def at(
        self, commands: np.ndarray[tuple[int], np.dtype[np.int64]]
    ) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
        """(K,) the state before each of the commands (K,)."""
        return np.asarray(self.states)[np.searchsorted(self.since, commands, side="left")]


@dataclass(slots=True)
class _Found:
    """What is wrong: the first command that does it, and how many moves do."""

    index: int
    times: int


class Readiness:
    """Follows the commands of a whole job, then sees its moves piece by piece.

    Args:
        flavour: of the firmware; Klipper moves nothing before homing, others may be raised a little.
    """

    def __init__(self, flavour: str = "marlin") -> None:
        self._may_lift = flavour != "klipper"
        self._homed: set[str] = set()
        self._axes, self._heat = _Track(), _Track()
        self._cooling = 0.0
        self._found: dict[tuple[str, str, str], _Found] = {}

    def follow(self, index: int, command: Command) -> None:
        """One more command, in the order of the job."""
        code = command.code
        if code in _MACROS or starts_prints(code):
            self._home(index, _AXES)
            self._heat.set(index, _HOT)
        elif code == "G28":
            self._home(index, "".join(axis for axis in _AXES if axis in command.words) or _AXES)
        elif code in {"M18", "M84"} and "S" not in command.words and self._axes.now == _HOMED:
            self._axes.set(index, _LOOSE)
        else:
            self._follow_heat(index, command)

    def watch(self, moves: Moves) -> None:
        """Some more moves."""
        if not len(moves.line):
            return
        axes, heat = self._axes.at(moves.line), self._heat.at(moves.line)
        goes = (moves.delta[:, :3] != 0).any(axis=1)
        turns = moves.delta[:, 3] != 0
        lays = (moves.delta[:, 3] > 0) & (moves.delta[:, :2] != 0).any(axis=1)
        why = "where the nozzle is, is not known: begin with G28"
        lifts = self._lifts(moves)
        self._keep("homing", "moves before homing", why, moves, goes & (axes == _UNKNOWN) & ~lifts)
        self._keep("homing", "extrudes after the motors were off", why, moves, lays & (axes == _LOOSE))
        why = "the firmware does not turn a cold extruder: heat it and wait first, M109 S and a temperature"
        self._keep("cold", "extrudes before the nozzle is hot", why, moves, turns & (heat <= _HEATING))
        off = (heat == _COOLED) | self._cooled(moves, heat == _COOLING)
        self._keep(
            "cold",
            f"extrudes more than {_COOLS:g} s after the nozzle was switched off",
            why,
            moves,
            lays & off,
        )

    def findings(self, commands: Sequence[bytes]) -> Iterator[Finding]:
        """What was wrong, each thing once; `commands` of the job are shown in it."""
        for (name, what, why), one in self._found.items():
            yield Finding(name, True, one.index, commands[one.index].decode("latin-1"), what, why, one.times)

    def _home(self, index: int, axes: str) -> None:
        self._homed.update(axes)
        if len(self._homed) == len(_AXES):
            self._axes.set(index, _HOMED)

    def _follow_heat(self, index: int, command: Command) -> None:
        """Targets of nozzles, and what waits for them; with several tools the last target counts for all."""
        target = _target(command)
        state = self._heat.now
        if target is not None and target >= _COLDEST:
            state = _HOT if state in {_HOT, _COOLING} else _HEATING
        elif target is not None and not self._standby(command):
            cools = command.code == "M109" and "R" in command.words
            state = _COLD if state <= _HEATING else _COOLED if cools else _COOLING
        if command.code in _WAITS and state == _HEATING:
            state = _HOT
        self._heat.set(index, state)

    @staticmethod
    def _standby(command: Command) -> bool:
        """Whether a tool is named, which may be another than the one that prints."""
        return "T" in command.words or "P" in command.words

    def _lifts(self, moves: Moves) -> Bool:
        """(K,) which moves only raise the nozzle a little, as many start G-codes do on their way to homing."""
        x, y, z = moves.delta[:, :3].T
        return np.asarray(self._may_lift & (x == 0) & (y == 0) & (z > 0) & (z <= HARMLESS_LIFT))

    def _cooled(self, moves: Moves, cooling: Bool) -> Bool:
        """(K,) which moves come so long after the nozzle was switched off that it is too cold."""
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


def _target(command: Command) -> float | None:
    """°C that a command asks of a nozzle; None if it asks for none."""
    if command.code in {"M104", "M109", "M568"} or (command.code == "G10" and "P" in command.words):
        return command.most("SR")
    if (
        command.code == "SET_HEATER_TEMPERATURE"
        and "BED" not in command.text
        and "CHAMBER" not in command.text
    ):
        return command.settings.get("TARGET")
    return None


def _seconds(moves: Moves) -> Float:
    """(K,) s that each move takes at the speed it asks for."""
    length = np.sqrt((moves.delta[:, :3] ** 2).sum(axis=1))
    length = np.where(length > 0, length, np.abs(moves.delta[:, 3]))
    return np.asarray(length / np.maximum(moves.speed, 1e-9))
