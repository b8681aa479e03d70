"""Widen perimeters to fill the gaps beside the rounded sides of external perimeters."""

from __future__ import annotations

import numpy as np

from printer_slicer import bead
from printer_slicer.arrays import Float
from printer_slicer.model import Toolpaths
from printer_slicer.roles import Role
from printer_slicer.values import replace

__all__ = ["widen_perimeters"]

_MAX_WIDENING = 0.15  # of the spacing of a perimeter
# Limit of the widening: a perimeter in the middle of a wall fills the gaps of two rounded sides. Islands with only an
# external perimeter must not widen the perimeters of other islands of their layer further.
_MAX_SIDES = 2.0


def widen_perimeters(paths: Toolpaths, area_to_fill: Float) -> Toolpaths:
    """Widen perimeters so that all perimeters of a layer together fill their area.

    External perimeters do not change, because they define dimensions and appearance.

    Args:
        paths: the perimeters.
        area_to_fill: (L,) area that the perimeters of each layer must fill, up to the contours, mm².
    """
    if not paths.n_paths:
        return paths
    area, inner = paths.area(), paths.role == Role.PERIMETER
    whole, own = (
        np.bincount(paths.layer[some], area[some], len(area_to_fill)) for some in (slice(None), inner)
    )
    missing = (area_to_fill - whole) / np.maximum(own, 1e-9)
    size = np.diff(paths.start)
    height = np.repeat(paths.height, size)
    spacing = bead.spacing(paths.width, height)
    most = np.minimum(_MAX_SIDES * bead.compute_side_extension(height), _MAX_WIDENING * spacing)
    more = np.clip(np.repeat(missing[paths.layer], size) * spacing, 0.0, most)
    width = np.where(np.repeat(inner, size), np.round(paths.width + more, 4), paths.width)
    return replace(paths, width=width)
