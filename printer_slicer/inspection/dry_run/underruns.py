"""Predict the buffer underruns of a job on a serial link.

With few moves in its buffer the planner slows down, because it must be able to stop after the last known move. With an
empty buffer the machine stands still, with the nozzle on the part. `printer_slicer.link_model` computes the times of
the job twice: for the given link, and for an ideal link without delay. An underrun is a range of moves that start later
and later compared with the ideal link.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Mapping, Sequence
from math import inf
from typing import Final

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.gcode import Moves, apply_limit_change
from printer_slicer.gcode.commands import Effect, find_codes
from printer_slicer.gcode.lexer import parse, parse_extended_command
from printer_slicer.gcode.moves import choose_accelerations
from printer_slicer.link_model import LinkRun, SerialLink, TimedJob, compute_line_sizes
from printer_slicer.motion.rules import MotionLimits
from printer_slicer.motion.vectorized import Blocks, find_nonzero_moves, make_blocks
from printer_slicer.values import Struct, replace

__all__ = ["Underrun", "UnderrunReport", "find_underruns", "make_timed_job"]

_MIN_GAP: Final = 40  # number of commands without delay that separate two underruns
_MIN_SLOWDOWN: Final = 0.05  # share of the ideal duration; a move that takes longer by this share is delayed
_MIN_LOSS: Final = 0.25  # s; a shorter delay is no underrun, because starting from rest may take 0.1 s
_WAITING_COMMANDS: Final = find_codes(Effect.WAITS)


class Underrun(Struct, frozen=True):
    """A range of commands in which the machine slows down or stops because lines arrive too late.

    Attributes:
        first, last: indices of the first and the last command.
        seconds: time lost, s.
        lines_per_second_needed: lines/s that the printer needs there.
        lines_per_second_available: lines/s that the link carries there.
        line, last_line: lines of the file, counted from 1; 0 if unknown.
        layer: counted from 1; 0 before the first.
    """

    first: int
    last: int
    seconds: float
    lines_per_second_needed: float
    lines_per_second_available: float
    line: int = 0
    last_line: int = 0
    layer: int = 0


class UnderrunReport(Struct, frozen=True):
    """The buffer underruns of a job on a link.

    Attributes:
        link: the link.
        underruns: all of them, in order.
        stalls, stalled_seconds: number and total time of complete stops.
        moving_seconds: total time of all moves.
        seconds: from the first line to the end of the last move, without homing, heating and waiting for the user.
        ideal_seconds: the same for an ideal link without delay.
        lines_per_second: throughput of the link for lines of the average length of this job.
    """

    link: SerialLink
    underruns: tuple[Underrun, ...]
    stalls: int
    stalled_seconds: float
    moving_seconds: float
    seconds: float
    ideal_seconds: float
    lines_per_second: float

    @property
    def ok(self) -> bool:
        """Whether the job has no buffer underrun on the link."""
        return not self.underruns


def find_underruns(
    commands: Sequence[bytes],
    moves: Moves,
    limits: MotionLimits,
    link: SerialLink,
    marks: Mapping[int, int] | None = None,
) -> UnderrunReport:
    """Find the buffer underruns of a job on a modelled link.

    Args:
        commands: commands of the job, as they are sent.
        moves: moves of the commands.
        limits: limits of the machine, with its planner.
        link: baud rate and latency of the link, and the window of the host.
        marks: command index -> layer, ascending.
    """
    job = make_timed_job(commands, moves, limits)
    actual = LinkRun(job, link, limits).run()
    ideal = LinkRun(job, replace(link, baud=0, latency_out=0.0, latency_back=0.0), limits).run()
    return UnderrunReport(
        link,
        tuple(_find_ranges(actual.begins, ideal.begins, marks or {})),
        actual.clock.stalls,
        actual.clock.stalled_seconds,
        actual.clock.moving_seconds,
        actual.end,
        ideal.end,
        link.lines_per_second(float(job.sizes.mean())) if len(commands) else inf,
    )


def make_timed_job(commands: Sequence[bytes], moves: Moves, limits: MotionLimits) -> TimedJob:
    """Return how much each command loads the link and the planner; arguments as for `find_underruns`."""
    sizes, reserved_sizes = compute_line_sizes(commands, 0)
    parts: list[Blocks] = []
    lines, changed, begin = [moves.line[:0]], {}, 0
    for first, kind, values in (*moves.changes, (len(moves.line), "", {})):
        selected = slice(begin, first)
        moving, length = find_nonzero_moves(np.ascontiguousarray(moves.delta[selected].T))
        delta = moves.delta[selected][moving]
        acceleration = choose_accelerations(delta, moves.acceleration[selected][moving], limits)
        parts.append(
            make_blocks(
                np.ascontiguousarray(delta.T), length, moves.speed[selected][moving], acceleration, limits
            )
        )
        lines.append(moves.line[selected][moving])
        begin, limits = first, apply_limit_change(limits, kind, values)
        if first < len(moves.line):
            changed[int(moves.line[first])] = limits
    blocks = Blocks(
        *(
            np.concatenate([getattr(part, name) for part in parts], axis=-1)
            for name in Blocks.__struct_fields__
        )
    )
    moving = np.concatenate(lines)
    # Commands that move, such as some homing commands, count only as moves.
    others = np.setdiff1d(np.arange(len(commands)), moving).tolist()
    dwells = {at: seconds for at in others if (seconds := _dwell_seconds(commands[at])) is not None}
    return TimedJob(sizes, reserved_sizes, moving, blocks, dwells, changed)


def _dwell_seconds(command: bytes) -> float | None:
    """Return the duration of a dwell, s; 0 for a wait for heaters or the user; None for other commands."""
    word, values = parse(command)
    if (word or parse_extended_command(command)[0]) not in _WAITING_COMMANDS:
        return None
    if word != b"G4":
        return 0.0
    return values[b"S"] if b"S" in values else values.get(b"P", 0.0) / 1000


def _find_ranges(actual: Float, ideal: Float, marks: Mapping[int, int]) -> Iterable[Underrun]:
    """Find the ranges of moves that start later and later, compared with an ideal link.

    Args:
        actual: (n,) s, start of the first move of each command over the link; nan for commands without a move.
        ideal: (n,) s, the same for an ideal link without delay.
        marks: command index -> layer, ascending.
    """
    commands = np.flatnonzero(~np.isnan(actual))
    actual_steps, ideal_steps = np.diff(actual[commands]), np.diff(ideal[commands])
    held_up = np.flatnonzero(actual_steps - ideal_steps >= _MIN_SLOWDOWN * ideal_steps)
    if not len(held_up):
        return
    cuts = np.flatnonzero(np.diff(held_up) > _MIN_GAP + 1)
    lows, highs = held_up[np.append(0, cuts + 1)], held_up[np.append(cuts, -1)] + 1
    begins = list(marks)
    for first, last in zip(commands[lows].tolist(), commands[highs].tolist(), strict=True):
        ideal_seconds, actual_seconds = float(ideal[last] - ideal[first]), float(actual[last] - actual[first])
        loss, lines = actual_seconds - ideal_seconds, last - first
        if loss < _MIN_LOSS:
            continue
        at = bisect_right(begins, first)
        layer = marks[begins[at - 1]] if at else 0
        needed, available = lines / max(ideal_seconds, 1e-9), lines / actual_seconds
        yield Underrun(first, last, loss, needed, available, layer=layer)
