"""Compute the combined effect of thousands of simple commands: moves, and settings for the moves after them.

A run of such commands ends before the first command that waits, queries, homes, is an arc or unknown, leaves the
machine, extrudes cold or too far, or changes limits other than accelerations. The simulated firmware executes those
commands one by one.
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
    """Parsed consecutive commands of a job.

    Args:
        commands: the commands, without comments.
        first: index of the first one in the job.
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
        """Return the index of the first command from `begin` on that must be executed singly, else the count."""
        at = bisect_left(self._breaks, begin)
        return self._breaks[at] if at < len(self._breaks) else len(self.commands)

    def between(self, begin: int, end: int) -> list[tuple[int, str, str]]:
        """Return index, kind and text of the commands in a range that are not moves."""
        first, last = bisect_left(self.others, begin), bisect_left(self.others, end)
        return [(self.others[at], self.kinds[at], self.texts[self.others[at]]) for at in range(first, last)]


def _keeps_hot(kind: str, target: float, start: BatchStart) -> bool:
    """Return whether the firmware accepts a target temperature unchanged, and it allows extrusion."""
    low, high = start.bed_targets if kind == "M140" else start.targets
    return low <= target <= high


def _kind(text: str) -> str:
    """Return the kind of a command that neither moves nor waits; empty for all others."""
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
    """The effect of consecutive commands on a printer in a given state.

    Attributes:
        begin: index of the first command in its chunk.
        position: (n, 4) mm, end position of each command: x, y, z, e.
        delta: (n, 4) mm, displacement of each command, with e as it is fed.
        feed: (n,) mm/s, last feed rate that was set.
        speed: (n,) mm/s, requested speed.
        acceleration: (n,) mm/s², requested acceleration.
        answer: (n,) bytes in the reply to each command.
        limits: (index in the run, limits from there on).
        timed: (index in the run, text) of commands that change heaters and fans.
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
        """Return the run that starts at a command; None if that command must be executed singly."""
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
        """Return the load of these commands on the link and the planner."""
        own = slice(self.begin, self.begin + len(self))
        moving, length = find_moving(np.ascontiguousarray(self.delta.T))
        delta = np.ascontiguousarray(self.delta[moving].T)
        blocks = make_blocks(delta, length, self.speed[moving], self.acceleration[moving], limits)
        return LineBatch(chunk.sizes[own], chunk.rooms[own], self.answer, moving, blocks)


_Others = list[tuple[int, str, str]]


def _ways(words: Float, start: BatchStart, others: _Others) -> tuple[Float, Float]:
    """Return the (n, 4) positions and displacements, from the current position of the printer."""
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
    """Return (n,) whether the firmware executes each command unchanged."""
    low, high = np.array(start.low), np.array(start.high)
    good = ((position[:, :3] >= low) & (position[:, :3] <= high)).all(axis=1) | ~is_plain
    if not start.moves:
        good = ~is_plain
    feeds = delta[:, 3] != 0
    if not start.feeds:
        return np.asarray(good & ~feeds)
    return np.asarray(good & ~(feeds & (np.abs(delta[:, 3]) > start.longest_extrusion)))


def _accelerations(start: BatchStart, others: _Others) -> list[tuple[int, MotionLimits]]:
    """Return the limits after each command that changes accelerations, as the firmware interprets it."""
    own = [(place, text) for place, kind, text in others if kind == _ACCELERATION]
    limits = start.limits_after_commands([text for _, text in own])
    return [(place, after) for (place, _), after in zip(own, limits, strict=True)]


def _wanted(delta: Float, limits: MotionLimits, changes: Sequence[tuple[int, MotionLimits]]) -> Float:
    """Return the (n,) requested acceleration of each move, before the limits of the axes."""
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
    """Return the (n,) bytes of each reply. Step counts after G92 are taken from the end of the planned motion."""
    answer = np.full(len(position), _OK)
    for place, kind, _ in others:
        if kind == _SETS_E:
            x, y, z, e = position[place].tolist()
            answer[place] += start.position_report_bytes((x, y, z, e))
    return answer


def _held(values: Float, before: float) -> Float:
    """Replace nan by the last value before it; by `before` at the start."""
    values = np.append(before, values)
    last = np.maximum.accumulate(np.where(np.isnan(values), 0, np.arange(len(values))))
    return np.asarray(values[last][1:])


def limits_at(command_run: CommandRun, count: int, before: MotionLimits) -> MotionLimits:
    """Return the limits after the first `count` commands."""
    return next((after for place, after in reversed(command_run.limits) if place < count), before)
