"""Periodic line patterns, clipped to the areas of a stack of layers."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, bounding_boxes, consecutive, frozen_array
from printer_slicer.geometry import Areas, Polylines, clip_lines
from printer_slicer.values import Struct, force_setattr

__all__ = ["PeriodicLines", "clip_periodic_lines"]

_MAX_POINTS = 500_000  # points that are clipped at once


class PeriodicLines(Struct, frozen=True, eq=False):
    """Two lines for each entry, which repeat with a period along the pattern and a pitch across it.

    Attributes:
        uv: (T, 2) mm along and across, points of one period of each line, ascending along.
        start: (2 E + 1,) lines 2 e and 2 e + 1 of `uv` belong to entry e.
        period, pitch: mm.
        angle: radians, direction along.
        swapped: (E,) whether along and across are exchanged.
    """

    uv: Float
    start: Int
    period: float
    pitch: float
    angle: float
    swapped: Bool

    def __post_init__(self) -> None:
        force_setattr(self, "uv", frozen_array(self.uv, np.float64, (-1, 2)))
        force_setattr(self, "start", frozen_array(self.start, np.int64, (-1,)))
        force_setattr(self, "swapped", frozen_array(self.swapped, np.bool_, (len(self.start) // 2,)))


def clip_periodic_lines(area: Areas, waves: PeriodicLines) -> Polylines:
    """Clip the pattern to the areas."""
    entry, low, high = _find_boxes(area, waves)
    line = np.stack([2 * entry, 2 * entry + 1], axis=1).ravel()
    size = np.diff(waves.start)
    across = waves.uv[:, 1]
    lowest = np.minimum.reduceat(across, waves.start[:-1])[line]
    highest = np.maximum.reduceat(across, waves.start[:-1])[line]
    low, high = np.repeat(low, 2, axis=0), np.repeat(high, 2, axis=0)
    first_row = np.ceil((low[:, 1] - highest) / waves.pitch).astype(np.int64)
    rows = np.maximum(np.floor((high[:, 1] - lowest) / waves.pitch).astype(np.int64) - first_row + 1, 0)
    # One more period at both ends, so that every line begins and ends outside.
    first_period = np.floor(low[:, 0] / waves.period).astype(np.int64) - 1
    periods = np.floor(high[:, 0] / waves.period).astype(np.int64) + 2 - first_period
    block = np.cumsum(rows * periods * size[line]) // _MAX_POINTS
    parts = []
    for some in np.split(np.arange(len(line)), np.flatnonzero(np.diff(block)) + 1):
        row = consecutive(first_row[some], rows[some])
        which, count = (np.repeat(column[some], rows[some]) for column in (line, periods))
        laid = _repeat_lines(waves, which, row, np.repeat(first_period[some], rows[some]), count)
        parts.append(clip_lines(area, laid))
    return Polylines.joined(parts)


def _repeat_lines(waves: PeriodicLines, line: Int, row: Int, first: Int, periods: Int) -> Polylines:
    """Return one polyline for each row: a line of the pattern, repeated `periods` times."""
    size = np.diff(waves.start)[line]
    owner = np.repeat(np.arange(len(line)), periods)
    period = consecutive(first, periods)
    points = consecutive(waves.start[:-1][line][owner], size[owner])
    piece = np.repeat(np.arange(len(owner)), size[owner])
    u, v = waves.uv[points].T
    u = u + (period * waves.period)[piece]
    v = v + (row * waves.pitch)[owner][piece]
    entry = line // 2
    swapped = waves.swapped[entry][owner][piece]
    x, y = np.where(swapped, v, u), np.where(swapped, u, v)
    cos, sin = np.cos(waves.angle), np.sin(waves.angle)
    xy = np.stack([x * cos - y * sin, x * sin + y * cos], axis=1)
    return Polylines.of(xy, size * periods, entry)


def _find_boxes(area: Areas, waves: PeriodicLines) -> tuple[Int, Float, Float]:
    """Return the entries with an area, and the corners of their bounding boxes along and across the pattern."""
    cos, sin = np.cos(waves.angle), np.sin(waves.angle)
    x, y = area.xy.T
    x, y = x * cos + y * sin, y * cos - x * sin
    swapped = waves.swapped[area.point_layer]
    uv = np.stack([np.where(swapped, y, x), np.where(swapped, x, y)], axis=1)
    low, high = bounding_boxes(uv, area.ring_start, area.ring_layer, area.n_layers)
    entry = np.flatnonzero(area.used)
    return entry, low[entry], high[entry]
