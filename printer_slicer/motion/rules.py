"""The motion model for single moves: limits, corner speeds, speed ramps and the look-ahead of a planner.

Plain Python without arrays, clock or I/O, so that the simulated printer and the timeouts of the host can use it.
`motion.vectorized` computes the same over arrays.

The machine moves in straight lines, the blocks. The speed within a block is a trapezoid: constant acceleration up to
the cruise speed, cruise, constant deceleration. At a corner the speed keeps its magnitude and changes direction. The
computation uses squared speeds, which are linear in distance under constant acceleration.

Simplification: firmware with jerk per axis starts its first move at the jerk speed and stops from it; here the machine
starts and ends at zero.
"""

from __future__ import annotations

from collections import deque
from itertools import islice, pairwise
from math import inf, sqrt
from typing import TYPE_CHECKING, Final, NamedTuple

from printer_slicer.motion.blocks import (
    Axes,
    Block,
    MotionLimits,
    compute_corner_speed,
    compute_ramp_time,
    compute_squared_corner_speed,
    make_block,
)

if TYPE_CHECKING:
    from collections.abc import Iterable

    from printer_slicer.profile import Printer

__all__ = [
    "EQUAL_RATIO",
    "Axes",
    "Block",
    "Lookahead",
    "MotionLimits",
    "compute_block_times",
    "compute_corner_speed",
    "compute_ramp_time",
    "limits_of",
    "make_block",
]

EQUAL_RATIO: Final = 1 - 1e-9
"""Squared speeds whose ratio is above this are equal, so that rounding does not decide whether a block also brakes."""


class _QueuedBlock(NamedTuple):
    """A block in the queue of the planner.

    Attributes:
        block: the move.
        corner: squared speed that the corner at its start allows.
        gain: change of squared speed over its length, 2·a·d.
    """

    block: Block
    corner: float
    gain: float


class Lookahead:
    """The planner of a firmware: a queue of a few blocks, always planned such that the last one ends at rest.

    A block that leaves the queue keeps its planned exit speed; later blocks cannot change it. So a short queue, or
    blocks too short for the machine to brake within the queue, make the machine slower than `compute_block_times`.

    Attributes:
        limits: limits for the corners of blocks pushed from now on; may be replaced at any time.
        exit_speed: mm/s at the end of the block popped last.
    """

    __slots__ = ("_last", "_queue", "_smooth", "_square", "_top", "exit_speed", "limits")

    def __init__(self, limits: MotionLimits) -> None:
        self.limits = limits
        self.exit_speed = 0.0
        self._queue: deque[_QueuedBlock] = deque()
        self._last: Block | None = None
        self._square = 0.0  # of exit_speed
        self._smooth = 0.0  # squared exit speed of the virtual machine for `minimum_cruise_ratio`
        self._top = inf

    def __len__(self) -> int:
        return len(self._queue)

    @property
    def is_full(self) -> bool:
        """Whether the queue is full."""
        return len(self._queue) >= self.limits.planner_blocks

    def push(self, block: Block) -> None:
        """Add a block to the queue. To model a real planner, pop a block first while the queue `is_full`."""
        corner = 0.0 if self._last is None else compute_squared_corner_speed(self.limits, self._last, block)
        self._last = block
        self._queue.append(_QueuedBlock(block, corner, 2.0 * block.acceleration * block.length))

    def stop(self) -> None:
        """Make the machine stop after the queued blocks; the next block pushed starts at speed 0."""
        self._last = None

    def get_queue_state(self) -> tuple[list[tuple[Block, float]], Block | None, float]:
        """Return the state of the queue.

        Returns:
            Each waiting block with the squared speed of the corner before it; the last block pushed; the square of
            `exit_speed`.
        """
        return [(queued.block, queued.corner) for queued in self._queue], self._last, self._square

    def skip_to(self, queue: Iterable[tuple[Block, float]], last: Block | None, square: float) -> None:
        """Set the state of the queue, as returned by `get_queue_state`; not supported with `minimum_cruise_ratio`."""
        self._queue = deque(
            _QueuedBlock(block, corner, 2.0 * block.acceleration * block.length) for block, corner in queue
        )
        self._last = last
        self._square = square
        self.exit_speed = sqrt(square)

    def pop(self) -> float:
        """Remove the oldest block from the queue; its exit speed is fixed as planned now.

        Returns:
            Time of the block, s; 0 if the queue is empty and the machine rests.
        """
        if not self._queue:
            self.stop()
            self._square = self._smooth = self.exit_speed = 0.0
            return 0.0
        queued = self._queue.popleft()
        block, entry = queued.block, self.exit_speed
        square = min(self._find_squared_reachable_speed(1.0), self._square + queued.gain)
        cruise = block.speed
        if self.limits.minimum_cruise_ratio > 0.0:
            self._top = self._find_next_cruise_limit(queued.gain)
            square = min(square, self._top)
            cruise = min(cruise, sqrt(self._top))
        self._square = square
        self.exit_speed = sqrt(square)
        return compute_ramp_time(block.length, entry, cruise, self.exit_speed, block.acceleration)

    def _find_squared_reachable_speed(self, scale: float, skip: int = 0) -> float:
        """Return the maximum squared speed at the start of queued block `skip` that keeps all later corners possible.

        This is the backward pass of a planner, run from the front: a later corner allows its own squared speed plus
        the braking up to it. It ends when the braking distance alone allows more than the best found, mostly after
        one or two blocks.
        """
        best, braking = inf, 0.0
        for _, corner, gain in islice(self._queue, skip, None) if skip else self._queue:
            if braking + corner < best:  # noqa: PLR1730 - min() takes three times as long, here on every move
                best = braking + corner
            braking += scale * gain
            if braking >= best:
                return best
        return min(best, braking)

    def _find_next_cruise_limit(self, gain: float) -> float:
        """Return the squared cruise limit of the block removed last, see `_compute_squared_cruise_limits`."""
        scale = 1.0 - self.limits.minimum_cruise_ratio
        gain *= scale
        entry = self._smooth
        self._smooth = exit_ = min(self._find_squared_reachable_speed(scale), entry + gain)
        if _needs_full_gain(entry, exit_, gain):
            return self._find_peak_ahead(exit_, scale)
        return (
            self._top
            if _needs_full_gain(exit_, entry, gain)
            else _compute_squared_peak_speed(entry, exit_, gain)
        )

    def _find_peak_ahead(self, entry: float, scale: float) -> float:
        """Return the squared speed at which the current acceleration of the virtual machine will end."""
        for index, queued in enumerate(self._queue, start=1):
            gain = scale * queued.gain
            exit_ = min(self._find_squared_reachable_speed(scale, index), entry + gain)
            if not _needs_full_gain(entry, exit_, gain):
                return (
                    entry
                    if _needs_full_gain(exit_, entry, gain)
                    else _compute_squared_peak_speed(entry, exit_, gain)
                )
            entry = exit_
        return entry


