"""Hexagonal cells, the same on every layer."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.geometry import Polylines
from printer_slicer.infill.task import Task
from printer_slicer.infill.waves import Waves, wave_lines

__all__ = ["honeycomb_lines"]


def honeycomb_lines(task: Task) -> tuple[Polylines, Float]:
    """Zigzags that touch each other where they come together.

    Three walls meet at every corner of a honeycomb, so no set of long lines passes each wall once. Here the walls along
    the lines are two beads side by side, with no travel between; they are not printed twice in one place, and
    the pattern's size takes their plastic into account.
    """
    n, bead = len(task.z), task.bead
    side = _side(task.spacing, bead)
    pitch = np.sqrt(0.75) * side
    low, high = bead / 2, pitch - bead / 2
    u = side * np.array([0.0, 1.0, 1.5, 2.5])
    one = np.stack([u, [low, low, high, high]], axis=1)
    another = np.stack([u, [high + pitch, high + pitch, low + pitch, low + pitch]], axis=1)
    return wave_lines(
        task.area,
        Waves(
            np.tile(np.concatenate([one, another]), (n, 1)),
            4 * np.arange(2 * n + 1),
            period=3 * side,
            pitch=2 * pitch,
            angle=task.angle,
            swapped=np.zeros(n, np.bool_),
        ),
    ), np.ones(n)


def _side(spacing: float, bead: float) -> float:
    """Side of the hexagons, mm, with which the zigzags are as long as parallel lines `spacing` mm apart.

    Zigzags one pitch p = √(3/4) a apart have two straight walls a and two slanted ones that rise by p - bead in each
    period of 3 a: 2 a + 2 √(a²/4 + (p - bead)²) = 3 a p / spacing. The left side grows more slowly, so there is one
    solution; halving finds it to the last digit.
    """
    low, high = 0.0, 4 * spacing + 4 * bead
    for _ in range(60):
        a = (low + high) / 2
        p = np.sqrt(0.75) * a
        longer = 2 * a + 2 * np.sqrt(a * a / 4 + (p - bead) ** 2) > 3 * a * p / spacing
        low, high = (a, high) if longer else (low, a)
    return high
