"""Approach to an unfinished part: come down outside of it, then move over as little of it as possible."""

from __future__ import annotations

from math import cos, pi, sin
from typing import Final

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.firmware import FLAVOURS
from printer_slicer.gcode import read_moves
from printer_slicer.jobs import Job
from printer_slicer.printing.host_settings import HostSettings

__all__ = ["extruded_points", "find_approach"]

_DIRECTIONS: Final = 72
_BESIDE: Final = 1.5  # mm; an extrusion this close to the approach counts as under it
_CLEAR: Final = 5.0  # mm between the part and the point where the nozzle comes down
_DEPTH: Final = 2.0  # mm; parts farther below the nozzle are ignored
_SAMPLE: Final = 1.0  # mm between sample points on an extrusion


def extruded_points(job: Job, entries: int, setup: HostSettings) -> Float:
    """Return (N, 3) sample points, mm, on all extrusions of the first entries of a job."""
    moves = read_moves(job.commands[:entries], setup.low, FLAVOURS[setup.flavour])
    extrudes = (moves.delta[:, 3] > 0) & (moves.delta[:, :2] != 0).any(axis=1)
    ends, deltas = moves.end[extrudes], moves.delta[extrudes, :3]
    pieces = np.maximum(np.ceil(np.hypot(deltas[:, 0], deltas[:, 1]) / _SAMPLE), 1).astype(int)
    which = np.repeat(np.arange(len(pieces)), pieces)
    step = np.arange(len(which)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    share = ((step + 0.5) / pieces[which])[:, None]
    points: Float = ends[which] - deltas[which] * share
    return points


def find_approach(
    points: Float, goal: tuple[float, float, float], setup: HostSettings
) -> tuple[float, float] | None:
    """Return where to come down beside the part, on the way to a position in its last layer.

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
        along = away @ (cos(angle), sin(angle))
        beside = np.abs(away @ (-sin(angle), cos(angle)))
        under = (along > 0) & (beside < _BESIDE)
        out = float(along[under].max(initial=0.0)) + _CLEAR
        if (higher & (along > -_CLEAR) & (along < out + _CLEAR) & (beside < _CLEAR)).any():
            continue
        at = x + out * cos(angle), y + out * sin(angle)
        on_bed = all(low <= value <= high for low, value, high in zip(setup.low, at, setup.high, strict=True))
        if on_bed and (best is None or out < best[0]):
            best = (out, *at)
    return best and best[1:]
