"""What each command does to the state of the reader: position, speed, acceleration and limits."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.firmware import Dialect
from printer_slicer.firmware.firmware import SetsAccelerations, SetsLimits, SetsRetraction
from printer_slicer.motion.arcs import find_centre_by_offset, find_centre_by_radius, split_arc
from printer_slicer.motion.positioning_mode import PositioningMode
from printer_slicer.values import Struct, field

__all__ = ["Action", "MoveBuffer", "ReaderState", "build_actions", "move_straight"]

_COLUMNS: Final = 11


class MoveBuffer:
    """Collects rows of moves, one by one or many at once, as tables with 11 columns."""

    def __init__(self) -> None:
        self._tables: list[Float] = []
        self._rows: list[tuple[float, ...]] = []
        self._in_tables = 0

    def __len__(self) -> int:
        return self._in_tables + len(self._rows)

    def append(self, row: tuple[float, ...]) -> None:
        """Append one row."""
        self._rows.append(row)

    def extend(self, table: Float) -> None:
        """Append a table of rows, (n, 11)."""
        self._flush_rows()
        self._tables.append(table)
        self._in_tables += len(table)

    def take(self) -> Float:
        """Return all rows, (n, 11), and empty the buffer."""
        self._flush_rows()
        tables, self._tables, self._in_tables = self._tables, [], 0
        return np.concatenate(tables) if tables else np.zeros((0, _COLUMNS))

    def _flush_rows(self) -> None:
        """Convert the rows appended one by one to a table."""
        if self._rows:
            self._tables.append(np.array(self._rows, np.float64))
            self._in_tables += len(self._rows)
            self._rows = []


class ReaderState(Struct):
    """Position and modes of the machine, and the moves read so far.

    Attributes:
        home: position of the endstops, mm.
        position: machine coordinates of x, y, z and e, mm.
        offset: program coordinates minus machine coordinates of x, y and z, mm.
        home_offset: the part of `offset` that M206 sets and homing keeps.
        counting: absolute or relative mode of the axes and the extruder.
        unit: length of a unit of the program, mm.
        diameter, volumetric: filament diameter, mm, and whether E counts volume, as set by M200.
        feed: last feed rate, mm/s, before `speed_ratio` is applied.
        printing, travel, retract: accelerations set by the file, mm/s²; nan if not set.
        speed_ratio: feed rate factor set by M220.
        dwell: time of G4 so far, s.
        retraction: settings of G10 and G11: retracted length (mm), retraction speed, deretraction speed (mm/s) and
            extra length (mm).
        retracted: whether G10 came last, rather than G11.
        changes: changes of limits, as in `Moves`.
        rows: of each move: end position (3), distance in x, y, z, e (4), speed, acceleration, command, tool.
        stops: moves after which the machine stands still.
        starts_at_rest: whether the machine stands still before the first move.
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
    rows: MoveBuffer = field(default_factory=MoveBuffer)
    stops: list[int] = field(default_factory=list)
    starts_at_rest: bool = False

    @property
    def relative(self) -> bool:
        """Whether x, y, z are relative."""
        return self.counting.has_relative_axes

    @property
    def relative_e(self) -> bool:
        """Whether e is relative."""
        return self.counting.has_relative_e

    @property
    def filament_per_e(self) -> float:
        """Length of filament that E1 feeds, mm; after M200, E counts mm³ or cubic inches."""
        return self.unit**3 / (np.pi * self.diameter**2 / 4) if self.volumetric else self.unit


Action = Callable[[ReaderState, Mapping[str, float], int], None]
"""Applies a command to the state, given its numbers and its index."""


def _compute_end_position(state: ReaderState, words: Mapping[str, float]) -> list[float]:
    """Return the end position of a move with these words, in machine coordinates, mm."""
    goal = list(state.position)
    for axis, letter in enumerate("XYZE"):
        if letter in words:
            value = words[letter] * (state.filament_per_e if letter == "E" else state.unit)
            relative = state.relative_e if letter == "E" else state.relative
            goal[axis] = goal[axis] + value if relative else value - state.offset[axis]
    if words.get("F", 0) > 0:
        state.feed = words["F"] * state.unit / 60
    return goal


def _append_move(state: ReaderState, goal: list[float], index: int) -> None:
    """Append one straight move."""
    delta = [after - before for after, before in zip(goal, state.position, strict=True)]
    if any(delta):
        travels = delta[0] or delta[1] or delta[2]
        acceleration = state.travel if not delta[3] else state.printing if travels else state.retract
        state.rows.append(
            (*goal[:3], *delta, state.feed * state.speed_ratio, acceleration, index, state.tool)
        )
    state.position = goal


def move_straight(state: ReaderState, words: Mapping[str, float], index: int) -> None:
    """G0 and G1: move in a straight line."""
    _append_move(state, _compute_end_position(state, words), index)


