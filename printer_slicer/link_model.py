"""The link to a printer: when each line is sent, arrives, is executed and acknowledged, and where the planner runs dry.

    sent           when the wire is free and the lines in flight leave room: so many lines, so many bytes
    arrives        when its bytes have gone over the wire and the latency is over
    executed       when it has arrived, the line before it was executed, and the planner has a place for its moves
    acknowledged   then; the answer takes its own way back

`LinkState` follows one line after the other. `send_batch` gives the same times for thousands of lines at once, as far
as the planner is never short of moves: then the moves do not depend on the lines, and `motion.ahead` gives their
times. The lines depend on the moves and on each other; from the earliest that each could be they are put off until
nothing changes any more. What comes before the first line that was too late is so. The rest is for a model of the
planner that takes moves one by one: `LinkRun` alternates with `motion.planner_clock`, a dry run with the simulated
firmware.

While a part is sliced there are no lines yet. Then a link is a number of lines per second, and `lateness` says how far
they fall behind the moves.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np

from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.motion.planner_clock import PlannerClock, PlannerState
from printer_slicer.motion.rules import Block, MotionLimits
from printer_slicer.motion.vectorized import Blocks, corner_squares
from printer_slicer.motion.vectorized_lookahead import lookahead_seconds
from printer_slicer.stream.window import QUESTION_ROOM

__all__ = [
    "GREETING_LINES",
    "BatchRetry",
    "BatchTimes",
    "LineBatch",
    "LinkRun",
    "LinkState",
    "SerialLink",
    "TimedJob",
    "block_at",
    "can_batch",
    "lateness",
    "line_sizes",
    "send_batch",
]

GREETING_LINES: Final = 2
"""Numbered lines before the first of a job."""

_BITS: Final = 10  # of a byte on the wire
_OK: Final = len("ok\n")
_ROUNDS: Final = 24  # in which lines may put each other off
_SAME: Final = 1e-11  # s
_NEAR: Final = 1e-6  # s; moments this near each other may change places by rounding
_AT_ONCE: Final = (256, 8192)  # lines in a batch, at first and behind others that went well
_WORTH: Final = 48  # lines from which on a batch is worth its cost
_PAUSE: Final = (16, 256)  # lines that go one by one after a batch that failed, at first and at most


@dataclass(frozen=True, slots=True)
class SerialLink:
    """A cable and how the host uses it.

    Attributes:
        baud: bits/s of both directions; a byte takes ten. 0: bytes take no time.
        latency_out: s that every byte to the printer takes in addition.
        latency_back: s that every byte from it does.
        window_lines: most lines in flight.
        window_bytes: most bytes in flight, those that the host keeps for a question included.
    """

    baud: int
    latency_out: float = 0.0
    latency_back: float = 0.001
    window_lines: int = 2
    window_bytes: int = 127

    @property
    def byte_seconds(self) -> float:
        """Seconds of one byte."""
        return _BITS / self.baud if self.baud else 0.0

    @property
    def line_bytes(self) -> int:
        """Most bytes of lines in flight."""
        return self.window_bytes - QUESTION_ROOM

    def lines_per_second(self, size: float) -> float:
        """Most lines of `size` bytes that it carries: the wire, or the wait for answers."""
        byte = self.byte_seconds
        there_and_back = (size + _OK) * byte + self.latency_out + self.latency_back
        abreast = max(1.0, min(self.window_lines, self.line_bytes // size))
        return min(1 / (size * byte), abreast / there_and_back)


def lateness(begins: Float, takes: Float) -> Float:
    """How far lines fall behind the moves that they bring, on a link of so many lines per second.

    Args:
        begins: (K,) s, when each move begins if lines take no time.
        takes: (K,) s that the link needs for the lines of each.

    Returns:
        (K,) s, 0 where the lines of a move have caught up. Nothing waits as long as the planner holds that much.
    """
    late = np.zeros(len(begins))
    late[1:] = np.maximum(_queue(begins[:-1], takes[1:], -np.inf) - begins[1:], 0.0)
    return late


def line_sizes(commands: Sequence[bytes], first: int) -> tuple[Int, Int]:
    """(n,) bytes of each line on the wire with number, checksum and line break; and those the host reckons with.

    Args:
        commands: without comments.
        first: index in the job of the first of them.
    """
    text = np.frombuffer(b"\n".join(commands) + b"\n", np.uint8)
    ends = np.flatnonzero(text == ord("\n"))
    begins = np.append(0, ends[:-1] + 1)
    own = ends - begins
    # Each line break is in the sum of its line, and taken out again.
    check = np.bitwise_xor.reduceat(text, begins).astype(np.int64) ^ ord("\n")
    number = first + np.arange(len(commands)) + GREETING_LINES + 1
    check ^= ord("N") ^ ord(" ")
    digits = np.ones(len(number), np.int64)
    rest = number
    while rest.any():
        check ^= np.where(rest > 0, rest % 10 + ord("0"), 0)
        rest = rest // 10
        digits += rest > 0
    shown = 1 + (check > 9) + (check > 99)
    # N, number, blank, command, star, checksum, line break.
    return 1 + digits + 1 + own + 1 + shown + 1, 1 + digits + 1 + own + 1 + 3 + 1


@dataclass(slots=True)
class LinkState:
    """Where the conversation stands between two lines.

    Attributes:
        link: what it goes over.
        out, back: s, when either direction is free again.
        answered: s, when the host had the answers to the last `window_lines` lines, the oldest first.
        sizes: bytes of the last lines, one less than that.
        executed: s, when the last line was.
    """

    link: SerialLink
    out: float
    back: float
    answered: tuple[float, ...]
    sizes: tuple[int, ...]
    executed: float

    @classmethod
    def idle(cls, link: SerialLink, now: float) -> LinkState:
        """Nothing is in flight at `now`, s."""
        return cls(link, now, now, (now,) * link.window_lines, (0,) * (link.window_lines - 1), now)

    def send(self, size: int, room: int) -> float:
        """Send a line of `size` bytes for which the host wants `room`; the moment at which it has arrived, s."""
        left, awaited = self.link.line_bytes - room, len(self.answered)
        for place, one in enumerate(reversed(self.sizes), start=1):
            left -= one
            if left < 0:
                awaited = place
                break
        self.out = max(self.out, self.answered[-awaited]) + size * self.link.byte_seconds
        self.sizes = (*self.sizes, size)[1:]
        return max(self.out + self.link.latency_out, self.executed)

    def answer(self, size: int, now: float) -> None:
        """The printer says so many bytes at `now`."""
        self.back = max(self.back, now) + size * self.link.byte_seconds

    def acknowledge(self, now: float) -> None:
        """What it has said ends with the answer to the last line, which was executed at `now`."""
        self.answered = (*self.answered, self.back + self.link.latency_back)[1:]
        self.executed = now

    def wait_for_all(self) -> None:
        """The host sends nothing before it has the answer to the last line."""
        self.answered = (self.answered[-1],) * len(self.answered)


class BatchRetry:
    """When a batch is tried again after one that did not get far: after 16 lines, then after 32, up to 256."""

    def __init__(self) -> None:
        self._pause, self._left = _PAUSE[0], 0

    def is_due(self, lines: int) -> bool:
        """Whether so many lines shall be tried as a batch."""
        return self._left <= 0 and lines >= _WORTH

    def tried(self, count: int) -> None:
        """So many lines of a batch went well."""
        good = count >= _WORTH
        self._pause = _PAUSE[0] if good else min(2 * self._pause, _PAUSE[1])
        self._left = 0 if good else self._pause

    def sent_one(self) -> None:
        """A line went by itself."""
        self._left -= 1


@dataclass(frozen=True, slots=True, eq=False)
class LineBatch:
    """Lines that follow each other, and the moves that they bring.

    Attributes:
        sizes, rooms: (n,) bytes of each, as `line_sizes` gives them.
        answers: (n,) bytes of what is said to each.
        moving: (m,) the line of each move, ascending.
        blocks: the m moves.
    """

    sizes: Int
    rooms: Int
    answers: Int
    moving: Int
    blocks: Blocks


class BatchTimes(NamedTuple):
    """What became of a batch.

    Attributes:
        done: how many of its lines were executed without the planner ever being short.
        executed: (done,) s, when.
        state: of the link then.
        planner: what is being made and what waits then.
        begins: s, when each move began that did; those that waited before the batch come first.
        seconds: that each of them takes.
        pushed: how many moves the planner was given, those that waited before included.
    """

    done: int
    executed: Float
    state: LinkState
    planner: PlannerState
    begins: Float
    seconds: Float
    pushed: int


def can_batch(limits: MotionLimits) -> bool:
    """Whether `send_batch` knows planners of this kind."""
    return limits.minimum_cruise_ratio == 0 and limits.planner_blocks >= 4


def send_batch(
    lines: LineBatch,
    planner: PlannerState,
    state: LinkState,
    limits: MotionLimits,
    busy: tuple[float, int] = (0.0, 0),
) -> BatchTimes:
    """Send lines to a machine that moves.

    Args:
        lines: they.
        planner: before them.
        state: of the link before them.
        limits: of the machine, with its planner; see `can_batch`.
        busy: s after which, again and again, a machine that waits says that it is busy, 0: never; and bytes of that.
    """
    blocks, corners = _with_waiting(planner, lines.blocks, limits)
    waiting, places = len(planner.queue), max(limits.planner_blocks - 1, 1)
    seconds, squares = lookahead_seconds(blocks, corners, places - 2, planner.square)
    # ends[k] is when the block before block k ends, and block k begins.
    ends = np.append(planner.ends, planner.ends + np.cumsum(seconds))
    # The block that each line would be the next to plan, and the last that is planned behind it.
    number = np.arange(len(lines.sizes))
    following = waiting + np.searchsorted(lines.moving, number)
    last = waiting + np.searchsorted(lines.moving, number, side="right") - 1
    place_at = np.where(last >= following, _at(ends, last - places + 1, -np.inf), -np.inf)
    in_time = ends[np.clip(following - places + 2, 0, len(ends) - 1)]
    talk = _conversation(lines, place_at, state)
    begun = np.maximum(talk.arrived, np.append(state.executed, talk.executed[:-1]))
    late = (begun >= in_time) | _answered_late(talk.executed - begun, busy, state.link)
    count = min(int(late.argmax()) if late.any() else len(number), talk.sure)
    if count == 0:
        return BatchTimes(0, ends[:0], state, planner, ends[:0], seconds[:0], waiting)
    began = int(np.searchsorted(ends, talk.executed[count - 1], side="right"))
    pushed = int(last[count - 1]) + 1
    after = PlannerState(
        tuple((block_at(blocks, at), float(corners[at])) for at in range(began, pushed)),
        block_at(blocks, pushed - 1) if pushed else planner.last,
        float(squares[began - 1]) if began else planner.square,
        float(ends[began]),
    )
    behind = talk.state_behind(count, lines, state)
    return BatchTimes(count, talk.executed[:count], behind, after, ends[:began], seconds[:began], pushed)


def _answered_late(waits: Float, busy: tuple[float, int], link: SerialLink) -> Bool:
    """(n,) before which answers the machine said so late that it is busy that the answer comes behind that."""
    every, size = busy
    if every <= 0:
        return np.zeros(len(waits), np.bool_)
    rest = (waits + _NEAR) % every
    return np.asarray((waits + _NEAR >= every) & (rest < size * link.byte_seconds + 2 * _NEAR))


def _with_waiting(planner: PlannerState, fresh: Blocks, limits: MotionLimits) -> tuple[Blocks, Float]:
    """The blocks that wait and the new ones, and the squared speed of the corner before each."""
    blocks = _joined(_columns([block for block, _ in planner.queue]), fresh)
    known = np.array([corner for _, corner in planner.queue])
    if not len(fresh.length):
        return blocks, known
    assert planner.last is not None
    row = _joined(_columns([planner.last]), fresh)
    return blocks, np.append(known, corner_squares(limits, row.part(np.s_[:-1]), row.part(np.s_[1:])))


def _columns(blocks: Sequence[Block]) -> Blocks:
    """Blocks as arrays."""
    return Blocks(
        np.array([block.length for block in blocks]),
        np.array([block.unit for block in blocks]).reshape(-1, 4).T,
        np.array([block.speed for block in blocks]),
        np.array([block.acceleration for block in blocks]),
        np.array([block.share for block in blocks]),
    )


def _joined(first: Blocks, second: Blocks) -> Blocks:
    """One behind the other."""
    return Blocks(
        np.append(first.length, second.length),
        np.append(first.unit, second.unit, axis=1),
        np.append(first.speed, second.speed),
        np.append(first.acceleration, second.acceleration),
        np.append(first.share, second.share),
    )


def block_at(blocks: Blocks, at: int) -> Block:
    """One of the blocks by itself."""
    x, y, z, e = blocks.unit[:, at].tolist()
    return Block(
        float(blocks.length[at]),
        (x, y, z, e),
        float(blocks.speed[at]),
        float(blocks.acceleration[at]),
        float(blocks.share[at]),
    )


def _at(values: Float, index: Int, before: float) -> Float:
    """The values at these places; `before` for places before the first."""
    return np.asarray(np.where(index >= 0, values[np.clip(index, 0, len(values) - 1)], before))


class _Talk(NamedTuple):
    """When things happen, s.

    Attributes:
        sent, arrived, executed: (n,) when each line has gone out, has arrived, is executed.
        free: (n,) when the way back is free behind its answer.
        answers: (window_lines + n,) the moments of all answers, those of `LinkState.answered` first.
        sure: how many of the first lines will not be put off any more.
    """

    sent: Float
    arrived: Float
    executed: Float
    free: Float
    answers: Float
    sure: int

    def state_behind(self, count: int, lines: LineBatch, before: LinkState) -> LinkState:
        """The link behind the first `count` lines."""
        sizes = np.concatenate([before.sizes, lines.sizes[:count]])[count:].astype(np.int64)
        return LinkState(
            before.link,
            float(self.sent[count - 1]),
            float(self.free[count - 1]),
            tuple(self.answers[count : count + before.link.window_lines].tolist()),
            tuple(sizes.tolist()),
            float(self.executed[count - 1]),
        )


def _conversation(lines: LineBatch, place_at: Float, state: LinkState) -> _Talk:
    """How the lines go back and forth if the planner has a place for each at `place_at`, (n,) s."""
    link = state.link
    awaited = _awaited(lines, state)
    out, back = (np.asarray(one * link.byte_seconds) for one in (lines.sizes, lines.answers))
    earliest = np.maximum.accumulate(np.maximum(place_at, state.executed))
    executed, sure = earliest, 0
    for _ in range(_ROUNDS):
        free = _queue(executed, back, state.back)
        answers = np.concatenate([state.answered, free + link.latency_back])
        sent = _queue(answers[awaited], out, state.out)
        arrived = sent + link.latency_out
        later = np.maximum(earliest, np.maximum.accumulate(arrived))
        moved = later > executed + _SAME
        sure = int(moved.argmax()) if moved.any() else len(executed)
        if sure == len(executed):
            break
        executed = later
    return _Talk(sent, arrived, executed, free, answers, sure)


def _awaited(lines: LineBatch, state: LinkState) -> Int:
    """(n,) which answer each line waits for, as a place in `_Talk.answers`."""
    number, before = np.arange(len(lines.sizes)), len(state.sizes)
    # Bytes sent before each line; those of lines before the batch that may still be in flight come first.
    total = np.cumsum(np.concatenate([[0], state.sizes, lines.sizes]).astype(np.int64))
    needed = total[number + before] + lines.rooms - state.link.line_bytes
    return np.asarray(np.clip(np.searchsorted(total, needed), number, number + before))


def _queue(wanted: Float, takes: Float, free: float) -> Float:
    """When each of some things is done that take their time one behind the other.

    Args:
        wanted: (n,) s before which each does not begin.
        takes: (n,) s that it takes.
        free: s, when the first may begin.
    """
    total = np.cumsum(takes)
    return np.asarray(total + np.maximum(free, np.maximum.accumulate(wanted - (total - takes))))


@dataclass(frozen=True, slots=True, eq=False)
class TimedJob:
    """What a job asks of the link and of the planner.

    Attributes:
        sizes, rooms: (n,) bytes of its lines, as `line_sizes` gives them.
        moving: (m,) the line of each move, ascending; an arc is several moves.
        blocks: the m moves.
        stands: line -> s that the machine stands still there, once all moves before it are made.
        limits: line -> limits of the machine that hold from there on.
    """

    sizes: Int
    rooms: Int
    moving: Int
    blocks: Blocks
    stands: Mapping[int, float]
    limits: Mapping[int, MotionLimits]


@dataclass(slots=True)
class LinkRun:
    """One way of a job over a link.

    Attributes:
        job, link: they.
        limits: of the machine, with its planner.
        begins: (n,) s at which the first move of each line begins; nan of lines without one.
        end: s at which the last move was made.
        clock: the planner.
        batched: lines whose times were computed many at once.
    """

    job: TimedJob
    link: SerialLink
    limits: MotionLimits
    begins: Float = field(init=False)
    end: float = 0.0
    clock: PlannerClock = field(init=False)
    batched: int = 0
    _state: LinkState = field(init=False)
    _breaks: list[int] = field(init=False)
    _first_move: list[int] = field(init=False)  # of each line, and the number of moves

    def __post_init__(self) -> None:
        self.begins = np.full(len(self.job.sizes), np.nan)
        self.clock = PlannerClock(self.limits, self._begin)
        self._state = LinkState.idle(self.link, 0.0)
        self._first_move = np.searchsorted(self.job.moving, np.arange(len(self.job.sizes) + 1)).tolist()
        self._breaks = sorted({*self.job.stands, *self.job.limits, len(self.job.sizes)})

    def run(self) -> LinkRun:
        """Send all lines."""
        at, retry, most = 0, BatchRetry(), _AT_ONCE[0]
        while at < len(self.job.sizes):
            end = min(self._breaks[bisect_left(self._breaks, at)], at + most)
            count = 0
            if retry.is_due(end - at):
                count = self._send_batch(at, end)
                retry.tried(count)
                most = min(2 * most, _AT_ONCE[1]) if count == end - at else _AT_ONCE[0]
            if not count:
                self._send_one(at)
                retry.sent_one()
                count = 1
            at += count
        self.end = self.clock.stand_still(self._state.executed)
        return self

    def _begin(self, line: int, now: float) -> None:
        """A move begins; of the pieces of an arc the first one counts."""
        if np.isnan(self.begins[line]):
            self.begins[line] = now

    def _send_one(self, at: int) -> None:
        """Send one line."""
        job, state = self.job, self._state
        now = state.send(int(job.sizes[at]), int(job.rooms[at]))
        if at in job.limits:
            self.limits = job.limits[at]
            self.clock.set_limits(self.limits)
        for place in range(self._first_move[at], self._first_move[at + 1]):
            now = self.clock.push(block_at(job.blocks, place), now, at)
        if at in job.stands:
            now = self.clock.stand_still(now) + job.stands[at]
        state.answer(_OK, now)
        state.acknowledge(now)

    def _send_batch(self, at: int, end: int) -> int:
        """Send the lines from `at` to before `end`, as far as can be at once; how many that were."""
        planner = self.clock.state(self._state.executed)
        if planner is None or not can_batch(self.limits):
            return 0
        job, own = self.job, slice(at, end)
        moves = slice(self._first_move[at], self._first_move[end])
        lines = LineBatch(
            job.sizes[own],
            job.rooms[own],
            np.full(end - at, _OK),
            job.moving[moves] - at,
            job.blocks.part(moves),
        )
        sent = send_batch(lines, planner, self._state, self.limits)
        if sent.done:
            labels = np.concatenate([self.clock.labels, job.moving[moves]]).astype(np.int64)
            began = len(sent.begins)
            # The first label is that of the running move. An arc has begun with the first of its moves.
            fresh, first = np.unique(labels[1 : began + 1], return_index=True)
            news = np.isnan(self.begins[fresh])
            self.begins[fresh[news]] = sent.begins[first[news]]
            self.clock.skip_to(
                sent.planner, labels[began : sent.pushed + 1].tolist(), float(sent.seconds.sum())
            )
            self._state = sent.state
            self.batched += sent.done
        return sent.done
