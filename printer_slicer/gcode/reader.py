"""Text -> moves: what a file will make the machine do, for the time model and for checks before the print.

Knows straight lines and arcs, relative and absolute modes, inches, offsets, homing, dwells and changes of acceleration.
What does not move or wait is passed over.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from math import atan2, ceil, cos, hypot, pi, sin
from typing import Final

import numpy as np

from printer_slicer.model import Bool, Float, Int
from printer_slicer.motion.rules import Limits
from printer_slicer.motion.whole import durations

__all__ = ["Moves", "read_moves"]

_STOPS: Final = frozenset({"G4", "G28", "G29", "M0", "M1", "M109", "M190", "M400", "M600"})
_CHORD: Final = 1.0  # mm, of an arc; shorter on small circles
_NONSENSE: Final = 1e9  # no machine goes there; not-a-number is refused by the same comparison
_LETTERS: Final = frozenset("XYZEFIJRSPT")


@dataclass(frozen=True, slots=True, eq=False)
class Moves:
    """The moves of a file.

    Attributes:
        end: (K, 3) position at the end of each move, mm.
        delta: (K, 4) x, y, z, e of each move, mm.
        speed: (K,) as the file asks, mm/s.
        acceleration: (K,) as the file set it by then, mm/s²; nan where it did not.
        line: (K,) index of the command that made it.
        stop: (K,) whether the machine stands still after it.
        dwell_seconds: asked for with G4.
    """

    end: Float
    delta: Float
    speed: Float
    acceleration: Float
    line: Int
    stop: Bool
    dwell_seconds: float

    def seconds(self, limits: Limits) -> float:
        """Time for all moves and dwells; homing and heating are not counted."""
        if len(self.speed) == 0:
            return self.dwell_seconds
        extrudes = self.delta[:, 3] != 0
        travels = (self.delta[:, :3] != 0).any(axis=1)
        usual = np.where(
            extrudes,
            np.where(travels, limits.acceleration, limits.retract_acceleration),
            limits.travel_acceleration,
        )
        acceleration = np.where(np.isnan(self.acceleration), usual, self.acceleration)
        each = durations(self.delta, self.speed, limits, stop_after=self.stop, acceleration=acceleration)
        return float(each.sum()) + self.dwell_seconds

    def heights(self) -> list[float]:
        """z at which plastic is laid while moving in x or y, mm, in order of the first time."""
        lays = (self.delta[:, 3] > 0) & (self.delta[:, :2] != 0).any(axis=1)
        return list(dict.fromkeys(np.round(self.end[lays, 2], 4).tolist()))


@dataclass(slots=True)
class _State:
    """Where the machine is and how it reads numbers."""

    position: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0, 0.0])
    offset: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0, 0.0])
    relative: bool = False
    relative_e: bool = False
    unit: float = 1.0
    feed: float = 25.0
    printing: float = np.nan
    travel: float = np.nan
    retract: float = np.nan
    dwell: float = 0.0
    rows: list[tuple[float, ...]] = field(default_factory=list)
    stops: list[int] = field(default_factory=list)


def read_moves(commands: Iterable[bytes]) -> Moves:
    """The moves of commands without comments, one each, such as `stream` sends them."""
    state = _State()
    for index, command in enumerate(commands):
        code, words = _parse(command)
        action = _ACTIONS.get(code)
        if action is not None:
            action(state, words, index)
        if code in _STOPS and state.rows:
            state.stops.append(len(state.rows) - 1)
    table = np.array(state.rows, np.float64).reshape(-1, 10)
    stop = np.zeros(len(table), np.bool_)
    stop[state.stops] = True
    return Moves(
        end=table[:, 0:3],
        delta=table[:, 3:7],
        speed=table[:, 7],
        acceleration=table[:, 8],
        line=table[:, 9].astype(np.int64),
        stop=stop,
        dwell_seconds=state.dwell,
    )


def _parse(command: bytes) -> tuple[str, dict[str, float]]:
    """Code and numeric words of a command; words that are no numbers are left out."""
    parts = command.decode("latin-1").split()
    words: dict[str, float] = {}
    for part in parts[1:]:
        if part[0] in _LETTERS:
            try:
                value = float(part[1:])
            except ValueError:
                continue
            if abs(value) < _NONSENSE:
                words[part[0]] = value
    return (parts[0] if parts else ""), words


def _goal(state: _State, words: Mapping[str, float]) -> list[float]:
    """Where the words lead, in machine coordinates."""
    goal = list(state.position)
    for axis, letter in enumerate("XYZE"):
        if letter in words:
            value = words[letter] * state.unit
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
        state.rows.append((*goal[:3], *delta, state.feed, acceleration, index))
    state.position = goal


def _line(state: _State, words: Mapping[str, float], index: int) -> None:
    _move(state, _goal(state, words), index)


def _arc(clockwise: bool) -> Callable[[_State, Mapping[str, float], int], None]:
    def run(state: _State, words: Mapping[str, float], index: int) -> None:
        begin, goal = list(state.position), _goal(state, words)
        i, j = words.get("I", 0.0) * state.unit, words.get("J", 0.0) * state.unit
        radius = hypot(i, j)
        if radius == 0:  # arcs by radius are not read; the chord has the right ends
            _move(state, goal, index)
            return
        centre = begin[0] + i, begin[1] + j
        first = atan2(-j, -i)
        sweep = (atan2(goal[1] - centre[1], goal[0] - centre[0]) - first) % (2 * pi)
        sweep = (sweep - 2 * pi) if clockwise else (sweep or 2 * pi)
        pieces = max(1, ceil(abs(sweep) * radius / min(_CHORD, radius * pi / 36)))
        for piece in range(1, pieces):
            share, angle = piece / pieces, first + sweep * piece / pieces
            rest = [begin[axis] + share * (goal[axis] - begin[axis]) for axis in (2, 3)]
            _move(state, [centre[0] + radius * cos(angle), centre[1] + radius * sin(angle), *rest], index)
        _move(state, goal, index)

    return run


def _set_position(state: _State, words: Mapping[str, float], _index: int) -> None:
    """G92: the same place under other numbers."""
    for axis, letter in enumerate("XYZE"):
        if letter in words:
            value = words[letter] * state.unit
            if letter == "E":
                state.position[3] = value
            else:
                state.offset[axis] = value - state.position[axis]


def _home(state: _State, words: Mapping[str, float], _index: int) -> None:
    named = [axis for axis, letter in enumerate("XYZ") if letter in words]
    for axis in named or range(3):
        state.position[axis] = state.offset[axis] = 0.0


def _dwell(state: _State, words: Mapping[str, float], _index: int) -> None:
    state.dwell += words["S"] if "S" in words else words.get("P", 0.0) / 1000


def _acceleration(state: _State, words: Mapping[str, float], _index: int) -> None:
    """M204: S sets printing and travel, P, T and R one each."""
    state.printing = words.get("P", words.get("S", state.printing))
    state.travel = words.get("T", words.get("S", state.travel))
    state.retract = words.get("R", state.retract)


def _mode(name: str, value: float) -> Callable[[_State, Mapping[str, float], int], None]:
    def run(state: _State, _words: Mapping[str, float], _index: int) -> None:
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
    "M204": _acceleration,
}