def _make_arc_action(clockwise: bool) -> Action:
    """Return the action of G2 or G3."""

    def run(state: ReaderState, words: Mapping[str, float], index: int) -> None:
        """Append an arc as straight moves; its centre is given by I and J, or its radius by R."""
        x, y, z, e = state.position
        goal = _compute_end_position(state, words)
        unit = state.unit
        if "R" in words:
            centre = find_centre_by_radius((x, y), (goal[0], goal[1]), words["R"] * unit, clockwise=clockwise)
        else:
            centre = find_centre_by_offset((x, y), words.get("I", 0.0) * unit, words.get("J", 0.0) * unit)
        if centre is not None:  # firmware rejects an arc without a centre
            gx, gy, gz, ge = goal
            for point in split_arc((x, y, z, e), (gx, gy, gz, ge), centre, clockwise=clockwise):
                _append_move(state, list(point), index)

    return run


def _set_position(state: ReaderState, words: Mapping[str, float], _index: int) -> None:
    """G92: set the coordinates of the current position."""
    for axis, letter in enumerate("XYZE"):
        if letter in words:
            if letter == "E":
                state.position[3] = words[letter] * state.filament_per_e
            else:
                state.offset[axis] = words[letter] * state.unit - state.position[axis]


def _home_axes(state: ReaderState, words: Mapping[str, float], _index: int) -> None:
    """G28: move the named axes, or x, y and z, to their endstops, and drop the offset that G92 gave them."""
    named = [axis for axis, letter in enumerate("XYZ") if letter in words]
    for axis in named or range(3):
        state.position[axis], state.offset[axis] = state.home[axis], state.home_offset[axis]


def _set_home_offset(state: ReaderState, words: Mapping[str, float], _index: int) -> None:
    """M206: move the origin by the change of the home offset."""
    for axis, letter in enumerate("XYZ"):
        if letter in words:
            offset = words[letter] * state.unit
            state.offset[axis] += offset - state.home_offset[axis]
            state.home_offset[axis] = offset


def _set_offset_for_next_homing(state: ReaderState, words: Mapping[str, float], _index: int) -> None:
    """M206 of Smoothieware: set an offset that applies from the next homing on; it is in mm even after G20."""
    for axis, letter in enumerate("XYZ"):
        if letter in words:
            state.home_offset[axis] = words[letter]


def _move_in_machine_coordinates(state: ReaderState, words: Mapping[str, float], index: int) -> None:
    """G53 before a move: move in machine coordinates."""
    if (move := _MOVES.get(words.get("G", -1.0))) is not None:
        offset, state.offset = state.offset, [0.0, 0.0, 0.0, 0.0]
        move(state, words, index)
        state.offset = offset


def _add_dwell(state: ReaderState, words: Mapping[str, float], _index: int) -> None:
    """G4: wait for S seconds, or without S for P milliseconds."""
    state.dwell += words["S"] if "S" in words else words.get("P", 0.0) / 1000


def _set_accelerations(state: ReaderState, words: Mapping[str, float], _index: int) -> None:
    """M204: set accelerations: S printing and travel, P printing, T travel, R retraction."""
    state.printing = words.get("P", words.get("S", state.printing))
    state.travel = words.get("T", words.get("S", state.travel))
    state.retract = words.get("R", state.retract)


def _make_limits_action(meaning: SetsLimits) -> Action:
    """Return the action of a command that sets limits."""

    def run(state: ReaderState, words: Mapping[str, float], _index: int) -> None:
        """Set limits from the next move on; values of 0 are ignored."""
        names = {letter: letter for letter in words} if meaning.letters is None else meaning.letters
        values = {
            letter: value * meaning.scale
            for word, value in words.items()
            if value > 0
            for letter in names.get(word, "")
        }
        state.changes.append((len(state.rows), meaning.marlin_command, values))

    return run


def _make_accelerations_action(meaning: SetsAccelerations) -> Action:
    """Return the action of a command that sets accelerations."""

    def run(state: ReaderState, words: Mapping[str, float], _index: int) -> None:
        """Set accelerations from the next move on."""
        for names, which in meaning.sets.items():
            values = [words[name] for name in names if words.get(name, 0) > 0]
            for one in which if values else ():
                setattr(state, one, min(values))

    return run


def _make_retraction_settings_action(meaning: SetsRetraction) -> Action:
    """Return the action of a command that sets lengths and speeds of G10 and G11."""

    def run(state: ReaderState, words: Mapping[str, float], _index: int) -> None:
        """Set lengths and speeds from the next G10 or G11 on."""
        length, back, forward, extra = (
            words.get(name, value) for name, value in zip(meaning.words, state.retraction, strict=True)
        )
        state.retraction = length, back, forward, extra

    return run


def _ignore(_state: ReaderState, _words: Mapping[str, float], _index: int) -> None:
    """Ignore a command that does not affect moves."""


