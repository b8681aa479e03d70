"""Begin narrow contoured loops with their lower side, so that the nozzle does not press down the higher one."""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, consecutive
from printer_slicer.geometry.vectors import cross
from printer_slicer.model import Toolpaths

__all__ = ["start_narrow_loops_low"]

_MIN_FALL: Final = 0.03  # mm; loops that change less are pressed little
_TURN: Final = 2 * np.pi


def start_narrow_loops_low(paths: Toolpaths, nozzle_flat: float) -> Toolpaths:
    """Move the starts of loops around narrow places to where their lower side begins.

    The flat underside of the nozzle covers both sides of such a loop. If the lower side is printed first, the nozzle is
    higher when it prints the other one.

    Args:
        paths: contoured; some are loops.
        nozzle_flat: diameter of the underside, mm.
    """
    chosen = np.flatnonzero(_are_narrow_and_sloped(paths, nozzle_flat))
    if not len(chosen):
        return paths
    loops = paths.take(chosen)
    first = _find_low_starts(loops)
    size = np.diff(loops.start)
    owner = loops.path_of_point
    place = consecutive(np.zeros_like(size), size)
    point = np.arange(len(paths.xy))
    begin = np.repeat(paths.start[chosen], size)
    point[begin + place] = begin + (place + first[owner]) % size[owner]
    return paths.of_points(point, paths.start, np.arange(paths.n_paths))


def _are_narrow_and_sloped(paths: Toolpaths, nozzle_flat: float) -> Bool:
    """Return a mask (M,) of the loops that are narrower than the underside of the nozzle, and not level."""
    if not paths.n_paths:
        return np.zeros(0, np.bool_)
    first = paths.start[:-1]
    fall = np.maximum.reduceat(paths.z_offset, first) - np.minimum.reduceat(paths.z_offset, first)
    around = paths.xy - paths.xy[first][paths.path_of_point]
    twice = np.abs(np.add.reduceat(cross(around, around[paths.following]), first))
    # A strip has twice its area in its length times its width.
    return np.asarray(paths.closed & (fall > _MIN_FALL) & (twice < nozzle_flat * paths.length()))


def _find_low_starts(loops: Toolpaths) -> Int:
    """Return the point (M,) of each loop, counted from its first one, nearest to the begin of its lower half.

    The lowest place is the phase of the first harmonic of z along the loop. The lower half begins a quarter before it.
    """
    step, first, owner = loops.steps(), loops.start[:-1], loops.path_of_point
    walked = np.cumsum(step) - step
    phase = _TURN * (walked - walked[first][owner]) / loops.length()[owner]
    end = phase + _TURN * step / loops.length()[owner]
    z = (loops.z_offset + loops.z_offset[loops.following]) / 2
    wave = np.exp(0.5j * (phase + end)) * z * step
    lowest = np.angle(-np.add.reduceat(wave, first))
    distance = _measure_turns(phase - (lowest - _TURN / 4)[owner])
    nearest = np.flatnonzero(distance == np.minimum.reduceat(distance, first)[owner])
    result = np.zeros(loops.n_paths, np.int64)
    result[owner[nearest[::-1]]] = nearest[::-1] - first[owner[nearest[::-1]]]
    return result


def _measure_turns(angle: Float) -> Float:
    """Return how far angles (n,) are from a whole number of turns, radians."""
    return np.abs((angle + _TURN / 2) % _TURN - _TURN / 2)
