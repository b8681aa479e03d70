"""Where a link is too slow for a file: buffer underruns, before anything is printed.

Where the planner runs short the machine brakes, for it must be able to stop behind the last move it knows, and where
it runs dry it stands still, with the nozzle on the part. The job is sent twice over `printer_slicer.link_model`: over
the link, and over one on which lines take no time. Where moves begin later and later, lines do not come in time.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf
from typing import Final

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.gcode import Moves, changed_limits
from printer_slicer.gcode.commands import Effect, commands_that
from printer_slicer.gcode.lexer import parse, parse_extended
from printer_slicer.gcode.moves import accelerations
from printer_slicer.link_model import LinkRun, SerialLink, TimedJob, line_sizes
from printer_slicer.motion.rules import MotionLimits
from printer_slicer.motion.vectorized import Blocks, find_moving, make_blocks

__all__ = ["Underrun", "UnderrunReport", "find_underruns", "timed_job"]

_APART: Final = 40  # commands without a loss between two underruns
_FELT: Final = 0.05  # of its own time, by which a move that takes longer is held up
_WORTH: Final = 0.25  # s lost in an underrun; a machine that sets out from rest may wait 0.1 s anyway
_STANDS: Final = commands_that(Effect.WAITS)


@dataclass(frozen=True, slots=True)
class Underrun:
    """Commands during which the machine is slower, or stands still, because lines do not come.

    Attributes:
        first, last: indices of the commands.
        seconds: lost.
        lines_per_second_needed: lines/s that the printer would need there.
        lines_per_second_available: lines/s that come.
        line, last_line: of the text, counted from 1; 0 if not known.
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


@dataclass(frozen=True, slots=True)
class UnderrunReport:
    """What a link makes of a job.

    Attributes:
        link: it.
        underruns: where the machine is slower for it, in order.
        stalls, stalled_seconds: how often and how long it stands still.
        moving_seconds: of all moves.
        seconds: from the first line to the end of the last move; homing, heating and people are not counted.
        ideal_seconds: the same where lines take no time.
        lines_per_second: most that the link carries of lines as long as these are on average.
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
        """Whether nothing is lost that anybody would see."""
        return not self.underruns


def find_underruns(
    commands: Sequence[bytes],
    moves: Moves,
    limits: MotionLimits,
    link: SerialLink,
    marks: Mapping[int, int] | None = None,
) -> UnderrunReport:
    """Send a job over a link that is only modelled.

    Args:
        commands: of the job, as they are sent.
        moves: of them.
        limits: of the machine, with its planner.
        link: the cable, and the host's window.
        marks: command index -> layer, ascending.
    """
    job = timed_job(commands, moves, limits)
    real = LinkRun(job, link, limits).run()
    free = LinkRun(job, replace(link, baud=0, latency_out=0.0, latency_back=0.0), limits).run()
    return UnderrunReport(
        link,
        tuple(_underruns(real.begins, free.begins, marks or {})),
        real.clock.stalls,
        real.clock.stalled_seconds,
        real.clock.moving_seconds,
        real.end,
        free.end,
        link.lines_per_second(float(job.sizes.mean())) if len(commands) else inf,
    )


def timed_job(commands: Sequence[bytes], moves: Moves, limits: MotionLimits) -> TimedJob:
    """What commands ask of the link and of the planner; arguments as for `find_underruns`."""
    sizes, rooms = line_sizes(commands, 0)
    parts: list[Blocks] = []
    lines, changed, begin = [moves.line[:0]], {}, 0
    for first, kind, values in (*moves.changes, (len(moves.line), "", {})):
        some = slice(begin, first)
        moving, length = find_moving(np.ascontiguousarray(moves.delta[some].T))
        delta = moves.delta[some][moving]
        wanted = accelerations(delta, moves.acceleration[some][moving], limits)
        parts.append(
            make_blocks(np.ascontiguousarray(delta.T), length, moves.speed[some][moving], wanted, limits)
        )
        lines.append(moves.line[some][moving])
        begin, limits = first, changed_limits(limits, kind, values)
        if first < len(moves.line):
            changed[int(moves.line[first])] = limits
    blocks = Blocks(
        *(np.concatenate([getattr(part, name) for part in parts], axis=-1) for name in Blocks.__slots__)
    )
    moving = np.concatenate(lines)
    # A command that moves, as some that home, is taken for its moves.
    others = np.setdiff1d(np.arange(len(commands)), moving).tolist()
    stands = {at: seconds for at in others if (seconds := _stands(commands[at])) is not None}
    return TimedJob(sizes, rooms, moving, blocks, stands, changed)


def _stands(command: bytes) -> float | None:
    """Seconds that a command stands still, None if it does not; what it waits for besides is not counted."""
    word, values = parse(command)
    if (word or parse_extended(command)[0]) not in _STANDS:
        return None
    if word != b"G4":
        return 0.0
    return values[b"S"] if b"S" in values else values.get(b"P", 0.0) / 1000


def _underruns(real: Float, free: Float, marks: Mapping[int, int]) -> Iterable[Underrun]:
    """Moves that follow each other closely and begin later and later.

    Args:
        real: (n,) s at which the first move of each command begins over the link; nan without one.
        free: the same where lines take no time.
        marks: command index -> layer, ascending.
    """
    commands = np.flatnonzero(~np.isnan(real))
    takes, would = np.diff(real[commands]), np.diff(free[commands])
    held_up = np.flatnonzero(takes - would >= _FELT * would)
    if not len(held_up):
        return
    cuts = np.flatnonzero(np.diff(held_up) > _APART + 1)
    lows, highs = held_up[np.append(0, cuts + 1)], held_up[np.append(cuts, -1)] + 1
    begins = list(marks)
    for first, last in zip(commands[lows].tolist(), commands[highs].tolist(), strict=True):
        wanted, needed = float(free[last] - free[first]), float(real[last] - real[first])
        if needed - wanted < _WORTH:
            continue
        at = bisect_right(begins, first)
        layer = marks[begins[at - 1]] if at else 0
        lines = last - first
        yield Underrun(first, last, needed - wanted, lines / max(wanted, 1e-9), lines / needed, layer=layer)
