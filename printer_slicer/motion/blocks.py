"""Single moves: limits of the machine, corner speeds, times of speed ramps.

Import these names from `motion.rules`. Corner speeds depend on the firmware, see `MotionLimits.corner`. They are
computed as squares, because under constant acceleration v² changes by 2·a·d over a distance d.
"""

from __future__ import annotations

from math import acos, inf, sqrt
from typing import Final, Literal, NamedTuple

from printer_slicer.values import Struct

__all__ = [
    "SHORTEST",
    "SLOWEST",
    "SMALL_LENGTH",
    "SMALL_TURN_COSINE",
    "SQUARE_CORNER_FACTOR",
    "STRAIGHT_COSINE",
    "Axes",
    "Block",
    "MotionLimits",
    "compute_corner_speed",
    "compute_ramp_time",
    "compute_squared_corner_speed",
    "make_block",
]

Axes = tuple[float, float, float, float]
"""One number for each of x, y, z, e."""

SLOWEST: Final = 0.05
"""mm/s; lower or missing feed rates are raised to this, so that every move ends."""

SHORTEST: Final = 1e-6
"""mm; shorter moves are rounding errors, because this is less than a motor step of any machine."""

STRAIGHT_COSINE: Final = 0.999999
"""Cosine of the turn above which junction deviation detects no corner (0.08°)."""

SMALL_LENGTH: Final = 1.0
SMALL_TURN_COSINE: Final = 0.7071067811865476
"""Blocks shorter than 1 mm that turn by less than 45° (cosine above this) are treated as parts of a curve."""

SQUARE_CORNER_FACTOR: Final = sqrt(2) - 1
"""Factor with which the deviation formula gives the square corner velocity at 90°."""


class MotionLimits(Struct, frozen=True):
    """Motion limits of a machine.

    Attributes:
        max_speed: x, y, z, e, mm/s.
        max_acceleration: x, y, z, e, mm/s².
        acceleration: of moves of the extruder together with x, y or z, mm/s².
        travel_acceleration: of moves without the extruder, mm/s².
        retract_acceleration: of moves of the extruder alone, mm/s².
        corner: rule for corner speeds: Marlin's junction deviation, the older jerk per axis, or Klipper's square corner
            velocity.
        junction_deviation: mm, for "junction_deviation".
        jerk: x, y, z, e, mm/s: maximum jump in speed of each axis, for "jerk". With "square_corner" only e is used
            (Klipper's `instantaneous_corner_velocity`); 0 means no limit.
        square_corner_velocity: mm/s, for "square_corner".
        minimum_cruise_ratio: fraction of an acceleration and braking distance that must be cruise, 0 to below 1
            (Klipper).
        planner_blocks: number of moves in the firmware's look-ahead queue.
        min_segment_seconds: moves that take less time at cruise speed are slowed down to this; 0: never. Marlin does so
            (M205 B) while its queue is less than half full; here it applies to all moves.
    """

    max_speed: Axes
    max_acceleration: Axes
    acceleration: float
    travel_acceleration: float
    retract_acceleration: float
    corner: Literal["junction_deviation", "jerk", "square_corner"]
    junction_deviation: float
    jerk: Axes
    square_corner_velocity: float
    minimum_cruise_ratio: float = 0.0
    planner_blocks: int = 16
    min_segment_seconds: float = 0.0


class Block(NamedTuple):
    """A straight move within the limits of every axis.

    Attributes:
        length: mm of x, y, z together; of e when only e moves.
        unit: travel of x, y, z, e per mm of length.
        speed: cruise speed, mm/s along the length.
        acceleration: mm/s² along the length.
        share: `acceleration` divided by the requested acceleration, above 0 and at most 1.
    """

    length: float
    unit: Axes
    speed: float
    acceleration: float
    share: float = 1.0


def make_block(limits: MotionLimits, delta: Axes, speed: float) -> Block | None:
    """Build the block of a move by `delta`; None if nothing moves.

    Args:
        limits: limits of the machine when the move is read.
        delta: x, y, z, e, mm.
        speed: requested speed, mm/s along x, y, z; along e if only e moves. If an axis exceeds its limits, the whole
            move is slowed down in proportion.
    """
    x, y, z, e = delta
    length = sqrt(x * x + y * y + z * z)
    if length >= SHORTEST:
        unit = (x / length, y / length, z / length, e / length)
        requested = limits.acceleration if e else limits.travel_acceleration
    else:
        length = abs(e)
        if length < SHORTEST:
            return None
        unit = (0.0, 0.0, 0.0, 1.0 if e > 0.0 else -1.0)
        requested = limits.retract_acceleration
    if limits.min_segment_seconds * speed > length:
        speed = length / limits.min_segment_seconds
    if not speed > SLOWEST:
        speed = SLOWEST
    acceleration = requested
    for part, top_speed, top_acceleration in zip(
        unit, limits.max_speed, limits.max_acceleration, strict=True
    ):
        if part:
            size = abs(part)
            if size * speed > top_speed:
                speed = top_speed / size
            if size * acceleration > top_acceleration:
                acceleration = top_acceleration / size
    return Block(length, unit, speed, acceleration, acceleration / requested)


def compute_corner_speed(limits: MotionLimits, before: Block, after: Block) -> float:
    """Return the maximum speed at the corner between two blocks, mm/s; at most both cruise speeds.

    For moves of the extruder alone, "junction_deviation" and "jerk" treat e as one more axis, as Marlin does. With
    "square_corner" the machine stops before and after them, as Klipper does.
    """
    return sqrt(compute_squared_corner_speed(limits, before, after))


