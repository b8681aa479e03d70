"""Text -> moves: what a file will make the machine do, for the time model and for checks before the print.

Knows straight lines and arcs, relative and absolute modes, inches, offsets, homing, dwells, changes of acceleration,
tools, and extrusion by volume (M200). What does not move or wait is passed over.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from printer_slicer.model import Bool, Float, Int
from printer_slicer.motion.arcs import arc_points, centre_by_offset, centre_by_radius
from printer_slicer.motion.rules import Axes, Limits
from printer_slicer.motion.whole import durations

__all__ = ["Moves", "read_moves"]

_STOPS: Final = frozenset({"G4", "G28", "G29", "M0", "M1", "M109", "M190", "M400", "M600"})
_NONSENSE: Final = 1e9  # no machine goes there; not-a-number is refused by the same comparison
_CODE: Final = re.compile(r" *([GMT]) *([0-9]+)", re.IGNORECASE)
_WORD: Final = re.compile(r"([A-Z]) *([-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+))?", re.IGNORECASE)


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
            begin, limits = first, _changed(limits, kind, values)
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


def _changed(limits: Limits, kind: str, values: Mapping[str, float]) -> Limits:
    """The limits after M201, M203 or M205."""

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


@dataclass(slots=True)
class _State:
    """Where the machine is and how it reads numbers."""

    home: tuple[float, float, float]
    position: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0, 0.0])
    offset: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0, 0.0])
    relative: bool = False
    relative_e: bool = False
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
    changes: list[tuple[int, str, dict[str, float]]] = field(default_factory=list)
    rows: list[tuple[float, ...]] = field(default_factory=list)
    stops: list[int] = field(default_factory=list)

    @property
    def unit_e(self) -> float:
        """Mm of filament that an E of 1 feeds; mm³, or cubic inches, of it where M200 says so."""
        return self.unit**3 / (np.pi * self.diameter**2 / 4) if self.volumetric else self.unit


def read_moves(commands: Iterable[bytes], home: tuple[float, float] = (0.0, 0.0)) -> Moves:
    """The moves of commands without comments, one each, such as `stream` sends them.

    Args:
        commands: one per entry.
        home: x and y of the endstops, mm; the machine begins there, and G28 brings it back.
    """
    state = _State(home=(*home, 0.0))
    state.position[:3] = state.home
    for index, command in enumerate(commands):
        code, words = _parse(command)
        action = _ACTIONS.get(code)
        if action is not None:
            action(state, words, index)
        if code in _STOPS and state.rows:
            state.stops.append(len(state.rows) - 1)
    table = np.array(state.rows, np.float64).reshape(-1, 11)
    stop = np.zeros(len(table), np.bool_)
    stop[state.stops] = True
    return Moves(
        end=table[:, 0:3],
        delta=table[:, 3:7],
        speed=table[:, 7],
        acceleration=table[:, 8],
        line=table[:, 9].astype(np.int64),
        tool=table[:, 10].astype(np.int64),
        stop=stop,
        dwell_seconds=state.dwell,
        changes=tuple(state.changes),
    )


def _parse(command: bytes) -> tuple[str, dict[str, float]]:
    """Code and numeric words of a command, with or without blanks between them."""
    text = command.decode("latin-1")
    match = _CODE.match(text)
    if match is None:
        return "", {}
    code = f"{match[1].upper()}{int(match[2])}"
    if code[0] == "T":
        return "T", {"T": float(match[2][:3])}
    if code not in _ACTIONS:
        return code, {}
    found = _WORD.findall(text, match.end())
    if code == "G28":  # axes are named by letters alone
        return code, {letter.upper(): 0.0 for letter, _ in found}
    numbers = ((letter.upper(), float(number)) for letter, number in found if number)
    return code, {letter: value for letter, value in numbers if abs(value) < _NONSENSE}


def _goal(state: _State, words: Mapping[str, float]) -> list[float]:
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


def _move(state: _State, goal: list[float], index: int) -> None:
    """One straight move."""
    delta = [after - before for after, before in zip(goal, state.position, strict=True)]
    if any(delta):
        travels = delta[0] or delta[1] or delta[2]
        acceleration = state.travel if not delta[3] else state.printing if travels else state.retract
        state.rows.append(
            (*goal[:3], *delta, state.feed * state.speed_ratio, acceleration, index, state.tool)
        )
    state.position = goal


def _line(state: _State, words: Mapping[str, float], index: int) -> None:
    """G0 and G1: straight to where the words lead."""
    _move(state, _goal(state, words), index)


def _arc(clockwise: bool) -> Callable[[_State, Mapping[str, float], int], None]:
    """G2 or G3."""

    def run(state: _State, words: Mapping[str, float], index: int) -> None:
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


def _set_position(state: _State, words: Mapping[str, float], _index: int) -> None:
    """G92: the same place under other numbers."""
    for axis, letter in enumerate("XYZE"):
        if letter in words:
            if letter == "E":
                state.position[3] = words[letter] * state.unit_e
            else:
                state.offset[axis] = words[letter] * state.unit - state.position[axis]


def _home(state: _State, words: Mapping[str, float], _index: int) -> None:
    """G28: the axes that are named, or all but the filament, stand at their endstops, without offsets."""
    named = [axis for axis, letter in enumerate("XYZ") if letter in words]
    for axis in named or range(3):
        state.position[axis], state.offset[axis] = state.home[axis], 0.0


def _dwell(state: _State, words: Mapping[str, float], _index: int) -> None:
    """G4: S in seconds, or else P in milliseconds."""
    state.dwell += words["S"] if "S" in words else words.get("P", 0.0) / 1000


def _acceleration(state: _State, words: Mapping[str, float], _index: int) -> None:
    """M204: S sets printing and travel, P, T and R one each."""
    state.printing = words.get("P", words.get("S", state.printing))
    state.travel = words.get("T", words.get("S", state.travel))
    state.retract = words.get("R", state.retract)


def _limit(kind: str) -> Callable[[_State, Mapping[str, float], int], None]:
    """M201, M203 or M205."""

    def run(state: _State, words: Mapping[str, float], _index: int) -> None:
        """The limits that are named hold from the next move on; those of 0 are passed over."""
        values = {letter: value for letter, value in words.items() if value > 0}
        state.changes.append((len(state.rows), kind, values))

    return run


def _speed_ratio(state: _State, words: Mapping[str, float], _index: int) -> None:
    """M220: the share of all speeds from now on, in percent."""
    if "S" in words:
        state.speed_ratio = min(max(words["S"], 1.0), 999.0) / 100


def _volumetric(state: _State, words: Mapping[str, float], _index: int) -> None:
    """M200: from now on E counts mm³ of a filament of diameter D; D0 or S0 ends it, S1 goes back to it."""
    diameter = words.get("D", 0.0) * state.unit
    state.volumetric = bool(words.get("S", diameter))
    state.diameter = diameter or state.diameter


def _tool(state: _State, words: Mapping[str, float], _index: int) -> None:
    """T0, T1 and so on: another tool from now on."""
    state.tool = int(words["T"])


def _mode(name: str, value: float) -> Callable[[_State, Mapping[str, float], int], None]:
    """How numbers are read from now on: in mm or inches, from the origin or from where the machine is."""

    def run(state: _State, _words: Mapping[str, float], _index: int) -> None:
        """Set this mode."""
        setattr(state, name, value)
        if name == "relative":  # G90 and G91 speak of all axes; M82 and M83 may differ afterwards
            state.relative_e = bool(value)

    return run


_ACTIONS: Final[Mapping[str, Callable[[_State, Mapping[str, float], int], None]]] = {
    "G0": _line,
    "G1": _line,
    "G2": _arc(clockwise=True),
    "G3": _arc(clockwise=False),
    "G4": _dwell,
    "G20": _mode("unit", 25.4),
    "G21": _mode("unit", 1.0),
    "G28": _home,
    "G90": _mode("relative", False),
    "G91": _mode("relative", True),
    "G92": _set_position,
    "M82": _mode("relative_e", False),
    "M83": _mode("relative_e", True),
    "M200": _volumetric,
    "M201": _limit("M201"),
    "M203": _limit("M203"),
    "M204": _acceleration,
    "M205": _limit("M205"),
    "M220": _speed_ratio,
    "T": _tool,
}
