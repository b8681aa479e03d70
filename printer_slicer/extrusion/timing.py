"""Compute how long the moves of a program take."""

from __future__ import annotations

from weakref import WeakKeyDictionary

import numpy as np

from printer_slicer.arguments import check_arguments
from printer_slicer.arrays import Float, Int, frozen_array
from printer_slicer.extrusion.acceleration import move_accelerations
from printer_slicer.model import Program
from printer_slicer.motion.blocks import MotionLimits
from printer_slicer.motion.durations import MOVES_PER_BATCH, RequestedMoves, compute_durations_of_batches
from printer_slicer.motion.rules import limits_of
from printer_slicer.profile import Profile

__all__ = ["copy_times", "move_seconds", "retime_moves"]

_cached_times: WeakKeyDictionary[Program, tuple[MotionLimits, Float]] = WeakKeyDictionary()


@check_arguments(program=Program, profile=Profile)
def move_seconds(program: Program, profile: Profile) -> Float:
    """Return the time (K,) of each move on this printer, s, with unlimited look-ahead.

    Args:
        program: the moves.
        profile: has the limits of the printer.
    """
    limits = limits_of(profile.printer)
    known = _cached_times.get(program)
    if known is None or known[0] != limits:
        seconds = _compute_seconds(program, program.speed, profile, 0, program.n_moves)
        _cached_times[program] = known = limits, frozen_array(seconds, np.float64, (-1,))
    return known[1]


def copy_times(program: Program, other: Program) -> Program:
    """Reuse the times of `other` for a program with the same moves; return the program."""
    _cached_times[program] = _cached_times[other]
    return program


def retime_moves(
    program: Program, seconds: Float, speed: Float, changed_layers: Int, profile: Profile
) -> Float:
    """Return the times (K,) of moves, s, after the speeds in a range of layers changed.

    `changed_layers` is the first and the last of these layers. The change affects at most the adjacent layers,
    because the nozzle nearly stops at each layer change.
    """
    # Include one more layer on both sides, because the first and last move of the range start and end at rest.
    first, start, end, last = np.searchsorted(program.layer, changed_layers[[0, 0, 1, 1]] + [-2, -1, 2, 3])
    again = _compute_seconds(program, speed, profile, first, last)
    return np.concatenate([seconds[:start], again[start - first : end - first], seconds[end:]])


def _compute_seconds(program: Program, speed: Float, profile: Profile, first: int, last: int) -> Float:
    """Return the times (n,) of the moves from `first` up to `last` at speeds (K,), as if there were no other moves."""
    acceleration = move_accelerations(program, profile.printer, first, last)
    batches = (
        RequestedMoves(
            _list_deltas(program, begin, end),
            speed[begin:end],
            None if acceleration is None else acceleration[begin - first : end - first],
            None,
        )
        for begin, end in _split_into_batches(first, last)
    )
    return compute_durations_of_batches(batches, last - first, limits_of(profile.printer))


def _split_into_batches(first: int, last: int) -> list[tuple[int, int]]:
    """Split the moves from `first` up to `last` into batches; return the first move and the end of each."""
    return [(begin, min(begin + MOVES_PER_BATCH, last)) for begin in range(first, last, MOVES_PER_BATCH)]


def _list_deltas(program: Program, first: int, last: int) -> Float:
    """Return the travel (n, 4) in x, y, z and e of the moves from `first` up to `last`, mm."""
    xyz = program.xyz[first:last]
    delta = np.zeros((len(xyz), 4))
    np.subtract(xyz[:1], program.xyz[first - 1] if first else program.origin, out=delta[:1, :3])
    np.subtract(xyz[1:], xyz[:-1], out=delta[1:, :3])
    delta[:, 3] = program.filament[first:last]
    return delta
