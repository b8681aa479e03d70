"""Compute the combined effect of thousands of consecutive simple commands: moves, and settings of moves.

A run of such commands ends before the first command that waits, queries, homes, is an arc or unknown, leaves the
machine, extrudes cold or too far, or changes limits other than accelerations. The simulated firmware executes such
commands one by one.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence
from typing import Final

import numpy as np

from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.gcode.plain_moves import read_plain_moves
from printer_slicer.link_model import LineBatch, compute_line_sizes
from printer_slicer.motion.rules import MotionLimits
from printer_slicer.motion.vectorized import find_nonzero_moves, make_blocks
from printer_slicer.sim.batch import BatchStart
from printer_slicer.sim.parsed_command import Command
from printer_slicer.values import Struct

__all__ = ["Chunk", "CommandRun", "limits_after_count"]

_TIMED_CODES: Final = frozenset({"M104", "M106", "M107", "M140"})
_HEATER_CODES: Final = frozenset({"M104", "M140"})
_CODES_WITHOUT_EFFECT: Final = frozenset({"M73", "M117", "M486"})
_SET_E_CODE: Final = "G92"
_ACCELERATION_CODE: Final = "M204"
_OK_SIZE: Final = len("ok\n")


class Chunk:
    """Consecutive commands of a job, which are parsed together.

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
        self.kinds = [_classify_command(self.texts[place]) for place in self.others]
        self._breaks = [place for place, kind in zip(self.others, self.kinds, strict=True) if not kind]
        self.sizes, self.reserved_sizes = compute_line_sizes(commands, first)

    def __len__(self) -> int:
        return len(self.commands)

    def next_single_command(self, begin: int) -> int:
        """Return the index, at least `begin`, of the next command to execute singly; else the length."""
        at = bisect_left(self._breaks, begin)
        return self._breaks[at] if at < len(self._breaks) else len(self.commands)

    def non_moves_between(self, begin: int, end: int) -> list[tuple[int, str, str]]:
        """Return index, kind and text of each command in a range, except plain moves."""
        first, last = bisect_left(self.others, begin), bisect_left(self.others, end)
        return [(self.others[at], self.kinds[at], self.texts[self.others[at]]) for at in range(first, last)]


def _is_accepted_target(kind: str, target: float, start: BatchStart) -> bool:
    """Return whether the firmware accepts a target temperature unchanged and extrudes at this temperature."""
    low, high = start.bed_targets if kind == "M140" else start.targets
    return low <= target <= high


def _classify_command(text: str) -> str:
    """Return the code of a simple command that neither moves nor waits; empty for every other command."""
    code = text.partition(" ")[0]
    if code in _CODES_WITHOUT_EFFECT or code == _ACCELERATION_CODE:
        return code
    if code in _TIMED_CODES:
        # Only the plainest forms are simple; the firmware executes others, such as a T that selects a heater.
        return code if code == "M107" or list(Command(text).words) == ["S"] else ""
    if code == _SET_E_CODE:
        words = Command(text).words
        return code if list(words) == ["E"] and words["E"] else ""
    return ""


class CommandRun(Struct, frozen=True, eq=False):
    """The combined effect of consecutive simple commands on a printer.

    Attributes:
        begin: index of the first command in its chunk.
        position: (n, 4) mm, position after each command: x, y, z, e.
        delta: (n, 4) mm, displacement of each command; e is the filament fed.
        feed: (n,) mm/s, feed rate after each command.
        speed: (n,) mm/s, requested speed.
        acceleration: (n,) mm/s², requested acceleration.
        reply_size: (n,) number of bytes in the reply to each command.
        limits: (index in the run, limits from there on).
        timed: (index in the run, text) of commands that change heaters and fans.
    """

    begin: int
    position: Float
    delta: Float
    feed: Float
    speed: Float
    acceleration: Float
    reply_size: Int
    limits: tuple[tuple[int, MotionLimits], ...]
    timed: tuple[tuple[int, str], ...]

    def __len__(self) -> int:
        return len(self.position)

    @classmethod
    def read(cls, chunk: Chunk, begin: int, start: BatchStart) -> CommandRun | None:
        """Return the run of simple commands that starts at `begin`; None if that command is not simple."""
        end = chunk.next_single_command(begin)
        others = chunk.non_moves_between(begin, end)
        for place, kind, text in others:
            if kind in _HEATER_CODES and not _is_accepted_target(
                kind, Command(text).value("S") or 0.0, start
            ):
                end = place
                break
        if end <= begin:
            return None
        others = [(place - begin, kind, text) for place, kind, text in others if place < end]
        position, delta = _trace_moves(chunk.words[begin:end], start, others)
        delta[:, 3] *= start.e_ratio
        unchanged = _find_unchanged_commands(position, delta, chunk.is_plain[begin:end], start)
        count = len(unchanged) if unchanged.all() else int(unchanged.argmin())
        if count == 0:
            return None
        others = [other for other in others if other[0] < count]
        limits = tuple(_acceleration_limits(start, others))
        feeds = chunk.words[begin:end, 4]
        feed = _fill_forward(np.where(feeds > 0, feeds * start.unit / 60.0, np.nan), start.feed)
        kept = slice(0, count)
        return cls(
            begin,
            position[kept],
            delta[kept],
            feed[kept],
            feed[kept] * start.speed_ratio,
            _requested_accelerations(delta[kept], start.limits, limits),
            _reply_sizes(position[kept], start, others),
            limits,
            tuple((place, text) for place, kind, text in others if kind in _TIMED_CODES),
        )

    def make_line_batch(self, chunk: Chunk, limits: MotionLimits) -> LineBatch:
        """Return how much these commands load the link and the planner."""
        selected = slice(self.begin, self.begin + len(self))
        moving, length = find_nonzero_moves(np.ascontiguousarray(self.delta.T))
        delta = np.ascontiguousarray(self.delta[moving].T)
        blocks = make_blocks(delta, length, self.speed[moving], self.acceleration[moving], limits)
        return LineBatch(
            chunk.sizes[selected], chunk.reserved_sizes[selected], self.reply_size, moving, blocks
        )


