"""Values that the planner needs for one of several objects that are printed together.

The layers of all objects at the same height cool together, so each object needs only a part of the minimum layer time.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from printer_slicer.arrays import Float
from printer_slicer.model import Mesh
from printer_slicer.planning.layer_times import LayerTimes
from printer_slicer.profile import Profile, profile_with
from printer_slicer.surface import read_surface

__all__ = ["compute_error_price", "compute_time_shares"]


def compute_error_price(mesh: Mesh, profile: Profile) -> float:
    """Return the print time worth spending to avoid 1 mm³ of volume error, s, as `plan_optimal` does for a part."""
    dials = profile.dials
    if dials.error_price:
        return dials.error_price
    times = LayerTimes(read_surface(mesh), profile, np.array([0.0, mesh.height]))
    return dials.error_price_ratio * times.seconds_per_mm3(profile.quality.layer_height)


def compute_time_shares(meshes: Sequence[Mesh], counts: Sequence[int], profile: Profile) -> Float:
    """Return for each object (n,) its share in the print time of all objects, over its own height.

    Args:
        meshes: one object of each shape, standing on z = 0.
        counts: number of objects of each shape.
        profile: speeds and layer height.
    """
    height = profile.quality.layer_height
    quick = profile_with(profile, {"material.min_layer_time": 0})
    z = np.arange(height / 2, max(mesh.height for mesh in meshes) + height, height)
    seconds = np.zeros((len(meshes), len(z)))
    for row, mesh in zip(seconds, meshes, strict=True):
        within = np.flatnonzero(z <= max(mesh.height, height))
        row[within] = LayerTimes(read_surface(mesh), quick, z).seconds(within, height)
    total = np.asarray(counts) @ seconds
    return np.array([row.sum() / max(total[row > 0].sum(), 1e-9) for row in seconds])
