"""Printing time of contours and rows of lines on a machine, as a function of speed.

The speed of a layer depends on its height through the flow limit. The motion model (`motion.vectorized`) computes the
times at the slowest and the fastest speed of any layer. Other speeds are interpolated: at corners the time hardly
changes, along straight lines it is proportional to 1 / speed.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np

from printer_slicer.arrays import Float, interpolate_rows, next_in_ring
from printer_slicer.geometry import Areas
from printer_slicer.motion.durations import compute_durations
from printer_slicer.motion.rules import MotionLimits
from printer_slicer.values import Struct

__all__ = ["InfillRowTimes", "LineMotion", "LineTimes", "time_contours", "time_moves", "time_rows"]

_N_LENGTHS: Final = 40
_SHORTEST_LINE: Final = 0.2  # mm, shortest line in a row
_LONGEST_LINE: Final = 1000.0
_FILAMENT_PER_MM: Final = 0.03  # mm of filament per mm of line, roughly
_LINES_PER_ROW: Final = 5  # lines per row; the middle one is timed


class LineMotion(NamedTuple):
    """Speed and acceleration of lines.

    Attributes:
        speed: maximum speed, mm/s.
        acceleration: mm/s².
    """

    speed: float
    acceleration: float


class LineTimes(Struct, frozen=True, eq=False):
    """Times of (n,) items as a function of speed between two limits.

    Attributes:
        slow, fast: mm/s; they may be equal.
        at_slow, at_fast: (n,) s at these speeds.
    """

    slow: float
    fast: float
    at_slow: Float
    at_fast: Float

    def at_speeds(self, speeds: Float) -> Float:
        """Return the times (H, n) at speeds (H,), mm/s, clamped to the limits, s."""
        if self.fast <= self.slow:
            return np.tile(self.at_fast, (len(speeds), 1))
        speeds = np.minimum(np.maximum(speeds, self.slow), self.fast)
        share = (1 / speeds - 1 / self.fast) / (1 / self.slow - 1 / self.fast)
        return np.asarray(self.at_fast + share[:, None] * (self.at_slow - self.at_fast))


def time_contours(contours: Areas, line: LineMotion, slowest: float, limits: MotionLimits) -> LineTimes:
    """Return the time (L,) of a line along all contours of each layer, as a function of speed.

    Args:
        contours: contours of L layers.
        line: speed and acceleration of the line.
        slowest: mm/s, lowest speed that the flow limit allows for any layer.
        limits: motion limits of the machine.
    """
    sizes = np.diff(contours.ring_start)
    steps = contours.xy.take(next_in_ring(contours.ring_start), axis=0) - contours.xy
    layer = np.repeat(contours.ring_layer, sizes)
    ends = np.zeros(len(steps), np.bool_)
    ends[contours.ring_start[1:] - 1] = True
    delta = np.column_stack([steps, np.zeros(len(steps)), _FILAMENT_PER_MM * np.hypot(*steps.T)])

    def contour_seconds(speed: float) -> Float:
        """Return the time (L,) of the line along the contours of each layer at this speed, s."""
        speeds, accelerations = np.full(len(delta), speed), np.full(len(delta), line.acceleration)
        seconds_of_moves = compute_durations(
            delta, speeds, limits, stop_after=ends, acceleration=accelerations
        )
        return np.asarray(
            np.bincount(layer, weights=seconds_of_moves, minlength=contours.n_layers), np.float64
        )

    return _sample_times(contour_seconds, line.speed, slowest)


class InfillRowTimes(Struct, frozen=True, eq=False):
    """Time of a line and its connection to the next one, by line length.

    Attributes:
        length: (m,) mm, ascending.
        times: (m,) s.
    """

    length: Float
    times: LineTimes

    def seconds_per_mm(self, length: Float, speeds: Float) -> Float:
        """Return the time per mm (H, n) of lines of lengths (n,) at speeds (H,), s/mm."""
        rate = self.times.at_speeds(speeds) / self.length
        share = interpolate_rows(np.log(length), np.log(self.length), np.log(rate / rate[:, :1]))
        return np.asarray(np.exp(share) * rate[:, :1])


def time_rows(connection: float, line: LineMotion, slowest: float, limits: MotionLimits) -> InfillRowTimes:
    """Return the times of zigzag lines with connections of this length, mm; other arguments as for `time_contours`."""
    length = np.geomspace(_SHORTEST_LINE, _LONGEST_LINE, _N_LENGTHS)
    to_and_fro = np.where(np.arange(_LINES_PER_ROW) % 2 == 0, 1.0, -1.0)
    moves = np.zeros((_N_LENGTHS, _LINES_PER_ROW, 2, 4))
    moves[:, :, 0, 0] = length[:, None] * to_and_fro
    moves[:, :, 1, 1] = connection
    moves[..., 3] = _FILAMENT_PER_MM * np.abs(moves[..., :2]).sum(axis=-1)
    delta = moves.reshape(-1, 4)
    stops = np.zeros((_N_LENGTHS, 2 * _LINES_PER_ROW), np.bool_)
    stops[:, -1] = True

    def row_seconds(speed: float) -> Float:
        """Return the time (m,) of one line of each length and its connection at this speed, s."""
        speeds, accelerations = np.full(len(delta), speed), np.full(len(delta), line.acceleration)
        seconds_of_moves = compute_durations(
            delta, speeds, limits, stop_after=stops.ravel(), acceleration=accelerations
        )
        middle = seconds_of_moves.reshape(_N_LENGTHS, _LINES_PER_ROW, 2)[:, _LINES_PER_ROW // 2]
        return np.asarray(middle.sum(axis=1))

    return InfillRowTimes(length, _sample_times(row_seconds, line.speed, slowest))


def time_moves(length: Float | float, speed: float, acceleration: float) -> Float:
    """Return the time of moves that start and end at rest, s, in the shape of their lengths, mm."""
    reached = np.minimum(speed, np.sqrt(acceleration * length))
    return np.asarray(length / np.maximum(reached, 1e-9) + reached / acceleration)


def _sample_times(seconds: Callable[[float], Float], speed: float, slowest: float) -> LineTimes:
    """Evaluate times (n,), given as a function of speed, at the slowest and at the fastest speed."""
    slow = min(slowest, speed)
    fast = seconds(speed)
    return LineTimes(slow, speed, fast if slow >= speed else seconds(slow), fast)
