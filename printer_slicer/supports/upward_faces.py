"""Find the horizontal faces of the part on which supports may stand."""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.geometry import difference, intersection, offset_open
from printer_slicer.geometry.layer_union import unite_layers
from printer_slicer.model import Overhangs, Sections

__all__ = ["find_upward_faces"]

_MIN_AREA: Final = 4.0  # mm² of a face that counts
_MIN_WIDTH: Final = 2.0  # mm; the steps of slopes are narrower


def find_upward_faces(overhangs: Overhangs, sections: Sections) -> Float:
    """Return the heights (n,), mm, of horizontal faces that face up and lie below overhangs, seen from above.

    Args:
        overhangs: areas that need supports.
        sections: the part, or all objects; areas may have other layers than `overhangs`.
    """
    solid, plan = sections.solid, sections.plan
    area, highest = solid.area(), overhangs.plan.bottom[overhangs.area.used].max(initial=0.0)
    # Where a section is hardly smaller than the one below, no wide face ends the lower one.
    lower = np.flatnonzero((area[:-1] - area[1:] > _MIN_AREA) & (plan.top[:-1] < highest))
    if not len(lower):
        return np.zeros(0)
    faces = difference(solid.copy_layers(lower), solid.copy_layers(lower + 1))
    seen = unite_layers(overhangs.area).copy_layers(np.zeros(len(lower), np.int64))
    below = offset_open(intersection(faces, seen), _MIN_WIDTH / 2)
    return np.asarray(plan.top[lower[below.area() > _MIN_AREA]])
