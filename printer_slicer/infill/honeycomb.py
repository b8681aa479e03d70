"""Honeycomb infill: hexagonal cells, the same on every layer."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.geometry import Polylines
from printer_slicer.infill.infill_task import InfillTask
from printer_slicer.infill.periodic_lines import PeriodicLines, clip_periodic_lines

__all__ = ["honeycomb_lines"]


def honeycomb_lines(task: InfillTask) -> tuple[Polylines, Float]:
    """Return zigzags that touch each other along every third side of the cells.

    Three sides meet at every corner of a honeycomb, so long lines cannot pass each side exactly once. The sides along
    the lines consist of two extrusions next to each other. The cell size takes them into account.
    """
    n, bead = len(task.z), task.bead
    side = _hexagon_side(task.spacing, bead)
    pitch = np.sqrt(0.75) * side
    low, high = bead / 2, pitch - bead / 2
    u = side * np.array([0.0, 1.0, 1.5, 2.5])
    one = np.stack([u, [low, low, high, high]], axis=1)
    another = np.stack([u, [high + pitch, high + pitch, low + pitch, low + pitch]], axis=1)
    return clip_periodic_lines(
        task.area,
        PeriodicLines(
            np.tile(np.concatenate([one, another]), (n, 1)),
            4 * np.arange(2 * n + 1),
            period=3 * side,
            pitch=2 * pitch,
            angle=task.angle,
            swapped=np.zeros(n, np.bool_),
        ),
    ), np.ones(n)


def _hexagon_side(spacing: float, bead: float) -> float:
    """Return the side of the hexagons, mm, for zigzags as long as parallel lines `spacing` mm apart.

    Zigzags one pitch p = √(3/4) a apart have two straight walls a and two slanted ones that rise by p - bead in each
    period of 3 a: 2 a + 2 √(a²/4 + (p - bead)²) = 3 a p / spacing. The left side grows more slowly, so there is one
    solution; bisection finds it to the last digit.
    """
    low, high = 0.0, 4 * spacing + 4 * bead
    for _ in range(60):
        a = (low + high) / 2
        p = np.sqrt(0.75) * a
        longer = 2 * a + 2 * np.sqrt(a * a / 4 + (p - bead) ** 2) > 3 * a * p / spacing
        low, high = (a, high) if longer else (low, a)
    return high
