"""Find overhangs whose surface is flatter than the threshold.

Sections are cut somewhere within each layer. A surface with the angle t to the horizontal moves outward by
(distance of the cuts) / tan t from one section to the next. So a plane is found at all layer heights, or at none.
"""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.geometry import Areas, intersection, offset
from printer_slicer.model import LayerPlan

__all__ = ["compute_steps", "find_strips", "grow_by_step", "limit_threshold"]

_MIN_ANGLE_DEG = 5.0  # degrees; flatter surfaces always hang, because steps must stay finite
_SLACK = 1e-3  # mm; more than the rounding of areas


def limit_threshold(threshold_deg: float) -> float:
    """Return the angle from the horizontal below which surfaces are overhangs, degrees: the setting, at least 5."""
    return max(threshold_deg, _MIN_ANGLE_DEG)


def compute_steps(plan: LayerPlan, threshold_deg: float) -> Float:
    """Return how far (L,) a section may extend beyond the one below without being an overhang, mm."""
    slope = np.tan(np.deg2rad(limit_threshold(threshold_deg)))
    return np.asarray(np.diff(plan.cut, prepend=0.0) / slope)


def grow_by_step(below: Areas, step: Float) -> Areas:
    """Return sections grown by the step of each layer (L,), mm: how far the section above may extend."""
    return offset(below, step + _SLACK)


def find_strips(air: Areas, steep: Areas, step: Float) -> Areas:
    """Return overhangs: strips outside the section below, where they are wider than a step.

    Args:
        air: part of each section outside the section below.
        steep: part of each section farther than a step outside the section below.
        step: (L,) mm, see `compute_steps`.
    """
    return intersection(air, offset(steep, step + 2 * _SLACK))
