"""Commands that only move, or set something for the moves behind them: what they do, for thousands at once.

Such a stretch ends before the first command that waits, asks, homes, heats and waits, is an arc, is not known, leaves
the machine, extrudes cold or too far, or changes limits other than accelerations: those are executed by the simulated
firmware itself, one by one.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.gcode.plain_moves import read_plain_moves
from printer_slicer.link_model import LineBatch, line_sizes
from printer_slicer.motion.rules import MotionLimits
from printer_slicer.motion.vectorized import find_moving, make_blocks
from printer_slicer.sim.batch import BatchStart
from printer_slicer.sim.parsed_command import Command

__all__ = ["Chunk", "CommandRun", "limits_at"]

_TIMED: Final = frozenset({"M104", "M106", "M107", "M140"})
_HEATERS: Final = frozenset({"M104", "M140"})
_SILENT: Final = frozenset({"M73", "M117", "M486"})
_SETS_E: Final = "G92"
_ACCELERATION: Final = "M204"
_OK: Final = len("ok\n")


class Chunk:
    """Some commands of a job, read once.

    Args:
        commands: without comments.
        first: index in the job of the first of them.
    """

    def __init__(self, commands: Sequence[bytes], first: int) -> None:
        self.first, self.commands = first, commands
        self.texts = b"\n".join(commands).decode("latin-1").split("\n")
        plain = read_plain_moves(commands)
        self.words = np.full((len(commands), 5), np.nan)
        self.words[plain.index] = plain.words
        self.is_plain = np.zeros(len(commands), np.bool_)
        self.is_plain[plain.index] = True
        self.others = np.flatnonzero(~self.is_plain).tolist()
        self.kinds = [_kind(self.texts[place]) for place in self.others]
        self._breaks = [place for place, kind in zip(self.others, self.kinds, strict=True) if not kind]
        self.sizes, self.rooms = line_sizes(commands, first)

    def __len__(self) -> int:
        return len(self.commands)

    def break_after(self, begin: int) -> int:
        """The first command from `begin` on that has to be executed by itself; the number of commands without one."""
        at = bisect_left(self._breaks, begin)
        return self._breaks[at] if at < len(self._breaks) else len(self.commands)

    def between(self, begin: int, end: int) -> list[tuple[int, str, str]]:
        """Place, kind and text of the commands in a stretch that are no moves."""
        first, last = bisect_left(self.others, begin), bisect_left(self.others, end)
        return [(self.others[at], self.kinds[at], self.texts[self.others[at]]) for at in range(first, last)]


def _keeps_hot(kind: str, target: float, start: BatchStart) -> bool:
    """Whether a new target is one that the firmware takes as it is, and that lets filament be fed."""
    low, high = start.bed_targets if kind == "M140" else start.targets
    return low <= target <= high


def _kind(text: str) -> str:
    """What kind of command without motion or waiting this is; empty for all others."""
    code = text.partition(" ")[0]
    if code in _SILENT or code == _ACCELERATION:
        return code
    if code in _TIMED:
        # Only the plainest forms: what else they can say is the firmware's business, such as whose heater T means.
        return code if code == "M107" or list(Command(text).words) == ["S"] else ""
    if code == _SETS_E:
        words = Command(text).words
        return code if list(words) == ["E"] and words["E"] else ""
    return ""


@dataclass(frozen=True, slots=True, eq=False)
class CommandRun:
    """What commands that follow each other do to a printer as it stands before them.

    Attributes:
        begin: the first of them in its chunk.
        position: (n, 4) where each leads, x, y, z, e, mm.
        delta: (n, 4) its way, e as it is fed.
        feed: (n,) mm/s asked for last.
        speed: (n,) mm/s wanted.
        acceleration: (n,) wanted, mm/s².
        answer: (n,) bytes of what is said to it.
        limits: place in the stretch, and what holds from there on.
        timed: place and text of what changes heaters and fans.
    """

    begin: int
    position: Float
    delta: Float
    feed: Float
    speed: Float
    acceleration: Float
    answer: Int
    limits: tuple[tuple[int, MotionLimits], ...]
    timed: tuple[tuple[int, str], ...]

    def __len__(self) -> int:
        return len(self.position)

    @classmethod
    def read(cls, chunk: Chunk, begin: int, start: BatchStart) -> CommandRun | None:
        """The stretch that begins at a command, None if that has to be executed by itself."""
        end = chunk.break_after(begin)
        others = chunk.between(begin, end)
        for place, kind, text in others:
            if kind in _HEATERS and not _keeps_hot(kind, Command(text).value("S") or 0.0, start):
                end = place
                break
        if end <= begin:
            return None
        others = [(place - begin, kind, text) for place, kind, text in others if place < end]
        position, delta = _ways(chunk.words[begin:end], start, others)
        delta[:, 3] *= start.e_ratio
        allowed = _allowed(position, delta, chunk.is_plain[begin:end], start)
        count = len(allowed) if allowed.all() else int(allowed.argmin())
        if count == 0:
            return None
        others = [other for other in others if other[0] < count]
        limits = tuple(_accelerations(start, others))
        feeds = chunk.words[begin:end, 4]
        feed = _held(np.where(feeds > 0, feeds * start.unit / 60.0, np.nan), start.feed)
        cut = slice(0, count)
        return cls(
            begin,
            position[cut],
            delta[cut],
            feed[cut],
            feed[cut] * start.speed_ratio,
            _wanted(delta[cut], start.limits, limits),
            _answers(position[cut], start, others),
            limits,
            tuple((place, text) for place, kind, text in others if kind in _TIMED),
        )

    def lines(self, chunk: Chunk, limits: MotionLimits) -> LineBatch:
        """What these commands ask of the link and of the planner."""
        own = slice(self.begin, self.begin + len(self))
        moving, length = find_moving(np.ascontiguousarray(self.delta.T))
        delta = np.ascontiguousarray(self.delta[moving].T)
        blocks = make_blocks(delta, length, self.speed[moving], self.acceleration[moving], limits)
        return LineBatch(chunk.sizes[own], chunk.rooms[own], self.answer, moving, blocks)


_Others = list[tuple[int, str, str]]


def _ways(words: Float, start: BatchStart, others: _Others) -> tuple[Float, Float]:
    """(n, 4) positions and ways; what the printer has is where they begin."""
    unit, offset = start.unit, start.offset
    position, delta = np.zeros((len(words), 4)), np.zeros((len(words), 4))
    for axis in range(3):
        if start.relative:
            steps = np.where(np.isnan(words[:, axis]), 0.0, words[:, axis] * unit)
            position[:, axis] = np.cumsum(np.append(start.position[axis], steps))[1:]
        else:
            position[:, axis] = _held(words[:, axis] * unit + -offset[axis], start.position[axis])
        delta[:, axis] = np.diff(position[:, axis], prepend=start.position[axis])
    reported = np.array([place for place, kind, _ in others if kind == _SETS_E], np.int64)
    value = np.array([Command(text).value("E") for _, kind, text in others if kind == _SETS_E]) * unit
    e = words[:, 3] * unit
    if start.relative_e:
        steps = np.where(np.isnan(e), 0.0, e)
        total = np.cumsum(steps)
        base = np.full(len(e), np.nan)
        base[reported] = value - total[reported]
        position[:, 3] = total + _held(base, start.position[3])
        delta[:, 3] = steps
    else:
        e[reported] = value
        position[:, 3] = _held(e, start.position[3])
        delta[:, 3] = np.diff(position[:, 3], prepend=start.position[3])
        delta[reported, 3] = 0.0
    return position, delta


def _allowed(position: Float, delta: Float, is_plain: Bool, start: BatchStart) -> Bool:
    """(n,) which commands the firmware executes as they are written."""
    low, high = np.array(start.low), np.array(start.high)
    good = ((position[:, :3] >= low) & (position[:, :3] <= high)).all(axis=1) | ~is_plain
    if not start.moves:
        good = ~is_plain
    feeds = delta[:, 3] != 0
    if not start.feeds:
        return np.asarray(good & ~feeds)
    return np.asarray(good & ~(feeds & (np.abs(delta[:, 3]) > start.longest_extrusion)))


def _accelerations(start: BatchStart, others: _Others) -> list[tuple[int, MotionLimits]]:
    """The limits from each command on that changes accelerations; what that means the firmware says."""
    own = [(place, text) for place, kind, text in others if kind == _ACCELERATION]
    limits = start.limits_after([text for _, text in own])
    return [(place, after) for (place, _), after in zip(own, limits, strict=True)]


def _wanted(delta: Float, limits: MotionLimits, changes: Sequence[tuple[int, MotionLimits]]) -> Float:
    """(n,) the acceleration of each way, before the axes have their say."""
    travels = (delta[:, :3] != 0).any(axis=1)
    feeds = delta[:, 3] != 0
    which = np.zeros(len(delta), np.int64)
    which[[place for place, _ in changes]] = np.arange(1, len(changes) + 1)
    which = np.maximum.accumulate(which)
    table = np.array(
        [
            (one.acceleration, one.travel_acceleration, one.retract_acceleration)
            for one in (limits, *(after for _, after in changes))
        ]
    )[which]
    return np.asarray(np.where(feeds, np.where(travels, table[:, 0], table[:, 2]), table[:, 1]))


def _answers(position: Float, start: BatchStart, others: _Others) -> Int:
    """(n,) bytes of each answer. The step counts behind G92 are taken for those where the plan ends."""
    answer = np.full(len(position), _OK)
    for place, kind, _ in others:
        if kind == _SETS_E:
            x, y, z, e = position[place].tolist()
            answer[place] += start.place_bytes((x, y, z, e))
    return answer


def _held(values: Float, before: float) -> Float:
    """(n,) the last value that is a number, `before` before the first."""
    values = np.append(before, values)
    last = np.maximum.accumulate(np.where(np.isnan(values), 0, np.arange(len(values))))
    return np.asarray(values[last][1:])


def limits_at(command_run: CommandRun, count: int, before: MotionLimits) -> MotionLimits:
    """The limits behind the first `count` commands."""
    return next((after for place, after in reversed(command_run.limits) if place < count), before)