_OtherCommands = list[tuple[int, str, str]]


def _trace_moves(words: Float, start: BatchStart, others: _OtherCommands) -> tuple[Float, Float]:
    """Return the position after each command and its displacement, (n, 4); the printer is at `start`."""
    unit, offset = start.unit, start.offset
    position, delta = np.zeros((len(words), 4)), np.zeros((len(words), 4))
    for axis in range(3):
        if start.relative:
            steps = np.where(np.isnan(words[:, axis]), 0.0, words[:, axis] * unit)
            position[:, axis] = np.cumsum(np.append(start.position[axis], steps))[1:]
        else:
            position[:, axis] = _fill_forward(words[:, axis] * unit + -offset[axis], start.position[axis])
        delta[:, axis] = np.diff(position[:, axis], prepend=start.position[axis])
    reported = np.array([place for place, kind, _ in others if kind == _SET_E_CODE], np.int64)
    value = np.array([Command(text).value("E") for _, kind, text in others if kind == _SET_E_CODE]) * unit
    e = words[:, 3] * unit
    if start.relative_e:
        steps = np.where(np.isnan(e), 0.0, e)
        total = np.cumsum(steps)
        base = np.full(len(e), np.nan)
        base[reported] = value - total[reported]
        position[:, 3] = total + _fill_forward(base, start.position[3])
        delta[:, 3] = steps
    else:
        e[reported] = value
        position[:, 3] = _fill_forward(e, start.position[3])
        delta[:, 3] = np.diff(position[:, 3], prepend=start.position[3])
        delta[reported, 3] = 0.0
    return position, delta


def _find_unchanged_commands(position: Float, delta: Float, is_plain: Bool, start: BatchStart) -> Bool:
    """Return a mask (n,) of commands that the firmware neither rejects nor clips."""
    low, high = np.array(start.low), np.array(start.high)
    unchanged = ((position[:, :3] >= low) & (position[:, :3] <= high)).all(axis=1) | ~is_plain
    if not start.moves:
        unchanged = ~is_plain
    moves_extruder = delta[:, 3] != 0
    if not start.feeds:
        return np.asarray(unchanged & ~moves_extruder)
    return np.asarray(unchanged & ~(moves_extruder & (np.abs(delta[:, 3]) > start.longest_extrusion)))


def _acceleration_limits(start: BatchStart, others: _OtherCommands) -> list[tuple[int, MotionLimits]]:
    """Return the index of each command that changes accelerations, and the motion limits after it."""
    changing = [(place, text) for place, kind, text in others if kind == _ACCELERATION_CODE]
    limits = start.limits_after_commands([text for _, text in changing])
    return [(place, after) for (place, _), after in zip(changing, limits, strict=True)]


def _requested_accelerations(
    delta: Float, limits: MotionLimits, changes: Sequence[tuple[int, MotionLimits]]
) -> Float:
    """Return the requested acceleration (n,) of each move, before the limits of the axes apply."""
    moves = (delta[:, :3] != 0).any(axis=1)
    extrudes = delta[:, 3] != 0
    limit_index = np.zeros(len(delta), np.int64)
    limit_index[[place for place, _ in changes]] = np.arange(1, len(changes) + 1)
    limit_index = np.maximum.accumulate(limit_index)
    accelerations = np.array(
        [
            (one.acceleration, one.travel_acceleration, one.retract_acceleration)
            for one in (limits, *(after for _, after in changes))
        ]
    )[limit_index]
    return np.asarray(
        np.where(extrudes, np.where(moves, accelerations[:, 0], accelerations[:, 2]), accelerations[:, 1])
    )


def _reply_sizes(position: Float, start: BatchStart, others: _OtherCommands) -> Int:
    """Return the number of bytes (n,) in the reply to each command; the reply to G92 reports a position."""
    reply_size = np.full(len(position), _OK_SIZE)
    for place, kind, _ in others:
        if kind == _SET_E_CODE:
            x, y, z, e = position[place].tolist()
            reply_size[place] += start.position_report_length((x, y, z, e))
    return reply_size


def _fill_forward(values: Float, before: float) -> Float:
    """Replace each nan by the last value before it, or by `before` at the start."""
    values = np.append(before, values)
    last = np.maximum.accumulate(np.where(np.isnan(values), 0, np.arange(len(values))))
    return np.asarray(values[last][1:])


def limits_after_count(command_run: CommandRun, count: int, before: MotionLimits) -> MotionLimits:
    """Return the motion limits after the first `count` commands of a run."""
    return next((after for place, after in reversed(command_run.limits) if place < count), before)
