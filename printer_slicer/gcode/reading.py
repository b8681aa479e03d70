"""What commands do to a machine that is only imagined: where it goes, how fast, under which limits."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.firmware import Dialect
from printer_slicer.firmware.firmware import SetsAccelerations, SetsLimits, SetsRetraction
from printer_slicer.motion.arcs import arc_points, centre_by_offset, centre_by_radius
from printer_slicer.motion.positioning_mode import PositioningMode

__all__ = ["Action", "GrowingTable", "ReadingState", "actions_of", "follow_line"]

_COLUMNS: Final = 11


class GrowingTable:
    """A table that grows, row by row and by many rows at once."""

    def __init__(self) -> None:
        self._tables: list[Float] = []
        self._rows: list[tuple[float, ...]] = []
        self._in_tables = 0

    def __len__(self) -> int:
        return self._in_tables + len(self._rows)

    def append(self, row: tuple[float, ...]) -> None:
        """Put one row behind the others."""
        self._rows.append(row)

    def extend(self, table: Float) -> None:
        """Put many behind the others, (n, 11)."""
        self._settle()
        self._tables.append(table)
        self._in_tables += len(table)

    def table(self) -> Float:
        """(n, 11) all of them; the rows are forgotten."""
        self._settle()
        tables, self._tables, self._in_tables = self._tables, [], 0
        return np.concatenate(tables) if tables else np.zeros((0, _COLUMNS))

    def _settle(self) -> None:
        if self._rows:
            self._tables.append(np.array(self._rows, np.float64))
            self._in_tables += len(self._rows)
            self._rows = []


@dataclass(slots=True)
class ReadingState:
    """Where the machine is and how it reads numbers.

    Attributes:
        offset: program coordinates minus machine coordinates of x, y and z, mm.
        home_offset: the part of it set by M206, which homing keeps.
        retraction: of G10 and G11: mm back, mm/s back, mm/s forward, mm more forward.
        retracted: whether G10 was the last of them.
        changes: of limits, as `Moves` has them.
        rows: position at the end (3), way (4), speed, acceleration, command, tool of each move.
        stops: moves after which the machine stands still.
        rested: whether it stands still before the first of them.
    """

    home: tuple[float, float, float]
    position: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0, 0.0])
    offset: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0, 0.0])
    home_offset: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    counting: PositioningMode = field(default_factory=PositioningMode)
    unit: float = 1.0
    diameter: float = 1.75
    volumetric: bool = False
    tool: int = 0
    feed: float = 25.0
    printing: float = np.nan
    travel: float = np.nan
    retract: float = np.nan
    speed_ratio: float = 1.0
    dwell: float = 0.0
    retraction: tuple[float, float, float, float] = (0.0, 25.0, 25.0, 0.0)
    retracted: bool = False
    changes: list[tuple[int, str, dict[str, float]]] = field(default_factory=list)
    rows: GrowingTable = field(default_factory=GrowingTable)
    stops: list[int] = field(default_factory=list)
    rested: bool = False

    @property
    def relative(self) -> bool:
        """Whether x, y, z count from where they are."""
        return self.counting.axes

    @property
    def relative_e(self) -> bool:
        """Whether e counts from where it is."""
        return self.counting.e

    @property
    def unit_e(self) -> float:
        """Mm of filament that an E of 1 feeds; mm³, or cubic inches, of it where M200 says so."""
        return self.unit**3 / (np.pi * self.diameter**2 / 4) if self.volumetric else self.unit


Action = Callable[[ReadingState, Mapping[str, float], int], None]
"""What a command does, given its numbers and its place among the commands."""


def _goal(state: ReadingState, words: Mapping[str, float]) -> list[float]:
    """Where the words lead, in machine coordinates."""
    goal = list(state.position)
    for axis, letter in enumerate("XYZE"):
        if letter in words:
            value = words[letter] * (state.unit_e if letter == "E" else state.unit)
            relative = state.relative_e if letter == "E" else state.relative
            goal[axis] = goal[axis] + value if relative else value - state.offset[axis]
    if words.get("F", 0) > 0:
        state.feed = words["F"] * state.unit / 60
    return goal


def _move(state: ReadingState, goal: list[float], index: int) -> None:
    """One straight move."""
    delta = [after - before for after, before in zip(goal, state.position, strict=True)]
    if any(delta):
        travels = delta[0] or delta[1] or delta[2]
        acceleration = state.travel if not delta[3] else state.printing if travels else state.retract
        state.rows.append(
            (*goal[:3], *delta, state.feed * state.speed_ratio, acceleration, index, state.tool)
        )
    state.position = goal


def follow_line(state: ReadingState, words: Mapping[str, float], index: int) -> None:
    """G0 and G1: straight to where the words lead."""
    _move(state, _goal(state, words), index)


def _arc(clockwise: bool) -> Action:
    """G2 or G3."""

    def run(state: ReadingState, words: Mapping[str, float], index: int) -> None:
        """An arc as straight moves, around a centre (I and J) or with a radius (R)."""
        x, y, z, e = state.position
        goal = _goal(state, words)
        unit = state.unit
        if "R" in words:
            centre = centre_by_radius((x, y), (goal[0], goal[1]), words["R"] * unit, clockwise=clockwise)
        else:
            centre = centre_by_offset((x, y), words.get("I", 0.0) * unit, words.get("J", 0.0) * unit)
        if centre is not None:  # firmware refuses an arc without one
            gx, gy, gz, ge = goal
            for point in arc_points((x, y, z, e), (gx, gy, gz, ge), centre, clockwise=clockwise):
                _move(state, list(point), index)

    return run


def _set_position(state: ReadingState, words: Mapping[str, float], _index: int) -> None:
    """G92: the same place under other numbers."""
    for axis, letter in enumerate("XYZE"):
        if letter in words:
            if letter == "E":
                state.position[3] = words[letter] * state.unit_e
            else:
                state.offset[axis] = words[letter] * state.unit - state.position[axis]


def _home(state: ReadingState, words: Mapping[str, float], _index: int) -> None:
    """G28: the named axes, or all but the extruder, are at their endstops, without the offset of G92."""
    named = [axis for axis, letter in enumerate("XYZ") if letter in words]
    for axis in named or range(3):
        state.position[axis], state.offset[axis] = state.home[axis], state.home_offset[axis]


def _offset_home(state: ReadingState, words: Mapping[str, float], _index: int) -> None:
    """M206: move the origin by the change of the home offset."""
    for axis, letter in enumerate("XYZ"):
        if letter in words:
            offset = words[letter] * state.unit
            state.offset[axis] += offset - state.home_offset[axis]
            state.home_offset[axis] = offset


def _offset_next_homing(state: ReadingState, words: Mapping[str, float], _index: int) -> None:
    """M206 of Smoothieware: applied at the next homing, and in mm even after G20."""
    for axis, letter in enumerate("XYZ"):
        if letter in words:
            state.home_offset[axis] = words[letter]


def _move_in_machine_coordinates(state: ReadingState, words: Mapping[str, float], index: int) -> None:
    """G53 before a move: use machine coordinates."""
    if (move := _MOVES.get(words.get("G", -1.0))) is not None:
        offset, state.offset = state.offset, [0.0, 0.0, 0.0, 0.0]
        move(state, words, index)
        state.offset = offset


def _dwell(state: ReadingState, words: Mapping[str, float], _index: int) -> None:
    """G4: S in seconds, or else P in milliseconds."""
    state.dwell += words["S"] if "S" in words else words.get("P", 0.0) / 1000


def _acceleration(state: ReadingState, words: Mapping[str, float], _index: int) -> None:
    """M204: S sets printing and travel, P, T and R one each."""
    state.printing = words.get("P", words.get("S", state.printing))
    state.travel = words.get("T", words.get("S", state.travel))
    state.retract = words.get("R", state.retract)


def _setting_limits(meaning: SetsLimits) -> Action:
    """A command that sets limits."""

    def run(state: ReadingState, words: Mapping[str, float], _index: int) -> None:
        """The limits that are named hold from the next move on; those of 0 are ignored."""
        names = {letter: letter for letter in words} if meaning.letters is None else meaning.letters
        values = {
            letter: value * meaning.scale
            for word, value in words.items()
            if value > 0
            for letter in names.get(word, "")
        }
        state.changes.append((len(state.rows), meaning.like, values))

    return run


def _setting_accelerations(meaning: SetsAccelerations) -> Action:
    """A command that sets accelerations."""

    def run(state: ReadingState, words: Mapping[str, float], _index: int) -> None:
        """They hold from the next move on."""
        for names, which in meaning.sets.items():
            values = [words[name] for name in names if words.get(name, 0) > 0]
            for one in which if values else ():
                setattr(state, one, min(values))

    return run


def _setting_retraction(meaning: SetsRetraction) -> Action:
    """A command that sets what G10 and G11 do."""

    def run(state: ReadingState, words: Mapping[str, float], _index: int) -> None:
        """It holds from the next G10 or G11 on."""
        length, back, forward, extra = (
            words.get(name, value) for name, value in zip(meaning.words, state.retraction, strict=True)
        )
        state.retraction = length, back, forward, extra

    return run


def _ignore(_state: ReadingState, _words: Mapping[str, float], _index: int) -> None:
    """Nothing that has to do with moves."""


def _retraction(state: ReadingState, words: Mapping[str, float], _index: int) -> None:
    """M207: S mm, F mm/min, and in RepRapFirmware forward T mm/min and R mm more."""
    length, back, forward, extra = state.retraction
    back, forward = words.get("F", 60 * back) / 60, words.get("T", 60 * forward) / 60
    state.retraction = words.get("S", length), back, forward, words.get("R", extra)


def _deretraction(state: ReadingState, words: Mapping[str, float], _index: int) -> None:
    """M208: forward F mm/min, and S mm more."""
    length, back, forward, extra = state.retraction
    state.retraction = length, back, words.get("F", 60 * forward) / 60, words.get("S", extra)


def _firmware_retraction(back: bool) -> Action:
    """G10 or G11."""

    def run(state: ReadingState, words: Mapping[str, float], index: int) -> None:
        """Turn the extruder, unless it is turned so already; E stays what it was. Letters make it another command."""
        if words or state.retracted == back:
            return
        state.retracted = back
        length, out, forward, extra = state.retraction
        x, y, z, e = state.position
        feed, state.feed = state.feed, out if back else forward
        _move(state, [x, y, z, e - length if back else e + length + extra], index)
        state.position, state.feed = [x, y, z, e], feed

    return run


def _speed_ratio(state: ReadingState, words: Mapping[str, float], _index: int) -> None:
    """M220: the share of all speeds from now on, in percent."""
    if "S" in words:
        state.speed_ratio = min(max(words["S"], 1.0), 999.0) / 100


def _volumetric(state: ReadingState, words: Mapping[str, float], _index: int) -> None:
    """M200: from now on E counts mm³ of a filament of diameter D; D0 or S0 ends it, S1 goes back to it."""
    diameter = words.get("D", 0.0) * state.unit
    state.volumetric = bool(words.get("S", diameter))
    state.diameter = diameter or state.diameter


def _tool(state: ReadingState, words: Mapping[str, float], _index: int) -> None:
    """T0, T1 and so on: another tool from now on."""
    state.tool = int(words["T"])


def _units(mm: float) -> Action:
    """Numbers are in units of so many mm from now on."""

    def run(state: ReadingState, _words: Mapping[str, float], _index: int) -> None:
        """Set this unit."""
        state.unit = mm

    return run


def _counts(word: str) -> Action:
    """Numbers count from the origin, or from where the machine is."""

    def run(state: ReadingState, _words: Mapping[str, float], _index: int) -> None:
        """As the firmware reads that."""
        state.counting = state.counting.after(word)

    return run


_MOVES: Final[Mapping[float, Action]] = {
    0.0: follow_line,
    1.0: follow_line,
    2.0: _arc(clockwise=True),
    3.0: _arc(clockwise=False),
}

_ACTIONS: Final[Mapping[str, Action]] = {
    "G0": follow_line,
    "G1": follow_line,
    "G2": _arc(clockwise=True),
    "G3": _arc(clockwise=False),
    "G4": _dwell,
    "G10": _firmware_retraction(back=True),
    "G11": _firmware_retraction(back=False),
    "G20": _units(25.4),
    "G21": _units(1.0),
    "G28": _home,
    "G90": _counts("G90"),
    "G91": _counts("G91"),
    "G92": _set_position,
    "M82": _counts("M82"),
    "M83": _counts("M83"),
    "M200": _volumetric,
    "M201": _setting_limits(SetsLimits("M201")),
    "M203": _setting_limits(SetsLimits("M203")),
    "M204": _acceleration,
    "M205": _setting_limits(SetsLimits("M205")),
    "M207": _retraction,
    "M208": _deretraction,
    "M220": _speed_ratio,
    "T": _tool,
}
"""As Marlin 2 has them."""

_HOME_OFFSETS: Final = {"at once": _offset_home, "when homed": _offset_next_homing, "never": _ignore}


def actions_of(dialect: Dialect) -> dict[str, Action]:
    """Command -> what it does, as a dialect reads it."""
    actions = {**_ACTIONS, "M206": _HOME_OFFSETS[dialect.home_offset]}
    if dialect.machine_coordinates:
        actions["G53"] = _move_in_machine_coordinates
    for code, meaning in dialect.reads.items():
        match meaning:
            case SetsLimits():
                actions[code] = _setting_limits(meaning)
            case SetsAccelerations():
                actions[code] = _setting_accelerations(meaning)
            case SetsRetraction():
                actions[code] = _setting_retraction(meaning)
            case None:
                actions[code] = _ignore
    return actions
