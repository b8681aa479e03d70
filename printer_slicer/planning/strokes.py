"""How long contours and rows of lines take on a machine, for any speed: the motion model over samples of them.

Speeds of a layer depend on its height, by what can be melted. So the motion model (`motion.whole`) is asked at two
paces, the slowest and the fastest that any layer has, and the time of a pace between them is taken from these two: at
corners it hardly changes, along straight lines it goes with 1 / speed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from printer_slicer.geometry import Areas
from printer_slicer.geometry.areas import following_around
from printer_slicer.model import Float
from printer_slicer.motion.rules import Limits
from printer_slicer.motion.whole import durations

__all__ = ["Paced", "Role", "Rows", "time_contours", "time_moves", "time_rows"]

_LENGTHS: Final = 40
_SHORTEST: Final = 0.2  # mm, of lines in rows
_LONGEST: Final = 1000.0
_FILAMENT: Final = 0.03  # mm for each mm: about what a bead takes
_PERIODS: Final = 5  # lines of a row; the middle one is looked at


class Role(NamedTuple):
    """How fast and how hard some lines are laid.

    Attributes:
        speed: mm/s at most.
        acceleration: mm/s².
    """

    speed: float
    acceleration: float


@dataclass(frozen=True, slots=True, eq=False)
class Paced:
    """Seconds of some (n,) things at any speed between two.

    Attributes:
        slow, fast: mm/s; they may be equal.
        at_slow, at_fast: (n,) s.
    """

    slow: float
    fast: float
    at_slow: Float
    at_fast: Float

    def at(self, speed: float) -> Float:
        """(n,) s at a speed, mm/s; at the nearest of the two where it is beyond them."""
        if self.fast <= self.slow:
            return self.at_fast
        speed = min(max(speed, self.slow), self.fast)
        share = (1 / speed - 1 / self.fast) / (1 / self.slow - 1 / self.fast)
        return self.at_fast + share * (self.at_slow - self.at_fast)


def time_contours(contours: Areas, role: Role, slowest: float, limits: Limits) -> Paced:
    """Seconds (L,) of a line along all contours of each layer.

    Args:
        contours: of L layers.
        role: of the lines.
        slowest: mm/s, the least that a layer's flow may leave of the role's speed.
        limits: of the machine.
    """
    sizes = np.diff(contours.ring_start)
    steps = contours.xy.take(following_around(contours.ring_start), axis=0) - contours.xy
    layer = np.repeat(contours.ring_layer, sizes)
    ends = np.zeros(len(steps), np.bool_)
    ends[contours.ring_start[1:] - 1] = True
    delta = np.column_stack([steps, np.zeros(len(steps)), _FILAMENT * np.hypot(*steps.T)])

    def seconds(speed: float) -> Float:
        paces, hard = np.full(len(delta), speed), np.full(len(delta), role.acceleration)
        took = durations(delta, paces, limits, stop_after=ends, acceleration=hard)
        return np.asarray(np.bincount(layer, weights=took, minlength=contours.n_layers), np.float64)

    return _paced(seconds, role.speed, slowest)


@dataclass(frozen=True, slots=True, eq=False)
class Rows:
    """Seconds of a line and its way to the next one, for lines of any length in rows.

    Attributes:
        length: (m,) mm, ascending.
        paced: (m,) s.
    """

    length: Float
    paced: Paced

    def per_mm(self, length: Float, speed: float) -> Float:
        """(n,) s for each mm of lines of lengths (n,), mm."""
        rate = self.paced.at(speed) / self.length
        share = np.interp(np.log(length), np.log(self.length), np.log(rate / rate[0]))
        return np.asarray(np.exp(share) * rate[0])


def time_rows(link: float, role: Role, slowest: float, limits: Limits) -> Rows:
    """Lines to and fro, joined at their ends by ways of `link` mm; other arguments as for `time_contours`."""
    length = np.geomspace(_SHORTEST, _LONGEST, _LENGTHS)
    to_and_fro = np.where(np.arange(_PERIODS) % 2 == 0, 1.0, -1.0)
    moves = np.zeros((_LENGTHS, _PERIODS, 2, 4))
    moves[:, :, 0, 0] = length[:, None] * to_and_fro
    moves[:, :, 1, 1] = link
    moves[..., 3] = _FILAMENT * np.abs(moves[..., :2]).sum(axis=-1)
    delta = moves.reshape(-1, 4)
    stops = np.zeros((_LENGTHS, 2 * _PERIODS), np.bool_)
    stops[:, -1] = True

    def seconds(speed: float) -> Float:
        paces, hard = np.full(len(delta), speed), np.full(len(delta), role.acceleration)
        took = durations(delta, paces, limits, stop_after=stops.ravel(), acceleration=hard)
        middle = took.reshape(_LENGTHS, _PERIODS, 2)[:, _PERIODS // 2]
        return np.asarray(middle.sum(axis=1))

    return Rows(length, _paced(seconds, role.speed, slowest))


def time_moves(length: Float | float, speed: float, acceleration: float) -> Float:
    """Seconds of moves that begin and end at rest, of the same shape as their lengths, mm."""
    reached = np.minimum(speed, np.sqrt(acceleration * length))
    return np.asarray(length / np.maximum(reached, 1e-9) + reached / acceleration)


def _paced(seconds: Callable[[float], Float], speed: float, slowest: float) -> Paced:
    """What takes (n,) seconds at each speed, from the slowest up to the fastest."""
    slow = min(slowest, speed)
    fast = seconds(speed)
    return Paced(slow, speed, fast if slow >= speed else seconds(slow), fast)