def _set_retraction(state: ReaderState, words: Mapping[str, float], _index: int) -> None:
    """M207: retract S mm at F mm/min; RepRapFirmware deretracts at T mm/min, with R mm extra."""
    length, back, forward, extra = state.retraction
    back, forward = words.get("F", 60 * back) / 60, words.get("T", 60 * forward) / 60
    state.retraction = words.get("S", length), back, forward, words.get("R", extra)


def _set_deretraction(state: ReaderState, words: Mapping[str, float], _index: int) -> None:
    """M208: deretract at F mm/min, with S mm extra."""
    length, back, forward, extra = state.retraction
    state.retraction = length, back, words.get("F", 60 * forward) / 60, words.get("S", extra)


def _make_retraction_action(back: bool) -> Action:
    """Return the action of G10 or G11."""

    def run(state: ReaderState, words: Mapping[str, float], index: int) -> None:
        """Retract or deretract, unless already done; E keeps its value. A G10 or G11 with words is another command."""
        if words or state.retracted == back:
            return
        state.retracted = back
        length, out, forward, extra = state.retraction
        x, y, z, e = state.position
        feed, state.feed = state.feed, out if back else forward
        _append_move(state, [x, y, z, e - length if back else e + length + extra], index)
        state.position, state.feed = [x, y, z, e], feed

    return run


def _set_speed_ratio(state: ReaderState, words: Mapping[str, float], _index: int) -> None:
    """M220: set the feed rate percentage."""
    if "S" in words:
        state.speed_ratio = min(max(words["S"], 1.0), 999.0) / 100


def _set_volumetric(state: ReaderState, words: Mapping[str, float], _index: int) -> None:
    """M200: let E count mm³ of filament with diameter D; D0 or S0 disables that, S1 enables it again."""
    diameter = words.get("D", 0.0) * state.unit
    state.volumetric = bool(words.get("S", diameter))
    state.diameter = diameter or state.diameter


def _select_tool(state: ReaderState, words: Mapping[str, float], _index: int) -> None:
    """T0, T1 and so on: select a tool."""
    state.tool = int(words["T"])


def _make_units_action(mm: float) -> Action:
    """Return the action of G20 or G21, which sets units of this many mm."""

    def run(state: ReaderState, _words: Mapping[str, float], _index: int) -> None:
        """Set the unit."""
        state.unit = mm

    return run


def _make_mode_action(word: str) -> Action:
    """Return the action of a command that sets absolute or relative mode."""

    def run(state: ReaderState, _words: Mapping[str, float], _index: int) -> None:
        """Set the mode by the firmware's rule."""
        state.counting = state.counting.with_command(word)

    return run


_MOVES: Final[Mapping[float, Action]] = {
    0.0: move_straight,
    1.0: move_straight,
    2.0: _make_arc_action(clockwise=True),
    3.0: _make_arc_action(clockwise=False),
}

_ACTIONS: Final[Mapping[str, Action]] = {
    "G0": move_straight,
    "G1": move_straight,
    "G2": _make_arc_action(clockwise=True),
    "G3": _make_arc_action(clockwise=False),
    "G4": _add_dwell,
    "G10": _make_retraction_action(back=True),
    "G11": _make_retraction_action(back=False),
    "G20": _make_units_action(25.4),
    "G21": _make_units_action(1.0),
    "G28": _home_axes,
    "G90": _make_mode_action("G90"),
    "G91": _make_mode_action("G91"),
    "G92": _set_position,
    "M82": _make_mode_action("M82"),
    "M83": _make_mode_action("M83"),
    "M200": _set_volumetric,
    "M201": _make_limits_action(SetsLimits("M201")),
    "M203": _make_limits_action(SetsLimits("M203")),
    "M204": _set_accelerations,
    "M205": _make_limits_action(SetsLimits("M205")),
    "M207": _set_retraction,
    "M208": _set_deretraction,
    "M220": _set_speed_ratio,
    "T": _select_tool,
}
"""The actions in Marlin 2."""

_HOME_OFFSETS: Final = {
    "at once": _set_home_offset,
    "when homed": _set_offset_for_next_homing,
    "never": _ignore,
}


def build_actions(dialect: Dialect) -> dict[str, Action]:
    """Return the actions of a dialect, by command."""
    actions = {**_ACTIONS, "M206": _HOME_OFFSETS[dialect.home_offset]}
    if dialect.machine_coordinates:
        actions["G53"] = _move_in_machine_coordinates
    for code, meaning in dialect.commands.items():
        match meaning:
            case SetsLimits():
                actions[code] = _make_limits_action(meaning)
            case SetsAccelerations():
                actions[code] = _make_accelerations_action(meaning)
            case SetsRetraction():
                actions[code] = _make_retraction_settings_action(meaning)
            case None:
                actions[code] = _ignore
    return actions
