"""Paths that follow a shallow upper surface, and so are in part lower than their layer."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Bool
from printer_slicer.model import Toolpaths
from printer_slicer.profile import Profile

__all__ = ["find_lowered_paths"]


def find_lowered_paths(paths: Toolpaths, profile: Profile) -> Bool:
    """Return a mask (M,) of the contoured paths: lower than their top somewhere, and with full flow everywhere else.

    Scarf seams also are lower than their top, but the rest of their flow comes at the top.
    """
    result = np.zeros(paths.n_paths, np.bool_)
    if not profile.quality.z_contouring:
        return result
    owner = np.repeat(np.arange(paths.n_paths), np.diff(paths.start))
    result[owner[paths.z_offset < 0]] = True
    result[owner[(paths.z_offset == 0) & (paths.flow_ratio < 1)]] = False
    return result
