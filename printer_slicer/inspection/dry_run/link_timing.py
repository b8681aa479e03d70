"""When each line of a stretch is sent, arrives, is executed and answered, for thousands of lines at once.

    sent         when the host has the answer to the line two before it, or to the last one where two are too long
    arrives      when the wire was free, its bytes have gone over it, and the latency is over
    executed     when it has arrived, the line before it was executed, and the planner has a place
    answered     then; the answer takes its own way back

While the planner is never short of moves, the moves do not depend on the lines: `motion.ahead` gives their times. The
lines depend on the moves and on each other; from the earliest that each could be they are put off until nothing
changes any more. Then it is looked at whether the planner was indeed never short, and whether no answer had to wait
for a line that says that the machine is busy; what comes before the first line that was late is so, and the rest is
left to the firmware itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.inspection.dry_run.command_runs import CommandRun
from printer_slicer.motion.ahead import seconds_ahead
from printer_slicer.motion.rules import Block, MotionLimits
from printer_slicer.motion.whole import Blocks, corner_squares, make_blocks, moving_of
from printer_slicer.sim.batch import BatchStart
from printer_slicer.sim.mover import Planned

__all__ = ["Paced", "TimedLink", "WireState", "pace"]

_BITS: Final = 10  # of a byte on the wire
_ROUNDS: Final = 24  # in which lines may put each other off
_SAME: Final = 1e-11  # s
_NEAR: Final = 1e-6  # s; moments this near each other may change places by rounding


class TimedLink(NamedTuple):
    """A serial link and its host.

    Attributes:
        baud: bits/s in both directions; a byte takes ten.
        latency: s that each byte takes in addition, in both directions.
        window_bytes: most bytes in flight, without those kept for a question.
    """

    baud: int
    latency: float
    window_bytes: int

    @property
    def byte_seconds(self) -> float:
        """Seconds of one byte."""
        return _BITS / self.baud


@dataclass(slots=True)
class WireState:
    """Where the conversation stands between two lines.

    Attributes:
        out, back: s, when either direction is free again.
        answered: s, when the host had the answers to the last line but one and to the last.
        executed: s, when the last line was.
        size: bytes of the last line.
    """

    out: float
    back: float
    answered: tuple[float, float]
    executed: float
    size: int

    def send(self, size: int, room: int, link: TimedLink) -> float:
        """Send a line of `size` bytes that is reckoned with `room`; the moment at which it has arrived, s."""
        both = room <= link.window_bytes - self.size
        self.out = max(self.out, self.answered[0 if both else 1]) + size * link.byte_seconds
        self.size = size
        return max(self.out + link.latency, self.executed)

    def say(self, size: int, now: float, link: TimedLink) -> None:
        """The printer says so many bytes at `now`."""
        self.back = max(self.back, now) + size * link.byte_seconds

    def hear(self, now: float, link: TimedLink) -> None:
        """What it has said ends with the answer to the last line, which was executed at `now`."""
        self.answered = (self.answered[1], self.back + link.latency)
        self.executed = now


class Paced(NamedTuple):
    """What became of a stretch.

    Attributes:
        done: how many of its commands were executed without the planner ever being short.
        executed: (done,) s, when.
        wire: how the conversation stands then.
        planned: what is being made and what waits then.
        began: how many of the blocks, those that waited before included, have begun.
        seconds: (began,) s that each takes.
        moving: (m,) the commands that move, all of the stretch.
        blocks: of them.
    """

    done: int
    executed: Float
    wire: WireState
    planned: Planned
    began: int
    seconds: Float
    moving: Int
    blocks: Blocks


def pace(
    stretch: CommandRun, sizes: tuple[Int, Int], before: BatchStart, wire: WireState, link: TimedLink
) -> Paced:
    """Send a stretch to a machine that moves.

    Args:
        stretch: of commands.
        sizes: (n,) bytes of their lines, twice; see `Chunk`.
        before: the printer before it.
        wire: how the conversation stands.
        link: what it goes over.
    """
    limits, planned, filament = before.limits, before.planned, before.filament
    moving, length = moving_of(np.ascontiguousarray(stretch.delta.T))
    fresh = make_blocks(
        np.ascontiguousarray(stretch.delta[moving].T),
        length,
        stretch.speed[moving],
        stretch.acceleration[moving],
        limits,
    )
    blocks, corners = _with_waiting(planned, fresh, limits)
    waiting, places = len(planned.queue), max(limits.planner_blocks - 1, 1)
    seconds, squares = seconds_ahead(blocks, corners, places - 2, planned.square)
    # ends[k] is when the block before block k ends, and block k begins.
    ends = np.append(planned.ends, planned.ends + np.cumsum(seconds))
    # The block that each command would be the next to plan, and the last that is planned behind it.
    following = waiting + np.searchsorted(moving, np.arange(len(stretch)))
    last = following - 1 + np.isin(np.arange(len(stretch)), moving, assume_unique=True)
    place_at = np.where(last > following - 1, _at(ends, last - places + 1, -np.inf), -np.inf)
    in_time = ends[np.clip(following - places + 2, 0, len(ends) - 1)]
    talk = _conversation(stretch, sizes, place_at, wire, link)
    begun = np.maximum(talk.arrived, np.append(wire.executed, talk.executed[:-1]))
    late = (begun >= in_time) | _told_of_late(talk.executed - begun, before, link)
    count = min(int(late.argmax()) if late.any() else len(stretch), talk.sure)
    if count == 0:
        return Paced(0, ends[:0], wire, planned, 0, seconds[:0], moving, fresh)
    began = int(np.searchsorted(ends, talk.executed[count - 1], side="right"))
    pushed = int(last[count - 1]) + 1
    targets = _targets(planned, stretch, moving, filament)[: pushed + 1]
    return Paced(
        count,
        talk.executed[:count],
        talk.wire_behind(count, int(sizes[0][count - 1])),
        _planned_after(planned, (blocks, corners, squares, ends), targets, (began, pushed)),
        began,
        seconds[:began],
        moving,
        fresh,
    )


def _told_of_late(waits: Float, before: BatchStart, link: TimedLink) -> Bool:
    """(n,) before which answers the machine said so late that it is busy that the answer comes behind that."""
    if before.busy_seconds <= 0:
        return np.zeros(len(waits), np.bool_)
    rest = (waits + _NEAR) % before.busy_seconds
    return np.asarray(
        (waits + _NEAR >= before.busy_seconds) & (rest < before.busy_bytes * link.byte_seconds + 2 * _NEAR)
    )


def _with_waiting(planned: Planned, fresh: Blocks, limits: MotionLimits) -> tuple[Blocks, Float]:
    """The blocks that wait and the new ones, and the squared speed of the corner before each."""
    old = [block for block, _ in planned.queue]
    waiting = Blocks(
        np.array([block.length for block in old]),
        np.array([block.unit for block in old]).reshape(-1, 4).T,
        np.array([block.speed for block in old]),
        np.array([block.acceleration for block in old]),
        np.array([block.share for block in old]),
    )
    blocks = _joined(waiting, fresh)
    known = np.array([corner for _, corner in planned.queue])
    if not len(fresh.length):
        return blocks, known
    last = planned.last
    assert last is not None
    one = Blocks(
        np.array([last.length]),
        np.array([last.unit]).T,
        np.array([last.speed]),
        np.array([last.acceleration]),
        np.array([last.share]),
    )
    row = _joined(one, fresh)
    return blocks, np.append(known, corner_squares(limits, row.part(np.s_[:-1]), row.part(np.s_[1:])))


def _joined(first: Blocks, second: Blocks) -> Blocks:
    """One behind the other."""
    return Blocks(
        np.append(first.length, second.length),
        np.append(first.unit, second.unit, axis=1),
        np.append(first.speed, second.speed),
        np.append(first.acceleration, second.acceleration),
        np.append(first.share, second.share),
    )


def _at(values: Float, index: Int, before: float) -> Float:
    """The values at these places; `before` for places before the first."""
    return np.asarray(np.where(index >= 0, values[np.clip(index, 0, len(values) - 1)], before))


class _Talk(NamedTuple):
    """When things happen, s.

    Attributes:
        sent, arrived, executed: (n,) when each line has gone out, has arrived, is executed.
        free: (n,) when the way back is free behind its answer.
        answers: (n + 2,) the moments of all answers, from the two before the first line on.
        sure: how many of the first lines will not be put off any more.
    """

    sent: Float
    arrived: Float
    executed: Float
    free: Float
    answers: Float
    sure: int

    def wire_behind(self, count: int, size: int) -> WireState:
        """How the conversation stands behind the first `count` lines, the last of which has `size` bytes."""
        return WireState(
            float(self.sent[count - 1]),
            float(self.free[count - 1]),
            (float(self.answers[count]), float(self.answers[count + 1])),
            float(self.executed[count - 1]),
            size,
        )


def _conversation(
    stretch: CommandRun, sizes: tuple[Int, Int], place_at: Float, wire: WireState, link: TimedLink
) -> _Talk:
    """How the lines go back and forth if the planner has a place for each at `place_at`, (n,) s."""
    size, room = sizes
    byte = link.byte_seconds
    both = room <= link.window_bytes - np.append(wire.size, size[:-1])
    # What is to be waited for: the answer to the line two before, or to the one before.
    awaited = np.arange(len(size)) + np.where(both, 0, 1)
    out, back = np.asarray(size * byte), np.asarray(stretch.answer * byte)
    earliest = np.maximum.accumulate(np.maximum(place_at, wire.executed))
    executed, sure = earliest, 0
    for _ in range(_ROUNDS):
        free = _queued(executed, back, wire.back)
        answers = np.concatenate([wire.answered, free + link.latency])
        sent = _queued(answers[awaited], out, wire.out)
        arrived = sent + link.latency
        later = np.maximum(earliest, np.maximum.accumulate(arrived))
        moved = later > executed + _SAME
        sure = int(moved.argmax()) if moved.any() else len(size)
        if sure == len(size):
            break
        executed = later
    return _Talk(sent, arrived, executed, free, answers, sure)


def _queued(wanted: Float, takes: Float, free: float) -> Float:
    """(n,) s, when each of some things that take their time one behind the other is done; none begins before wanted."""
    total = np.cumsum(takes)
    return np.asarray(total + np.maximum(free, np.maximum.accumulate(wanted - (total - takes))))


def _targets(planned: Planned, stretch: CommandRun, moving: Int, filament: float) -> Float:
    """(b + 1, 4) where the running block, each that waited, and each new one ends; e as filament fed."""
    fed = filament + np.cumsum(stretch.delta[moving, 3])
    new = np.column_stack([stretch.position[moving, :3], fed])
    return np.concatenate([np.array(planned.targets).reshape(-1, 4), new])


def _planned_after(
    planned: Planned,
    reckoned: tuple[Blocks, Float, Float, Float],
    targets: Float,
    counts: tuple[int, int],
) -> Planned:
    """What is being made and what waits when `began` blocks have begun and `pushed` were planned."""
    blocks, corners, squares, ends = reckoned
    began, pushed = counts
    rows = [tuple(row) for row in targets[max(began - 1, 0) :].tolist()]
    queue = [(_block(blocks, at), float(corners[at])) for at in range(began, pushed)]
    after = planned._replace(queue=tuple(queue), last=_block(blocks, pushed - 1) if pushed else planned.last)
    if began == 0:
        return after._replace(targets=tuple(rows))
    return after._replace(
        square=float(squares[began - 1]),
        targets=tuple(rows[1:]),
        standing=rows[0],
        began=float(ends[began - 1]),
        ends=float(ends[began]),
    )


def _block(blocks: Blocks, at: int) -> Block:
    """One of the blocks by itself."""
    x, y, z, e = blocks.unit[:, at].tolist()
    return Block(
        float(blocks.length[at]),
        (x, y, z, e),
        float(blocks.speed[at]),
        float(blocks.acceleration[at]),
        float(blocks.share[at]),
    )
