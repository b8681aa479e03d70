"""Inner perimeters are wider by what the round sides of the outer ones leave empty along the contours."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from printer_slicer import bead
from printer_slicer.model import Float, Role, Toolpaths

__all__ = ["widen_inner"]

_MOST_WIDER = 0.15  # of the spacing of an inner perimeter
# Round sides of outer perimeters: one amid a wall has two of them to make up for. Islands without inner perimeters do
# not make those of other islands of their layer wider than that.
_MOST_SIDES = 2.0


def widen_inner(paths: Toolpaths, room: Float) -> Toolpaths:
    """The perimeters, with inner ones so wide that all perimeters of a layer together fill their room.

    Outer perimeters stay as they are: their width is what is seen and measured.

    Args:
        paths: perimeters.
        room: (L,) mm² of each layer that perimeters have to fill, up to the contours.
    """
    if not paths.n_paths:
        return paths
    area, inner = paths.area(), paths.role == Role.INNER_PERIMETER
    whole, own = (np.bincount(paths.layer[some], area[some], len(room)) for some in (slice(None), inner))
    missing = (room - whole) / np.maximum(own, 1e-9)
    size = np.diff(paths.start)
    height = np.repeat(paths.height, size)
    spacing = bead.spacing(paths.width, height)
    most = np.minimum(_MOST_SIDES * bead.side_loss(height), _MOST_WIDER * spacing)
    more = np.clip(np.repeat(missing[paths.layer], size) * spacing, 0.0, most)
    width = np.where(np.repeat(inner, size), np.round(paths.width + more, 4), paths.width)
    return replace(paths, width=width)