def compute_block_times(blocks: Iterable[Block], limits: MotionLimits) -> list[float]:
    """Return the time of each block, s, for a machine with unlimited look-ahead that starts and ends at rest."""
    queue = list(blocks)
    if not queue:
        return []
    gains = [2.0 * block.acceleration * block.length for block in queue]
    corners = [
        0.0,
        *(compute_squared_corner_speed(limits, before, after) for before, after in pairwise(queue)),
    ]
    squares = _compute_max_squared_speeds(corners, gains)
    tops = [inf] * len(queue)
    if limits.minimum_cruise_ratio > 0.0:
        tops = _compute_squared_cruise_limits(
            corners, [gain * (1.0 - limits.minimum_cruise_ratio) for gain in gains]
        )
    return [
        compute_ramp_time(
            block.length,
            sqrt(min(entry, top)),
            min(block.speed, sqrt(top)),
            sqrt(min(exit_, top)),
            block.acceleration,
        )
        for block, entry, exit_, top in zip(queue, squares, squares[1:], tops, strict=False)
    ]


def _compute_max_squared_speeds(corners: list[float], gains: list[float]) -> list[float]:
    """Return the maximum squared speeds at the start of each block, and 0 at the end of the last."""
    squares = [*corners, 0.0]
    for i in range(len(gains) - 1, -1, -1):
        squares[i] = min(squares[i], squares[i + 1] + gains[i])
    for i, gain in enumerate(gains):
        squares[i + 1] = min(squares[i + 1], squares[i] + gain)
    return squares


def _compute_squared_cruise_limits(corners: list[float], gains: list[float]) -> list[float]:
    """Return the squared cruise limit of each block that leaves the minimum fraction of cruise.

    A virtual machine with the lower acceleration (1 - ratio)·a takes the same corners; `gains` are its gains. Each
    acceleration and braking, over one or more blocks, has a peak speed. The real machine is limited to it but
    accelerates faster, so it cruises the rest. A block on which the virtual machine only accelerates belongs to the
    peak after it, one on which it only brakes to the peak before it.

    Source: Klipper documentation, "Kinematics: Minimum cruise ratio".
    """
    squares = _compute_max_squared_speeds(corners, gains)
    tops = [0.0] * len(gains)
    summit: float | None = None
    for i in range(len(gains) - 1, -1, -1):
        entry, exit_, gain = squares[i], squares[i + 1], gains[i]
        if _needs_full_gain(entry, exit_, gain):
            summit = tops[i] = exit_ if summit is None else summit
        elif _needs_full_gain(exit_, entry, gain):
            summit, tops[i] = None, inf
        else:
            summit = tops[i] = _compute_squared_peak_speed(entry, exit_, gain)
    for i, top in enumerate(tops):
        if top == inf:
            tops[i] = tops[i - 1]
    return tops


def _needs_full_gain(low: float, high: float, gain: float) -> bool:
    """Return whether a block needs its whole length to change between the lower and the higher squared speed."""
    return high >= (low + gain) * EQUAL_RATIO


def _compute_squared_peak_speed(entry: float, exit_: float, gain: float) -> float:
    """Return the squared peak speed of a block: where the acceleration from its start meets the braking to its end."""
    return 0.5 * (entry + exit_ + gain)


def limits_of(printer: Printer) -> MotionLimits:
    """Return the motion limits of a printer: speeds mm/s, accelerations mm/s²."""
    one = printer.firmware.has_single_acceleration
    return MotionLimits(
        max_speed=(printer.max_speed_x, printer.max_speed_y, printer.max_speed_z, printer.max_speed_e),
        max_acceleration=(
            printer.max_acceleration_x,
            printer.max_acceleration_y,
            printer.max_acceleration_z,
            printer.max_acceleration_e,
        ),
        acceleration=printer.acceleration,
        travel_acceleration=printer.acceleration if one else printer.travel_acceleration,
        retract_acceleration=printer.retract_acceleration,
        corner=printer.corner,
        junction_deviation=printer.junction_deviation,
        jerk=(printer.jerk_xy, printer.jerk_xy, printer.jerk_z, printer.jerk_e),
        square_corner_velocity=printer.square_corner_velocity,
        minimum_cruise_ratio=printer.minimum_cruise_ratio,
        planner_blocks=printer.firmware.planner_blocks,
        min_segment_seconds=printer.min_segment_time,
    )
