"""Find where the nozzle moves down beside an unfinished part, to cross as little of the part as possible."""

from __future__ import annotations

from math import cos, pi, sin
from typing import Final

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.firmware import FLAVOURS
from printer_slicer.gcode import read_moves
from printer_slicer.jobs import Job
from printer_slicer.printing.host_settings import HostSettings

__all__ = ["find_approach_point", "sample_extrusions"]

_DIRECTIONS: Final = 72
_MAX_DISTANCE: Final = (
    1.5  # mm between an extrusion and the path of the nozzle if it counts as under the path
)
_CLEARANCE: Final = 5.0  # mm between the part and the point where the nozzle moves down
_DEPTH: Final = 2.0  # mm; parts farther below the nozzle are ignored
_SAMPLE_DISTANCE: Final = 1.0  # mm between sample points on an extrusion


def sample_extrusions(job: Job, entries: int, setup: HostSettings) -> Float:
    """Return (N, 3) sample points, mm, on all extrusions of the first `entries` of a job."""
    moves = read_moves(job.commands[:entries], setup.low, FLAVOURS[setup.flavour])
    extrudes = (moves.delta[:, 3] > 0) & (moves.delta[:, :2] != 0).any(axis=1)
    ends, deltas = moves.end[extrudes], moves.delta[extrudes, :3]
    pieces = np.maximum(np.ceil(np.hypot(deltas[:, 0], deltas[:, 1]) / _SAMPLE_DISTANCE), 1).astype(int)
    which = np.repeat(np.arange(len(pieces)), pieces)
    step = np.arange(len(which)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    fraction = ((step + 0.5) / pieces[which])[:, None]
    points: Float = ends[which] - deltas[which] * fraction
    return points


def find_approach_point(
    points: Float, goal: tuple[float, float, float], setup: HostSettings
) -> tuple[float, float] | None:
    """Return the point beside the part where the nozzle should move down to reach a position in the last layer.

    Args:
        points: (N, 3) sample points on all extrusions, mm.
        goal: the position, mm.
        setup: settings of the printer.

    Returns:
        x and y, mm; None if no such point is on the bed or higher extrusions block every direction. Then the nozzle
        must come from above.
    """
    x, y, z = goal
    near = points[points[:, 2] > z - _DEPTH]
    away = near[:, :2] - (x, y)
    higher = near[:, 2] > z + 0.05
    best: tuple[float, float, float] | None = None
    for number in range(_DIRECTIONS):
        angle = 2 * pi * number / _DIRECTIONS
        distances_along = away @ (cos(angle), sin(angle))
        distances_beside = np.abs(away @ (-sin(angle), cos(angle)))
        is_under = (distances_along > 0) & (distances_beside < _MAX_DISTANCE)
        out = float(distances_along[is_under].max(initial=0.0)) + _CLEARANCE
        if (
            higher
            & (distances_along > -_CLEARANCE)
            & (distances_along < out + _CLEARANCE)
            & (distances_beside < _CLEARANCE)
        ).any():
            continue
        at = x + out * cos(angle), y + out * sin(angle)
        on_bed = all(low <= value <= high for low, value, high in zip(setup.low, at, setup.high, strict=True))
        if on_bed and (best is None or out < best[0]):
            best = (out, *at)
    return best and best[1:]
