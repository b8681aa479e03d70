"""Where a link is too slow for a file: every line over the wire, every move through the planner, by an invented clock.

The host sends a line when it may: some lines and some bytes in flight, a byte after the other. The firmware answers a
move when the planner has a place for it, and the answer takes its own time back. Where the planner runs short the
machine brakes, for it must be able to stop behind the last move it knows, and where it runs dry it stands still, with
the nozzle on the part. That is what the simulated printer does too; here it is told beforehand, and where.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from itertools import pairwise
from math import inf, isnan
from typing import Final

from printer_slicer.gcode import Moves, changed_limits
from printer_slicer.gcode.commands import Effect, commands_that
from printer_slicer.gcode.lexer import extended, parse
from printer_slicer.motion.planner_clock import PlannerClock
from printer_slicer.motion.rules import Block, MotionLimits, make_block
from printer_slicer.stream.flight import QUESTION_ROOM
from printer_slicer.stream.framing import frame

__all__ = ["Feasibility", "Link", "SlowStretch", "feasibility"]

_BITS: Final = 10  # of a byte on the wire
_OK: Final = 3  # bytes of an answer
_GREETING: Final = 2  # numbered lines before the job
_APART: Final = 40  # commands without a loss between two stretches
_FELT: Final = 0.05  # of its own time, by which a move that takes longer is held up
_WORTH: Final = 0.25  # s lost in a stretch; a machine that sets out from rest may wait 0.1 s anyway
_STANDS: Final = commands_that(Effect.WAITS)


@dataclass(frozen=True, slots=True)
class Link:
    """A cable and how the host uses it.

    Attributes:
        baud: bits/s of both directions; a byte takes ten.
        latency_out: s that every byte to the printer takes in addition.
        latency_back: s that every byte from it does.
        window_lines: most lines in flight.
        window_bytes: most bytes in flight.
    """

    baud: int
    latency_out: float = 0.0
    latency_back: float = 0.001
    window_lines: int = 2
    window_bytes: int = 127

    def lines_per_second(self, size: float) -> float:
        """Most lines of `size` bytes that it carries: the wire, or the wait for answers."""
        byte = _BITS / self.baud
        there_and_back = (size + _OK) * byte + self.latency_out + self.latency_back
        abreast = max(1.0, min(self.window_lines, (self.window_bytes - QUESTION_ROOM) // size))
        return min(1 / (size * byte), abreast / there_and_back)


@dataclass(frozen=True, slots=True)
class SlowStretch:
    """Commands during which the machine is slower, or stands still, because lines do not come.

    Attributes:
        first, last: indices of the commands.
        seconds: lost.
        wanted: lines/s that the machine could take there.
        possible: lines/s that come.
        line, last_line: of the text, counted from 1; 0 if not known.
        layer: counted from 1; 0 before the first.
    """

    first: int
    last: int
    seconds: float
    wanted: float
    possible: float
    line: int = 0
    last_line: int = 0
    layer: int = 0


@dataclass(frozen=True, slots=True)
class Feasibility:
    """What a link makes of a job.

    Attributes:
        link: it.
        stretches: where the machine is slower for it, in order.
        stalls, stalled_seconds: how often and how long it stands still.
        moving_seconds: of all moves.
        seconds: from the first line to the end of the last move; homing, heating and people are not counted.
        unhindered: the same where lines take no time.
        lines_per_second: most that the link carries of lines as long as these are on average.
    """

    link: Link
    stretches: tuple[SlowStretch, ...]
    stalls: int
    stalled_seconds: float
    moving_seconds: float
    seconds: float
    unhindered: float
    lines_per_second: float

    @property
    def ok(self) -> bool:
        """Whether nothing is lost that anybody would see."""
        return not self.stretches


def feasibility(
    commands: Sequence[bytes],
    moves: Moves,
    limits: MotionLimits,
    link: Link,
    marks: Mapping[int, int] | None = None,
) -> Feasibility:
    """Send a job over a link that is only imagined.

    Args:
        commands: of the job, as they are sent.
        moves: of them.
        limits: of the machine, with its planner.
        link: the cable, and the host's window.
        marks: command index -> layer, ascending.
    """
    sizes = [len(frame(number, one)) + 1 for number, one in enumerate(commands, _GREETING + 1)]
    steps = list(_steps(commands, moves, limits))
    real = _Run(link, limits)
    real.send(sizes, steps)
    free = _Run(replace(link, baud=0, latency_out=0.0, latency_back=0.0), limits)
    free.send(sizes, steps)
    mean = sum(sizes) / max(len(sizes), 1)
    return Feasibility(
        link,
        tuple(_stretches(real, free, marks or {})),
        real.clock.stalls,
        real.clock.stalled_seconds,
        real.clock.moving_seconds,
        real.end,
        free.end,
        link.lines_per_second(mean) if mean else inf,
    )


_Step = tuple[tuple[Block, ...], MotionLimits | None, float | None]
"""Of a command: its blocks, the limits that it sets, and the s that it stands still; None: it does not."""


def _steps(commands: Sequence[bytes], moves: Moves, limits: MotionLimits) -> Iterable[_Step]:
    """What each command does to the planner."""
    table = zip(
        moves.line.tolist(),
        moves.delta.tolist(),
        moves.speed.tolist(),
        moves.acceleration.tolist(),
        strict=True,
    )
    changes = {first: (kind, values) for first, kind, values in moves.changes}
    upcoming = next(table, None)
    count = 0
    block_of = _block_maker(limits)
    for index, command in enumerate(commands):
        blocks: list[Block] = []
        new: MotionLimits | None = None
        while upcoming is not None and upcoming[0] == index:
            if count in changes:
                limits = new = changed_limits(limits, *changes[count])
                block_of = _block_maker(limits)
            _, delta, speed, acceleration = upcoming
            block = block_of(delta, speed, acceleration)
            blocks += [block] if block else []
            count += 1
            upcoming = next(table, None)
        yield tuple(blocks), new, _still(command) if not blocks else None


def _block_maker(limits: MotionLimits) -> Callable[[list[float], float, float], Block | None]:
    """Makes blocks under limits, with an acceleration that the file may have set."""

    @cache
    def with_acceleration(value: float) -> MotionLimits:
        return replace(limits, acceleration=value, travel_acceleration=value, retract_acceleration=value)

    def make(delta: list[float], speed: float, acceleration: float) -> Block | None:
        """One block, None where nothing moves."""
        x, y, z, e = delta
        own = limits if isnan(acceleration) else with_acceleration(acceleration)
        return make_block(own, (x, y, z, e), speed)

    return make


def _still(command: bytes) -> float | None:
    """Seconds that a command stands still, None if it does not; what it waits for besides is not counted."""
    word, values = parse(command)
    if (word or extended(command)[0]) not in _STANDS:
        return None
    if word != b"G4":
        return 0.0
    return values[b"S"] if b"S" in values else values.get(b"P", 0.0) / 1000


@dataclass(slots=True)
class _Run:
    """One way of a job over a link.

    Attributes:
        begun: command index -> s at which its first move begins.
        end: s at which the last move was made.
    """

    link: Link
    limits: MotionLimits
    begun: dict[int, float] = field(default_factory=dict)
    end: float = 0.0
    clock: PlannerClock = field(init=False)

    def __post_init__(self) -> None:
        self.clock = PlannerClock(self.limits, self._begins)

    def _begins(self, command: int, now: float) -> None:
        """A move begins; of the pieces of an arc the first one counts."""
        self.begun.setdefault(command, now)

    def send(self, sizes: Sequence[int], steps: Sequence[_Step]) -> None:
        """Send all lines."""
        link = self.link
        byte = _BITS / link.baud if link.baud else 0.0
        answered: list[float] = []  # s at which the host has each ok
        wire_out = wire_back = done = 0.0
        oldest = in_flight = 0
        for index, (size, step) in enumerate(zip(sizes, steps, strict=True)):
            room = link.window_bytes - QUESTION_ROOM - size
            now = answered[oldest - 1] if oldest else 0.0
            while oldest < index and (index - oldest >= link.window_lines or in_flight > room):
                now = answered[oldest]
                in_flight -= sizes[oldest]
                oldest += 1
            wire_out = max(wire_out, now) + size * byte
            in_flight += size
            done = self._execute(index, step, max(wire_out + link.latency_out, done))
            wire_back = max(wire_back, done) + _OK * byte
            answered.append(wire_back + link.latency_back)
        self.end = self.clock.stand_still(done)

    def _execute(self, index: int, step: _Step, now: float) -> float:
        """The moment at which a command that arrived at `now` is answered."""
        blocks, limits, still = step
        if limits is not None:
            self.clock.set_limits(limits)
        for block in blocks:
            now = self.clock.push(block, now, index)
        return now if still is None else self.clock.stand_still(now) + still


def _stretches(real: _Run, free: _Run, marks: Mapping[int, int]) -> Iterable[SlowStretch]:
    """Moves that follow each other closely and begin later and later, against those of the other run."""
    commands = list(real.begun)
    takes = [after - before for before, after in pairwise(real.begun.values())]
    would = [after - before for before, after in pairwise(free.begun.values())]
    groups: list[list[int]] = []
    for place, (one, other) in enumerate(zip(takes, would, strict=True)):
        if one - other < _FELT * other:
            continue
        if groups and place - groups[-1][1] <= _APART:
            groups[-1][1] = place + 1
        else:
            groups.append([place, place + 1])
    begins = list(marks)
    for low, high in groups:
        first, last = commands[low], commands[high]
        wanted, needed = (run.begun[last] - run.begun[first] for run in (free, real))
        if needed - wanted < _WORTH:
            continue
        at = bisect_right(begins, first)
        layer = marks[begins[at - 1]] if at else 0
        lines = last - first
        yield SlowStretch(
            first, last, needed - wanted, lines / max(wanted, 1e-9), lines / needed, layer=layer
        )
