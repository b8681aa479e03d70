"""Move times over arrays: the same as `rules.compute_block_times`, but vectorized with numpy.

The formulas, their order of operations and their sources are those of `motion.blocks` and `motion.rules`, so results
agree up to rounding. Letters in shapes: K moves, B blocks (moves that are not zero).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.kernel import Kernel, load_kernel
from printer_slicer.motion.blocks import (
    SHORTEST,
    SLOWEST,
    SMALL_LENGTH,
    SMALL_TURN_COSINE,
    SQUARE_CORNER_FACTOR,
    STRAIGHT_COSINE,
)
from printer_slicer.motion.rules import EQUAL_RATIO
from printer_slicer.values import Struct

if TYPE_CHECKING:
    from printer_slicer.motion.blocks import MotionLimits

__all__ = [
    "FLOW_WINDOW",
    "Blocks",
    "CruiseLimits",
    "SpeedProfile",
    "accumulate_with_limit",
    "compute_ramp_times",
    "compute_squared_corner_speeds",
    "compute_volumetric_flow",
    "find_nonzero_moves",
    "make_blocks",
    "plan_speeds",
]


_MOVES_AT_ONCE = 1 << 14  # moves whose blocks are made together
_NO_DIRECTIONS = np.zeros((4, 0))


class Blocks(Struct, frozen=True, eq=False):
    """Columns of `rules.Block`: length, speed, acceleration, share (B,); unit (4, B)."""

    length: Float
    unit: Float
    speed: Float
    acceleration: Float
    share: Float

    def take_slice(self, which: slice) -> Blocks:
        """Return a slice of the blocks."""
        return Blocks(
            self.length[which],
            self.unit[:, which],
            self.speed[which],
            self.acceleration[which],
            self.share[which],
        )

    def without_directions(self) -> Blocks:
        """Return the blocks without `unit`, which only corners need."""
        return Blocks(self.length, _NO_DIRECTIONS, self.speed, self.acceleration, self.share)

    @classmethod
    def joined(cls, parts: Sequence[Blocks]) -> Blocks:
        """Concatenate blocks without directions."""
        length, speed, acceleration, share = (
            np.concatenate([np.zeros(0), *(getattr(part, name) for part in parts)])
            for name in ("length", "speed", "acceleration", "share")
        )
        return cls(length, _NO_DIRECTIONS, speed, acceleration, share)


class SpeedProfile(Struct, frozen=True, eq=False):
    """Planned speeds at the corners of B blocks.

    Attributes:
        moving: (B,) indices of the moves that are not zero.
        blocks: these moves as blocks, without directions.
        corners: (B,) maximum squared speed that the corner at the start of each block allows.
        squares: (B + 1,) planned squared speed at the start of each block, and at the end of the last.
        smoothed: cruise limits for `minimum_cruise_ratio`; None if the firmware has none.
    """

    moving: Int
    blocks: Blocks
    corners: Float
    squares: Float
    smoothed: CruiseLimits | None

    def times(self, which: slice) -> Float:
        """Return the times of a slice of the blocks, s."""
        first, last, _ = which.indices(len(self.moving))
        tops = self.smoothed.tops[which] if self.smoothed else np.full(last - first, np.inf)
        return compute_ramp_times(self.blocks.take_slice(which), self.squares[first : last + 1], tops)

    def move_times(self, n_moves: int, n_blocks: int) -> Float:
        """Return the times (n_moves,) of the first moves, s, which contain the first `n_blocks` blocks."""
        seconds = np.zeros(n_moves)
        for first in range(0, n_blocks, _MOVES_AT_ONCE):
            here = slice(first, min(first + _MOVES_AT_ONCE, n_blocks))
            seconds[self.moving[here]] = self.times(here)
        return seconds

    def count_final(self) -> int:
        """Return the number of blocks at the start whose times stay the same, whatever moves are added later.

        At the end of these blocks, the machine can still stop before the last block, whatever follows. With
        `minimum_cruise_ratio`, an acceleration must also end there, and no braking may continue.
        """
        smoothed = self.smoothed
        gains = _compute_squared_speed_gains(self.blocks) if smoothed is None else smoothed.gains
        room = np.cumsum(gains[::-1])[::-1]
        sure = self.corners <= room
        if smoothed is not None:
            last = int(np.flatnonzero(sure)[-1]) if sure.any() else 0
            sure[:last], sure[last:] = True, False  # a block is known where both its ends are
            sure[1:] &= ~smoothed.only_accelerates[:-1]
            sure &= ~smoothed.only_brakes
        found = np.flatnonzero(sure)
        return int(found[-1]) if len(found) else 0


class CruiseLimits(Struct, frozen=True, eq=False):
    """Cruise limits for `minimum_cruise_ratio`, see `rules._compute_squared_cruise_limits`.

    Attributes:
        gains: (B,) gain of the squared speed over each block on the virtual machine.
        squares: (B + 1,) squared speeds of the virtual machine.
        only_accelerates, only_brakes: (B,) whether the virtual machine only accelerates or only brakes in the block.
        tops: (B,) maximum squared speed.
    """

    gains: Float
    squares: Float
    only_accelerates: Bool
    only_brakes: Bool
    tops: Float


def plan_speeds(
    delta: Float,
    speed: Float,
    limits: MotionLimits,
    *,
    stop_after: Bool | None = None,
    acceleration: Float | None = None,
    entry: tuple[float, float] = (0.0, 0.0),
) -> SpeedProfile:
    """Plan the speeds at the corners of moves.

    Args:
        delta: (K, 4) travel in x, y, z, e, as in `compute_durations`.
        speed: (K,) requested speed, as in `compute_durations`.
        limits: motion limits of the machine.
        stop_after: (K,) or None, as in `compute_durations`.
        acceleration: (K,) or None, as in `compute_durations`.
        entry: squared speed before the first block, of the machine and of the virtual machine for
            `minimum_cruise_ratio`.
    """
    moving, blocks, corners = _make_blocks_and_corners(delta, speed, acceleration, limits)
    corners[:1] = entry[0]
    if stop_after is not None:
        stops = np.concatenate([[0], np.cumsum(stop_after)])[moving]
        corners[1:][np.diff(stops) > 0] = 0.0
    gains = _compute_squared_speed_gains(blocks)
    ratio = limits.minimum_cruise_ratio
    smoothed = (
        _compute_cruise_limits(corners, gains * (1.0 - ratio), entry[1])
        if ratio > 0.0 and len(moving)
        else None
    )
    return SpeedProfile(
        moving, blocks, corners, _compute_max_squared_speeds(corners, gains, entry[0]), smoothed
    )


def _make_blocks_and_corners(
    delta: Float, speed: Float, acceleration: Float | None, limits: MotionLimits
) -> tuple[Int, Blocks, Float]:
    """Return the moves that are not zero (B,), these moves as blocks, and the squared corner speeds (B,) before them.

    Moves are processed in batches, because their directions (`unit`) take the most memory; the result has none. The
    corner before the first block is not computed. Arguments are those of `plan_speeds`.
    """
    kernel = load_kernel()
    if kernel and limits.corner == "jerk":
        return _make_blocks_in_kernel(kernel, (delta, speed, acceleration), limits)
    moving, parts, corners = [], [], [np.zeros(0)]
    last: Blocks | None = None
    for first in range(0, len(delta), _MOVES_AT_ONCE):
        here = slice(first, first + _MOVES_AT_ONCE)
        columns = np.ascontiguousarray(delta[here].T, dtype=np.float64)
        index, length = find_nonzero_moves(columns)
        if not len(index):
            continue
        asked = np.asarray(speed[here], dtype=np.float64)[index]
        requested = None if acceleration is None else np.asarray(acceleration[here], np.float64)[index]
        blocks = make_blocks(np.ascontiguousarray(columns[:, index]), length, asked, requested, limits)
        corners.append(_compute_corners_of_batch(last, blocks, limits))
        moving.append(index + first)
        last = blocks.take_slice(np.s_[-1:])
        parts.append(blocks.without_directions())
    joined = Blocks.joined(parts)
    return np.concatenate([np.zeros(0, np.int64), *moving]), joined, np.concatenate(corners)


def _make_blocks_in_kernel(
    kernel: Kernel, moves: tuple[Float, Float, Float | None], limits: MotionLimits
) -> tuple[Int, Blocks, Float]:
    """Make blocks and corners of moves (delta, speed, acceleration) with the compiled kernel."""
    delta, speed, acceleration = (
        np.ascontiguousarray(np.zeros(0) if column is None else column, np.float64) for column in moves
    )
    accelerations = limits.acceleration, limits.travel_acceleration, limits.retract_acceleration
    axes = *limits.max_speed, *limits.max_acceleration, *limits.jerk
    numbers = np.array([SHORTEST, SLOWEST, *accelerations, limits.min_segment_seconds, *axes], np.float64)
    moving, *columns, corners = kernel.make_blocks(delta, speed, acceleration, numbers)
    length, top_speed, top_acceleration, share = map(np.frombuffer, columns)
    blocks = Blocks(length, _NO_DIRECTIONS, top_speed, top_acceleration, share)
    return np.frombuffer(moving, np.int64), blocks, np.frombuffer(corners).copy()


def _compute_corners_of_batch(last: Blocks | None, blocks: Blocks, limits: MotionLimits) -> Float:
    """Return the squared corner speeds (n,) before some blocks, after the block `last`; 0 before the first of all."""
    corners = np.zeros(len(blocks.length))
    if last is not None:
        corners[:1] = compute_squared_corner_speeds(limits, last, blocks.take_slice(np.s_[:1]))
    if len(corners) > 1:
        corners[1:] = compute_squared_corner_speeds(
            limits, blocks.take_slice(np.s_[:-1]), blocks.take_slice(np.s_[1:])
        )
    return corners


def _compute_squared_speed_gains(blocks: Blocks) -> Float:
    """Return the maximum change of the squared speed over each block (B,)."""
    return 2.0 * blocks.acceleration * blocks.length


def find_nonzero_moves(delta: Float) -> tuple[Int, Float]:
    """Return the indices and lengths, mm, of the moves that are not zero; `delta` is (4, K)."""
    x, y, z, e = delta
    length = np.sqrt(x * x + y * y + z * z)
    length = np.where(length >= SHORTEST, length, np.abs(e))
    moving = np.flatnonzero(length >= SHORTEST)
    return moving, length[moving]


def make_blocks(
    delta: Float, length: Float, speed: Float, requested: Float | None, limits: MotionLimits
) -> Blocks:
    """Build blocks within the limits of every axis; `delta` is (4, B), the other arrays (B,)."""
    x, y, z, e = delta
    head_moves = np.sqrt(x * x + y * y + z * z) >= SHORTEST
    unit = np.where(head_moves, delta, 0.0) / length
    unit[3] = np.where(head_moves, e / length, np.sign(e))
    if requested is None:
        with_head = np.where(e != 0.0, float(limits.acceleration), float(limits.travel_acceleration))
        requested = np.where(head_moves, with_head, float(limits.retract_acceleration))
    if limits.min_segment_seconds > 0:
        speed = np.minimum(speed, length / limits.min_segment_seconds)
    speed = np.where(speed > SLOWEST, speed, SLOWEST)
    acceleration = requested
    for part, top_speed, top_acceleration in zip(
        np.abs(unit), limits.max_speed, limits.max_acceleration, strict=True
    ):
        speed = _limit_product(speed, part, top_speed)
        acceleration = _limit_product(acceleration, part, top_acceleration)
    return Blocks(length, unit, speed, acceleration, acceleration / requested)


def _limit_product(value: Float, part: Float, maximum: float) -> Float:
    """Lower `value` such that `part * value` is at most `maximum`."""
    over = np.flatnonzero(part * value > maximum)
    if len(over) == 0:
        return value
    limited = value.copy()
    limited[over] = maximum / part[over]
    return limited


def compute_squared_corner_speeds(limits: MotionLimits, before: Blocks, after: Blocks) -> Float:
    """Return the squared corner speed (n,) between each block of `before` and the block at its index in `after`."""
    slower: Float = np.minimum(before.speed, after.speed)
    squares: Float
    if limits.corner == "junction_deviation":
        squares = np.minimum(_compute_squared_speeds_by_deviation(limits, before, after), slower * slower)
    elif limits.corner == "square_corner":
        squares = _compute_squared_speeds_by_square_corner(limits, before, after, slower)
    else:
        squares = np.square(_compute_speeds_by_jerk(limits, before, after, slower))
    return squares


def _compute_squared_speeds_by_deviation(limits: MotionLimits, before: Blocks, after: Blocks) -> Float:
    """Return the squared corner speeds by junction deviation, see `blocks._compute_squared_speed_by_deviation`."""
    bx, by, bz, be = before.unit / _compute_column_norms(before.unit)
    ax, ay, az, ae = after.unit / _compute_column_norms(after.unit)
    cosine = ax * bx + ay * by + az * bz + ae * be
    straight = cosine > STRAIGHT_COSINE
    cosine[straight] = 0.0  # any harmless value
    size = np.sqrt(2.0 - 2.0 * cosine)
    acceleration = after.acceleration
    for difference, top in zip((ax - bx, ay - by, az - bz, ae - be), limits.max_acceleration, strict=True):
        acceleration = _limit_product(acceleration, np.abs(difference) / size, top)
    half_sine = np.sqrt(np.maximum(0.0, 0.5 * (1.0 + cosine)))
    squares: Float = acceleration * limits.junction_deviation * half_sine / (1.0 - half_sine)
    curved = np.flatnonzero((after.length < SMALL_LENGTH) & (cosine > SMALL_TURN_COSINE))
    room = acceleration[curved] * after.length[curved] / np.arccos(cosine[curved])
    squares[curved] = np.minimum(squares[curved], room)
    squares[straight] = np.inf
    return squares


def _compute_column_norms(unit: Float) -> Float:
    """Return the lengths of the columns (B,) of an array (4, B)."""
    x, y, z, e = unit
    sizes: Float = np.sqrt(x * x + y * y + z * z + e * e)
    return sizes


def _compute_speeds_by_jerk(limits: MotionLimits, before: Blocks, after: Blocks, speed: Float) -> Float:
    """Return the corner speeds by jerk, see `blocks._compute_speed_by_jerk`."""
    for b, a, limit in zip(before.unit, after.unit, limits.jerk, strict=True):
        jump = np.where(a * b > 0.0, np.abs(a - b), np.maximum(np.abs(a), np.abs(b)))
        speed = _limit_product(speed, jump, limit)
    return speed


def _compute_squared_speeds_by_square_corner(
    limits: MotionLimits, before: Blocks, after: Blocks, slower: Float
) -> Float:
    """Return squared corner speeds by square corner velocity, see `blocks._compute_squared_speed_by_square_corner`."""
    bx, by, bz, be = before.unit
    ax, ay, az, ae = after.unit
    if limits.jerk[3] > 0.0:
        slower = _limit_product(slower, np.abs(ae - be), limits.jerk[3])
    cosine = ax * bx + ay * by + az * bz
    half_sine = np.sqrt(np.maximum(0.0, 0.5 * (1.0 + cosine)))
    half_cosine = np.sqrt(np.maximum(0.0, 0.5 * (1.0 - cosine)))
    bent = (half_sine < 1.0) & (half_cosine > 0.0)
    right = limits.square_corner_velocity * limits.square_corner_velocity * SQUARE_CORNER_FACTOR
    turn = right * np.minimum(before.share, after.share) * half_sine
    room = np.minimum(before.length * before.acceleration, after.length * after.acceleration)
    squares: Float = slower * slower
    for numerator, denominator in ((turn, 1.0 - half_sine), (0.5 * room * half_sine, half_cosine)):
        limit = np.divide(numerator, denominator, out=squares.copy(), where=bent)
        squares = np.minimum(squares, limit)
    squares[~(before.unit[:3].any(axis=0) & after.unit[:3].any(axis=0))] = 0.0
    return squares


def _compute_max_squared_speeds(corners: Float, gains: Float, entry: float) -> Float:
    """Return the maximum squared speeds at the start of each block (B + 1,), and 0 at the end of the last."""
    if not len(gains):
        return np.array([entry])
    braking = accumulate_with_limit(corners[::-1], gains[::-1])[::-1]
    return np.concatenate([[entry], accumulate_with_limit(np.append(braking[1:], 0.0), gains, entry)])


def accumulate_with_limit(upper_bound: Float, gain: Float, first: float = 0.0) -> Float:
    """Compute y[i] = min(upper_bound[i], y[i - 1] + gain[i]) for all i, starting from y[-1] = `first`.

    With the cumulative sums P of the gains, y is P plus a running minimum of upper_bound - P. But after a million moves
    P has too few digits for a slow corner. So the values are divided into about √B rows of √B values, and the
    recurrence runs on all rows in parallel, twice. The first run expresses the end of each row as min(bound, y + rise),
    where y is the start of the row. When the starts are known, the second run computes the values.
    """
    n_rows = max(1, int(np.sqrt(len(upper_bound))))
    width = -(-len(upper_bound) // n_rows)
    kernel = load_kernel()
    if kernel and len(upper_bound):
        bounds, steps = (np.ascontiguousarray(column, np.float64) for column in (upper_bound, gain))
        sums = kernel.accumulate_with_limit(bounds.data, steps.data, first, width)
        return np.frombuffer(sums, np.float64)
    padded = np.zeros((2, n_rows * width))
    padded[:, : len(upper_bound)] = upper_bound, gain
    limits, gains = np.ascontiguousarray(padded.reshape(2, n_rows, width).transpose(0, 2, 1))
    del padded
    bound = np.full(n_rows, np.inf)
    for top, step in zip(limits, gains, strict=True):
        bound = np.minimum(top, bound + step)
    starts, y = [], first
    for low, rise in zip(bound.tolist(), gains.sum(axis=0).tolist(), strict=True):
        starts.append(y)
        y = min(low, y + rise)
    values: Float = np.zeros_like(limits)
    row = np.array(starts)
    for top, step, value in zip(limits, gains, values, strict=True):
        row = np.minimum(top, np.add(row, step, out=value), out=value)
    return values.T.reshape(-1)[: len(upper_bound)]


def _compute_cruise_limits(corners: Float, gains: Float, entry: float) -> CruiseLimits:
    """Return the cruise limits for `minimum_cruise_ratio`, see `rules._compute_squared_cruise_limits`."""
    squares = _compute_max_squared_speeds(corners, gains, entry)
    before, behind = squares[:-1], squares[1:]
    n_blocks, index = len(gains), np.arange(len(gains))
    only_accelerates = behind >= (before + gains) * EQUAL_RATIO
    only_brakes = ~only_accelerates & (before >= (behind + gains) * EQUAL_RATIO)
    tops: Float = np.where(only_accelerates | only_brakes, np.inf, 0.5 * (before + behind + gains))
    # An acceleration ends in a block that also brakes, or at the corner before a block that only brakes.
    summits = np.append(np.where(only_brakes, before, tops), 0.0)
    end = np.minimum.accumulate(np.where(only_accelerates, n_blocks, index)[::-1])[::-1]
    tops[only_accelerates] = summits[end[only_accelerates]]
    top_of = np.maximum.accumulate(np.where(only_brakes, 0, index))
    return CruiseLimits(gains, squares, only_accelerates, only_brakes, tops[top_of])


def compute_ramp_times(blocks: Blocks, squares: Float, tops: Float) -> Float:
    """Return the times of blocks (B,), s, see `blocks.compute_ramp_time`; `squares` is (B + 1,), `tops` (B,)."""
    length, acceleration = blocks.length, blocks.acceleration
    entry = np.sqrt(np.minimum(squares[:-1], tops))
    exit_ = np.sqrt(np.minimum(squares[1:], tops))
    cruise = np.minimum(blocks.speed, np.sqrt(tops))
    twice = 2.0 * acceleration
    up = (cruise * cruise - entry * entry) / twice
    down = (cruise * cruise - exit_ * exit_) / twice
    trapezoid: Float = (cruise - entry) / acceleration + (cruise - exit_) / acceleration
    trapezoid += (length - up - down) / cruise
    reaches = up + down <= length
    up = np.clip(0.5 * (length + (exit_ * exit_ - entry * entry) / twice), 0.0, length)
    peak = np.sqrt(entry * entry + twice * up)
    triangle = 2.0 * up / (entry + peak) + 2.0 * (length - up) / (exit_ + peak)
    return np.where(reaches, trapezoid, triangle)


FLOW_WINDOW = 0.2
"""mm³; over smaller volumes the rounding of E distorts the flow."""

_ROUNDING = 1e-7  # mm³, rounding error of sums


def compute_volumetric_flow(volume: Float, seconds: Float) -> Float:
    """Return the volumetric flow (n,) of consecutive extrusions, mm³/s, each averaged over the last 0.2 mm³.

    So the many short moves of a curve get the same flow as one long move. The flow is 0 until 0.2 mm³ are extruded.

    Args:
        volume: (n,) mm³ of each extrusion, above 0.
        seconds: (n,) time of each.
    """
    if not len(volume):
        return np.zeros(0)
    extruded, spent = np.cumsum(volume), np.cumsum(seconds)
    # The last move from which enough volume is extruded up to each move.
    first_move = np.searchsorted(extruded - volume, extruded - FLOW_WINDOW + _ROUNDING, side="right") - 1
    enough = extruded >= FLOW_WINDOW - _ROUNDING
    first_move = np.maximum(first_move, 0)
    pushed, took = extruded - (extruded - volume)[first_move], spent - (spent - seconds)[first_move]
    return np.asarray(np.where(enough & (took > 0), pushed / np.maximum(took, 1e-9), 0.0))
