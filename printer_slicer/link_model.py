"""Model of the serial link: when lines are sent, received, executed and acknowledged, and where buffer underruns occur.

    sent           as soon as the wire is free and the limits of lines and bytes in flight allow it
    received       when its bytes have been transmitted and the latency has passed
    executed       when it was received, the previous line was executed, and the planner has room for its moves
    acknowledged   when it was executed, its answer was transmitted, and the latency has passed

`LinkState` computes this line by line. `send_batch` computes the same times for thousands of lines at once, as long as
the planner never runs out of moves. In this case the times of the moves do not depend on the lines, and
`motion.vectorized_lookahead` computes them. The times of the lines depend on the moves and on other lines. Each line is
first assumed to be as early as possible; then lines are delayed until their times no longer change. The result is valid
up to the first line that is late.
After it, a model of the planner executes the moves one by one: `LinkRun` uses `motion.planner_clock`, a dry run uses
the simulated firmware.

During slicing there are no lines yet. The model of the link is then a number of lines per second, and
`compute_lateness` returns the delay of the lines relative to the moves.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np

from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.motion.planner_clock import PlannerClock, PlannerState
from printer_slicer.motion.rules import Block, MotionLimits
from printer_slicer.motion.vectorized import Blocks, compute_squared_corner_speeds
from printer_slicer.motion.vectorized_lookahead import compute_lookahead_seconds
from printer_slicer.stream.window import PROBE_BYTES
from printer_slicer.values import Struct

__all__ = [
    "HANDSHAKE_LINES",
    "BatchRetry",
    "BatchTimes",
    "LineBatch",
    "LinkRun",
    "LinkState",
    "SerialLink",
    "TimedJob",
    "can_batch",
    "compute_lateness",
    "compute_line_sizes",
    "get_block",
    "send_batch",
]

HANDSHAKE_LINES: Final = 2
"""Number of numbered lines that the handshake sends before the first line of a job."""

_BITS_PER_BYTE: Final = 10  # bits per byte on the wire
_OK_BYTES: Final = len("ok\n")
_MAX_ROUNDS: Final = 24  # maximum number of iterations to compute how lines delay other lines
_SAME_TIME: Final = 1e-11  # s; times that differ by less count as equal
_TIME_TOLERANCE: Final = 1e-6  # s; rounding may change the order of times that differ by less
_BATCH_LINES: Final = (256, 8192)  # maximum lines of a batch: at first, and after successful batches
_MIN_BATCH: Final = 48  # fewer lines are computed faster one by one
_SINGLE_LINES: Final = (16, 256)  # lines sent singly after a failed batch: at first, and at most


class SerialLink(Struct, frozen=True):
    """A serial connection, and the limits of the host for lines in flight.

    Attributes:
        baud: baud rate of both directions; a byte takes ten bits. 0: bytes take no time.
        latency_out: additional latency of each byte to the printer, s.
        latency_back: additional latency of each byte from the printer, s.
        window_lines: maximum number of lines in flight.
        window_bytes: maximum number of bytes in flight, including those reserved for a probe.
    """

    baud: int
    latency_out: float = 0.0
    latency_back: float = 0.001
    window_lines: int = 2
    window_bytes: int = 127

    @property
    def byte_seconds(self) -> float:
        """Transmission time of one byte, s."""
        return _BITS_PER_BYTE / self.baud if self.baud else 0.0

    @property
    def line_bytes(self) -> int:
        """Maximum number of bytes of lines in flight."""
        return self.window_bytes - PROBE_BYTES

    def lines_per_second(self, size: float) -> float:
        """Return the throughput for lines of `size` bytes, lines/s, limited by baud rate or by waits for answers."""
        byte = self.byte_seconds
        round_trip = (size + _OK_BYTES) * byte + self.latency_out + self.latency_back
        in_flight = max(1.0, min(self.window_lines, self.line_bytes // size))
        return min(1 / (size * byte), in_flight / round_trip)


def compute_lateness(begins: Float, takes: Float) -> Float:
    """Return how late (K,) the lines of each move arrive on a link with a fixed throughput, s.

    Args:
        begins: (K,) start of each move if lines take no time, s.
        takes: (K,) time that the link needs for the lines of each move, s.

    Returns:
        (K,) delay, s; 0 where the lines are in time. No move waits while the planner buffers at least this much motion.
    """
    late = np.zeros(len(begins))
    late[1:] = np.maximum(_compute_transmission_ends(begins[:-1], takes[1:], -np.inf) - begins[1:], 0.0)
    return late


def compute_line_sizes(commands: Sequence[bytes], first: int) -> tuple[Int, Int]:
    """Return the size (n,) of each line, and the size (n,) that the host reserves for it, both in bytes.

    Args:
        commands: commands without comments; their lines also have number, checksum and line break.
        first: index of the first command in the job.
    """
    text = np.frombuffer(b"\n".join(commands) + b"\n", np.uint8)
    ends = np.flatnonzero(text == ord("\n"))
    begins = np.append(0, ends[:-1] + 1)
    own = ends - begins
    # `reduceat` includes the line break of each line, so it is removed again.
    check = np.bitwise_xor.reduceat(text, begins).astype(np.int64) ^ ord("\n")
    number = first + np.arange(len(commands)) + HANDSHAKE_LINES + 1
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


class LinkState(Struct):
    """The state of the link after one line and before the next; times are in s.

    Attributes:
        link: the link.
        out, back: times at which the directions to the printer and to the host are free again.
        answered: times at which the host received the answers to the last `window_lines` lines, the oldest first.
        sizes: bytes of the last `window_lines` - 1 lines.
        executed: time at which the last line was executed.
    """

    link: SerialLink
    out: float
    back: float
    answered: tuple[float, ...]
    sizes: tuple[int, ...]
    executed: float

    @classmethod
    def idle(cls, link: SerialLink, now: float) -> LinkState:
        """Return the state of a link that has no lines in flight at the time `now`, s."""
        return cls(link, now, now, (now,) * link.window_lines, (0,) * (link.window_lines - 1), now)

    def send(self, size: int, reserved: int) -> float:
        """Send a line of `size` bytes (the host reserves `reserved`); return the time at which it is executed, s."""
        left, awaited = self.link.line_bytes - reserved, len(self.answered)
        for position, earlier_size in enumerate(reversed(self.sizes), start=1):
            left -= earlier_size
            if left < 0:
                awaited = position
                break
        self.out = max(self.out, self.answered[-awaited]) + size * self.link.byte_seconds
        self.sizes = (*self.sizes, size)[1:]
        return max(self.out + self.link.latency_out, self.executed)

    def send_answer(self, size: int, now: float) -> None:
        """Send an answer of `size` bytes from the printer at `now`, s."""
        self.back = max(self.back, now) + size * self.link.byte_seconds

    def acknowledge(self, now: float) -> None:
        """Record that the last line was executed at `now`, s, and that the printer sent its answer."""
        self.answered = (*self.answered, self.back + self.link.latency_back)[1:]
        self.executed = now

    def wait_for_all_answers(self) -> None:
        """Make the host wait for the answer to the last line before it sends another one."""
        self.answered = (self.answered[-1],) * len(self.answered)


class BatchRetry:
    """Decides when to try a batch again after a batch failed: after 16 lines, then after 32, and so on up to 256."""

    def __init__(self) -> None:
        self._pause, self._left = _SINGLE_LINES[0], 0

    def is_due(self, lines: int) -> bool:
        """Return whether to try a batch of this number of lines."""
        return self._left <= 0 and lines >= _MIN_BATCH

    def record_batch(self, count: int) -> None:
        """Record that a batch was tried and `count` of its lines were computed."""
        succeeded = count >= _MIN_BATCH
        self._pause = _SINGLE_LINES[0] if succeeded else min(2 * self._pause, _SINGLE_LINES[1])
        self._left = 0 if succeeded else self._pause

    def record_single_line(self) -> None:
        """Record that a line was sent without a batch."""
        self._left -= 1


class LineBatch(Struct, frozen=True, eq=False):
    """Consecutive lines and their moves.

    Attributes:
        sizes, reserved_sizes: (n,) size and reserved size of each line, bytes, from `compute_line_sizes`.
        answers: (n,) size of the answer to each line, bytes.
        moving: (m,) line of each move, ascending.
        blocks: planner blocks of the m moves.
    """

    sizes: Int
    reserved_sizes: Int
    answers: Int
    moving: Int
    blocks: Blocks


class BatchTimes(NamedTuple):
    """The times of a batch of lines, s.

    Attributes:
        done: number of lines that were executed before the planner ran out of moves.
        executed: (done,) time at which each of these lines was executed.
        state: state of the link after these lines.
        planner: state of the planner after these lines.
        begins: start of each move that has started; moves that were queued before the batch come first.
        seconds: duration of each of these moves.
        pushed: number of moves added to the planner, including those that were queued before the batch.
    """

    done: int
    executed: Float
    state: LinkState
    planner: PlannerState
    begins: Float
    seconds: Float
    pushed: int


def can_batch(limits: MotionLimits) -> bool:
    """Return whether `send_batch` supports a planner with these limits."""
    return limits.minimum_cruise_ratio == 0 and limits.planner_blocks >= 4


def send_batch(
    lines: LineBatch,
    planner: PlannerState,
    state: LinkState,
    limits: MotionLimits,
    busy: tuple[float, int] = (0.0, 0),
) -> BatchTimes:
    """Send lines to a machine that is moving; stop at the first line at which the planner runs out of moves.

    Args:
        lines: lines to send.
        planner: state of the planner before these lines.
        state: state of the link before these lines.
        limits: limits of the machine and its planner, which `can_batch` must accept.
        busy: interval at which a waiting machine sends a busy message, s, or 0 for never; size of the message, bytes.
    """
    blocks, corners = _prepend_queued(planner, lines.blocks, limits)
    waiting, places = len(planner.queue), max(limits.planner_blocks - 1, 1)
    seconds, squares = compute_lookahead_seconds(blocks, corners, places - 2, planner.square)
    # ends[k]: end of the block before block k, and start of block k.
    ends = np.append(planner.ends, planner.ends + np.cumsum(seconds))
    # For each line, the next block to plan before it, and the last block planned after it.
    number = np.arange(len(lines.sizes))
    following = waiting + np.searchsorted(lines.moving, number)
    last = waiting + np.searchsorted(lines.moving, number, side="right") - 1
    place_at = np.where(last >= following, _get_values_at(ends, last - places + 1, -np.inf), -np.inf)
    in_time = ends[np.clip(following - places + 2, 0, len(ends) - 1)]
    times = _compute_line_times(lines, place_at, state)
    begun = np.maximum(times.arrived, np.append(state.executed, times.executed[:-1]))
    late = (begun >= in_time) | _is_delayed_by_busy(times.executed - begun, busy, state.link)
    count = min(int(late.argmax()) if late.any() else len(number), times.sure)
    if count == 0:
        return BatchTimes(0, ends[:0], state, planner, ends[:0], seconds[:0], waiting)
    began = int(np.searchsorted(ends, times.executed[count - 1], side="right"))
    pushed = int(last[count - 1]) + 1
    after = PlannerState(
        tuple((get_block(blocks, at), float(corners[at])) for at in range(began, pushed)),
        get_block(blocks, pushed - 1) if pushed else planner.last,
        float(squares[began - 1]) if began else planner.square,
        float(ends[began]),
    )
    link_state = times.compute_state_after(count, lines, state)
    return BatchTimes(count, times.executed[:count], link_state, after, ends[:began], seconds[:began], pushed)


def _is_delayed_by_busy(waits: Float, busy: tuple[float, int], link: SerialLink) -> Bool:
    """Return a mask (n,) of the lines whose answer a busy message delays, given how long the lines wait (n,), s."""
    every, size = busy
    if every <= 0:
        return np.zeros(len(waits), np.bool_)
    rest = (waits + _TIME_TOLERANCE) % every
    return np.asarray(
        (waits + _TIME_TOLERANCE >= every) & (rest < size * link.byte_seconds + 2 * _TIME_TOLERANCE)
    )


def _prepend_queued(planner: PlannerState, fresh: Blocks, limits: MotionLimits) -> tuple[Blocks, Float]:
    """Return the queued blocks followed by new blocks, and for each block the squared junction speed before it."""
    blocks = _concatenate_blocks(_stack_blocks([block for block, _ in planner.queue]), fresh)
    known = np.array([corner for _, corner in planner.queue])
    if not len(fresh.length):
        return blocks, known
    assert planner.last is not None
    row = _concatenate_blocks(_stack_blocks([planner.last]), fresh)
    return blocks, np.append(
        known, compute_squared_corner_speeds(limits, row.take_slice(np.s_[:-1]), row.take_slice(np.s_[1:]))
    )


def _stack_blocks(blocks: Sequence[Block]) -> Blocks:
    """Return blocks as arrays."""
    return Blocks(
        np.array([block.length for block in blocks]),
        np.array([block.unit for block in blocks]).reshape(-1, 4).T,
        np.array([block.speed for block in blocks]),
        np.array([block.acceleration for block in blocks]),
        np.array([block.share for block in blocks]),
    )


def _concatenate_blocks(first: Blocks, second: Blocks) -> Blocks:
    """Return the blocks of `first` followed by those of `second`."""
    return Blocks(
        np.append(first.length, second.length),
        np.append(first.unit, second.unit, axis=1),
        np.append(first.speed, second.speed),
        np.append(first.acceleration, second.acceleration),
        np.append(first.share, second.share),
    )


def get_block(blocks: Blocks, index: int) -> Block:
    """Return the block with this index."""
    x, y, z, e = blocks.unit[:, index].tolist()
    return Block(
        float(blocks.length[index]),
        (x, y, z, e),
        float(blocks.speed[index]),
        float(blocks.acceleration[index]),
        float(blocks.share[index]),
    )


def _get_values_at(values: Float, indices: Int, default: float) -> Float:
    """Return the values at these indices, and `default` at negative indices."""
    return np.asarray(np.where(indices >= 0, values[np.clip(indices, 0, len(values) - 1)], default))


class _LineTimes(NamedTuple):
    """The times of lines, s.

    Attributes:
        sent, arrived, executed: (n,) times at which each line was sent, received, executed.
        free: (n,) times at which the direction to the host is free after the answer to each line.
        answers: (window_lines + n,) times of all answers; those in `LinkState.answered` come first.
        sure: number of lines at the start whose times are final.
    """

    sent: Float
    arrived: Float
    executed: Float
    free: Float
    answers: Float
    sure: int

    def compute_state_after(self, count: int, lines: LineBatch, before: LinkState) -> LinkState:
        """Return the state of the link after the first `count` of these lines."""
        sizes = np.concatenate([before.sizes, lines.sizes[:count]])[count:].astype(np.int64)
        return LinkState(
            before.link,
            float(self.sent[count - 1]),
            float(self.free[count - 1]),
            tuple(self.answers[count : count + before.link.window_lines].tolist()),
            tuple(sizes.tolist()),
            float(self.executed[count - 1]),
        )


def _compute_line_times(lines: LineBatch, queue_free_at: Float, state: LinkState) -> _LineTimes:
    """Return the times of lines; at `queue_free_at` (n,), s, the planner has free places for the moves of each line."""
    link = state.link
    awaited = _find_awaited_answers(lines, state)
    out, back = (np.asarray(one * link.byte_seconds) for one in (lines.sizes, lines.answers))
    earliest = np.maximum.accumulate(np.maximum(queue_free_at, state.executed))
    executed, sure = earliest, 0
    for _ in range(_MAX_ROUNDS):
        free = _compute_transmission_ends(executed, back, state.back)
        answers = np.concatenate([state.answered, free + link.latency_back])
        sent = _compute_transmission_ends(answers[awaited], out, state.out)
        arrived = sent + link.latency_out
        later = np.maximum(earliest, np.maximum.accumulate(arrived))
        moved = later > executed + _SAME_TIME
        sure = int(moved.argmax()) if moved.any() else len(executed)
        if sure == len(executed):
            break
        executed = later
    return _LineTimes(sent, arrived, executed, free, answers, sure)


def _find_awaited_answers(lines: LineBatch, state: LinkState) -> Int:
    """Return the answer (n,) for which each line waits, as an index into `_LineTimes.answers`."""
    number, before = np.arange(len(lines.sizes)), len(state.sizes)
    # Bytes sent before each line, starting with the lines before the batch that may still be in flight.
    total = np.cumsum(np.concatenate([[0], state.sizes, lines.sizes]).astype(np.int64))
    needed = total[number + before] + lines.reserved_sizes - state.link.line_bytes
    return np.asarray(np.clip(np.searchsorted(total, needed), number, number + before))


def _compute_transmission_ends(earliest: Float, takes: Float, free: float) -> Float:
    """Return the times (n,) at which consecutive transmissions end, s.

    Args:
        earliest: (n,) earliest start of each transmission, s.
        takes: (n,) duration of each transmission, s.
        free: time from which on the wire is free, s.
    """
    total = np.cumsum(takes)
    return np.asarray(total + np.maximum(free, np.maximum.accumulate(earliest - (total - takes))))


class TimedJob(Struct, frozen=True, eq=False):
    """The lines and moves of a job.

    Attributes:
        sizes, reserved_sizes: (n,) size and reserved size of each line, bytes, from `compute_line_sizes`.
        moving: (m,) line of each move, ascending; an arc is several moves.
        blocks: planner blocks of the m moves.
        stands: duration of a standstill after all earlier moves, s, by the line that causes it.
        limits: limits of the machine, by the line from which on they apply.
    """

    sizes: Int
    reserved_sizes: Int
    moving: Int
    blocks: Blocks
    stands: Mapping[int, float]
    limits: Mapping[int, MotionLimits]


class LinkRun:
    """A simulation of a job that is sent over a link.

    Attributes:
        job: lines and moves of the job.
        link: the link.
        limits: limits of the machine and its planner.
        begins: (n,) start of the first move of each line, s; nan for lines without a move.
        end: end of the last move, s.
        clock: model of the planner.
        batched: number of lines whose times were computed in batches.
    """

    def __init__(self, job: TimedJob, link: SerialLink, limits: MotionLimits) -> None:
        self.job, self.link, self.limits = job, link, limits
        self.begins = np.full(len(job.sizes), np.nan)
        self.end = 0.0
        self.clock = PlannerClock(limits, self._record_start)
        self.batched = 0
        self._state = LinkState.idle(link, 0.0)
        # The first move of each line; at the end, the number of moves.
        self._first_move: list[int] = np.searchsorted(job.moving, np.arange(len(job.sizes) + 1)).tolist()
        self._breaks = sorted({*job.stands, *job.limits, len(job.sizes)})

    def run(self) -> LinkRun:
        """Send all lines of the job; return this run."""
        at, retry, most = 0, BatchRetry(), _BATCH_LINES[0]
        while at < len(self.job.sizes):
            end = min(self._breaks[bisect_left(self._breaks, at)], at + most)
            count = 0
            if retry.is_due(end - at):
                count = self._send_batch(at, end)
                retry.record_batch(count)
                most = min(2 * most, _BATCH_LINES[1]) if count == end - at else _BATCH_LINES[0]
            if not count:
                self._send_line(at)
                retry.record_single_line()
                count = 1
            at += count
        self.end = self.clock.finish_moves(self._state.executed)
        return self

    def _record_start(self, line: int, now: float) -> None:
        """Record the start of the first move of a line at `now`, s."""
        if np.isnan(self.begins[line]):
            self.begins[line] = now

    def _send_line(self, at: int) -> None:
        """Send the line with the index `at`, and execute its moves."""
        job, state = self.job, self._state
        now = state.send(int(job.sizes[at]), int(job.reserved_sizes[at]))
        if at in job.limits:
            self.limits = job.limits[at]
            self.clock.set_limits(self.limits)
        for place in range(self._first_move[at], self._first_move[at + 1]):
            now = self.clock.push(get_block(job.blocks, place), now, at)
        if at in job.stands:
            now = self.clock.finish_moves(now) + job.stands[at]
        state.send_answer(_OK_BYTES, now)
        state.acknowledge(now)

    def _send_batch(self, at: int, end: int) -> int:
        """Send the lines from `at` to `end` - 1 as a batch; return the number of lines that were computed."""
        planner = self.clock.state(self._state.executed)
        if planner is None or not can_batch(self.limits):
            return 0
        job, own = self.job, slice(at, end)
        moves = slice(self._first_move[at], self._first_move[end])
        lines = LineBatch(
            job.sizes[own],
            job.reserved_sizes[own],
            np.full(end - at, _OK_BYTES),
            job.moving[moves] - at,
            job.blocks.take_slice(moves),
        )
        sent = send_batch(lines, planner, self._state, self.limits)
        if sent.done:
            labels = np.concatenate([self.clock.labels, job.moving[moves]]).astype(np.int64)
            began = len(sent.begins)
            # The first label is that of the running move. A line starts with its first move.
            fresh, first = np.unique(labels[1 : began + 1], return_index=True)
            news = np.isnan(self.begins[fresh])
            self.begins[fresh[news]] = sent.begins[first[news]]
            self.clock.skip_to(
                sent.planner, labels[began : sent.pushed + 1].tolist(), float(sent.seconds.sum())
            )
            self._state = sent.state
            self.batched += sent.done
        return sent.done
