"""How far supports stand beside the outline of the part that they carry, seen from above."""

from __future__ import annotations

import numpy as np

from printer_slicer.model import Mesh
from printer_slicer.profile import Profile
from printer_slicer.supports.slopes import limit_threshold

__all__ = ["measure_reach"]

_MIN_AREA = 1.0  # mm²; parts with fewer overhangs get no room for supports
_ABOVE_BED = 0.5  # mm above the bottom of the part; lower facets lie on the bed


def measure_reach(mesh: Mesh, profile: Profile) -> float:
    """Return how far supports extend beyond what they carry, mm; 0 if a part has none.

    Supports stand below overhangs, which are part of the outline from above. Beside it are only half of an extrusion,
    half of a branch, and the foot.

    Args:
        mesh: the part, as it is printed.
        profile: the settings for this part.
    """
    quality = profile.quality
    if quality.support == "off" or not _has_overhangs(mesh, quality.support_threshold_deg):
        return 0.0
    branch = 0.0 if quality.support == "columns" else quality.support_branch_diameter
    return quality.support_first_layer_expansion + max(branch, profile.extrusion_width) / 2


def _has_overhangs(mesh: Mesh, threshold_deg: float) -> bool:
    """Return whether a part has overhangs above its bottom: facets that face down, flatter than an angle in degrees."""
    a, b = (mesh.triangles[:, corner] - mesh.triangles[:, 0] for corner in (1, 2))
    normal = np.cross(a, b)
    length = np.linalg.norm(normal, axis=1)
    is_flat = normal[:, 2] < -np.cos(np.deg2rad(limit_threshold(threshold_deg))) * length
    is_high = mesh.triangles[:, :, 2].max(axis=1) > mesh.bounds[0, 2] + _ABOVE_BED
    return bool(length[is_flat & is_high].sum() / 2 > _MIN_AREA)