def compute_squared_corner_speed(limits: MotionLimits, before: Block, after: Block) -> float:
    """Return the square of `compute_corner_speed`, (mm/s)²."""
    slower = before.speed if before.speed < after.speed else after.speed
    if limits.corner == "junction_deviation":
        return min(_compute_squared_speed_by_deviation(limits, before, after), slower * slower)
    if limits.corner == "square_corner":
        return _compute_squared_speed_by_square_corner(limits, before, after, slower)
    slower = _compute_speed_by_jerk(limits.jerk, before.unit, after.unit, slower)
    return slower * slower


def _compute_squared_speed_by_deviation(limits: MotionLimits, before: Block, after: Block) -> float:
    """Return the squared corner speed by junction deviation.

    The corner is replaced by an arc at the deviation δ, traversed with the acceleration a:
    v² = a·δ·sin(θ/2) / (1 - sin(θ/2)), where θ is the angle between the two lines (180° = straight on). Directions are
    unit vectors in x, y, z and e; a is what the axes allow along the bisector. For short segments of a curve this arc
    would be longer than the segments, so the radius is length / turn instead.

    Source: S. K. Jeon, "Improving Grbl: Cornering Algorithm", 2011; Marlin's options JUNCTION_DEVIATION_MM
    and JD_HANDLE_SMALL_SEGMENTS (on by default).
    """
    bx, by, bz, be = before.unit
    ax, ay, az, ae = after.unit
    # The unit is 1 mm long in x, y, z, or in e alone: here e belongs to the length too.
    b_size = sqrt(bx * bx + by * by + bz * bz + be * be)
    a_size = sqrt(ax * ax + ay * ay + az * az + ae * ae)
    bx, by, bz, be = bx / b_size, by / b_size, bz / b_size, be / b_size
    ax, ay, az, ae = ax / a_size, ay / a_size, az / a_size, ae / a_size
    cosine = ax * bx + ay * by + az * bz + ae * be
    if cosine > STRAIGHT_COSINE:
        return inf
    size = sqrt(2.0 - 2.0 * cosine)
    acceleration = after.acceleration
    for difference, top in zip((ax - bx, ay - by, az - bz, ae - be), limits.max_acceleration, strict=True):
        part = abs(difference) / size
        if part * acceleration > top:
            acceleration = top / part
    half_sine = sqrt(max(0.0, 0.5 * (1.0 + cosine)))
    square = acceleration * limits.junction_deviation * half_sine / (1.0 - half_sine)
    if after.length < SMALL_LENGTH and cosine > SMALL_TURN_COSINE:
        square = min(square, acceleration * after.length / acos(cosine))
    return square


def _compute_speed_by_jerk(jerk: Axes, before: Axes, after: Axes, speed: float) -> float:
    """Return the corner speed by jerk, at most `speed`: the speed of no axis may jump by more than its limit.

    An axis that reverses stops in between, so the larger of its two jumps counts, not their sum.

    Source: Marlin's option CLASSIC_JERK.
    """
    for b, a, limit in zip(before, after, jerk, strict=True):
        jump = abs(a - b) if a * b > 0.0 else max(abs(a), abs(b))
        if jump * speed > limit:
            speed = limit / jump
    return speed


def _compute_squared_speed_by_square_corner(
    limits: MotionLimits, before: Block, after: Block, slower: float
) -> float:
    """Return the squared corner speed by square corner velocity, at most that of the slower block.

    This is junction deviation in x, y, z with δ = v₉₀²·(√2 - 1) / a, so that a 90° corner is taken at v₉₀ for every
    acceleration; it is reduced in proportion if an axis limits the acceleration. The arc must also fit: its radius is
    at most tan(θ/2) times half the length of either block. The extruder has a limit for its own jump in speed.

    Source: Klipper documentation, "Kinematics: Look-ahead", and its option `instantaneous_corner_velocity`.
    """
    bx, by, bz, be = before.unit
    ax, ay, az, ae = after.unit
    if not (bx or by or bz) or not (ax or ay or az):
        return 0.0
    jump = abs(ae - be)
    if jump * slower > limits.jerk[3] > 0.0:
        slower = limits.jerk[3] / jump
    square = slower * slower
    cosine = ax * bx + ay * by + az * bz
    half_sine = sqrt(max(0.0, 0.5 * (1.0 + cosine)))
    half_cosine = sqrt(max(0.0, 0.5 * (1.0 - cosine)))
    if half_sine < 1.0 and half_cosine > 0.0:
        right = limits.square_corner_velocity * limits.square_corner_velocity * SQUARE_CORNER_FACTOR
        share = min(before.share, after.share)
        room = min(before.length * before.acceleration, after.length * after.acceleration)
        square = min(
            square, right * share * half_sine / (1.0 - half_sine), 0.5 * room * half_sine / half_cosine
        )
    return square


def compute_ramp_time(length: float, entry: float, cruise: float, exit: float, acceleration: float) -> float:  # noqa: A002
    """Return the time of a move with a trapezoidal speed profile, s; units are mm, mm/s and mm/s².

    The profile is a triangle if the cruise speed cannot be reached. The exit speed must be reachable from the entry
    speed. Neither may exceed `cruise`, which must be above 0.
    """
    twice = 2.0 * acceleration
    up = (cruise * cruise - entry * entry) / twice
    down = (cruise * cruise - exit * exit) / twice
    if up + down <= length:
        return (
            (cruise - entry) / acceleration + (cruise - exit) / acceleration + (length - up - down) / cruise
        )
    # Divide distances by mean speeds: differences of nearly equal speeds would lose digits on short moves.
    up = min(max(0.5 * (length + (exit * exit - entry * entry) / twice), 0.0), length)
    peak = sqrt(entry * entry + twice * up)
    return 2.0 * up / (entry + peak) + 2.0 * (length - up) / (exit + peak)
