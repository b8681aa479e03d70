"""G-code with known extrusions, line by line."""

from __future__ import annotations

from collections.abc import Sequence
from math import pi

import numpy as np

from printer_slicer import bead
from printer_slicer.arrays import Float
from printer_slicer.geometry import Areas
from printer_slicer.inspection.coverage.extrusions import Extrusions
from printer_slicer.inspection.deposition.marks import Purpose

__all__ = ["WIDTH", "beads_along", "joined", "path", "sections", "solid", "square"]

WIDTH = 0.45
_FILAMENT = pi * 1.75**2 / 4


def path(points: Sequence[tuple[float, float]], z: float, height: float, width: float = WIDTH) -> list[str]:
    """Travel to the first point, then beads (M83) through the others."""
    (x, y), *rest = points
    lines = [f"G0 X{x:.5f} Y{y:.5f} Z{z:.5f}"]
    for a, b in rest:
        fed = float(np.hypot(a - x, b - y) * bead.cross_section(width, height)) / _FILAMENT
        lines.append(f"G1 X{a:.5f} Y{b:.5f} E{fed:.7f}")
        x, y = a, b
    return lines


def beads_along(
    points: Sequence[tuple[float, float]],
    *,
    z: float = 0.2,
    height: float = 0.2,
    width: float = WIDTH,
    purpose: Purpose = Purpose.UNKNOWN,
) -> Extrusions:
    """Beads through points."""
    xy = np.array(points, np.float64)
    n = len(xy) - 1
    return Extrusions(
        begin=xy[:-1],
        end=xy[1:],
        z_top=np.full(n, z),
        rise=np.zeros(n),
        height=np.full(n, height),
        area=np.full(n, float(bead.cross_section(width, height))),
        purpose=np.full(n, purpose),
        line=np.arange(n) + 1,
    )


def joined(*parts: Extrusions) -> Extrusions:
    """Several, one after the other."""
    return Extrusions(
        *(np.concatenate([getattr(part, name) for part in parts]) for name in Extrusions.__struct_fields__)
    )


def square(side: float, low: tuple[float, float] = (0.0, 0.0)) -> Float:
    """(4, 2) counter-clockwise."""
    x, y = low
    return np.array([(x, y), (x + side, y), (x + side, y + side), (x, y + side)])


def sections(*rings: list[Float]) -> Areas:
    """One layer for each list of rings."""
    return Areas.from_rings(list(rings))


def solid(wide: float, rows: int, *, z: float = 0.2, height: float = 0.2, width: float = WIDTH) -> Extrusions:
    """Parallel beads one spacing apart along x, each from 0 to `wide`; the first has its side at y = 0."""
    gap = float(bead.spacing(width, height))
    return joined(
        *(
            beads_along(
                [(0, width / 2 + k * gap), (wide, width / 2 + k * gap)], z=z, height=height, width=width
            )
            for k in range(rows)
        )
    )
