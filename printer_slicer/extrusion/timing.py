"""How long the moves of programs take: slowing down, fans and those who tell about it all ask."""

from __future__ import annotations

from weakref import WeakKeyDictionary

import numpy as np

from printer_slicer.arrays import Float, Int, frozen_array
from printer_slicer.extrusion.accelerating import accelerations_of
from printer_slicer.model import Program
from printer_slicer.motion.blocks import MotionLimits
from printer_slicer.motion.rules import limits_of
from printer_slicer.motion.vectorized import durations
from printer_slicer.profile import Profile

__all__ = ["known_as", "move_seconds", "timed_again"]

_timed: WeakKeyDictionary[Program, tuple[MotionLimits, Float]] = WeakKeyDictionary()


def move_seconds(program: Program, profile: Profile) -> Float:
    """(K,) how long each move takes on this printer, s, with unlimited look-ahead.

    Args:
        program: the moves.
        profile: its printer's limits decide.
    """
    limits = limits_of(profile.printer)
    known = _timed.get(program)
    if known is None or known[0] != limits:
        seconds = _seconds(program, program.speed, profile, 0, program.n_moves)
        _timed[program] = known = limits, frozen_array(seconds, np.float64, (-1,))
    return known[1]


def known_as(program: Program, other: Program) -> Program:
    """The program, which moves as `other` does: what is known about how long that takes holds for it too."""
    _timed[program] = _timed[other]
    return program


def timed_again(program: Program, seconds: Float, speed: Float, around: Int, profile: Profile) -> Float:
    """(K,) how long moves take, where only those from the first to the last layer of `around` have another speed.

    Braking for them may reach into the layers beside, no farther: at the step up to a layer the nozzle all but stops.
    """
    # One layer more on both sides: the first and the last of all would begin and end at rest.
    first, begin, end, last = np.searchsorted(program.layer, around[[0, 0, 1, 1]] + [-2, -1, 2, 3])
    again = _seconds(program, speed, profile, first, last)
    return np.concatenate([seconds[:begin], again[begin - first : end - first], seconds[end:]])


def _seconds(program: Program, speed: Float, profile: Profile, first: int, last: int) -> Float:
    """(n,) how long the moves from `first` up to `last` take at speeds (K,), as if there were no others."""
    before = program.xyz[first - 1] if first else program.origin
    way = np.diff(program.xyz[first:last], axis=0, prepend=before[None])
    return durations(
        np.column_stack([way, program.filament[first:last]]),
        speed[first:last],
        limits_of(profile.printer),
        acceleration=accelerations_of(program, profile.printer, first, last),
    )
