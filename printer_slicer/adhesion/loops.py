"""Helpers for skirt, brim and raft: make paths from rings, and test whether they lie on the bed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.model import LayerPlan, Toolpaths
from printer_slicer.profile import Profile
from printer_slicer.roles import Role

__all__ = ["is_on_bed", "loop_paths"]


def loop_paths(
    plan: LayerPlan,
    lines: Sequence[Float],
    layer: Int,
    role: Role,
    width: float | Float,
    *,
    closed: bool | Bool = True,
) -> Toolpaths:
    """Return polylines (n, 2) as paths of one role, each on its layer (M,).

    `width` is one width for all, or one for each (M,), mm.
    """
    return Toolpaths.gathered(
        plan,
        xy=np.concatenate([np.zeros((0, 2)), *lines]),
        size=np.array([len(line) for line in lines], np.int64),
        layer=layer,
        role=np.full(len(layer), role, np.int64),
        width=np.broadcast_to(np.asarray(width, np.float64), (len(lines),)),
        closed=closed,
    )


def is_on_bed(lines: Sequence[Float], profile: Profile, width: float) -> bool:
    """Return whether closed extrusions (n, 2) lie on the bed with their whole width, and enter no excluded area."""
    low, high = profile.printer.corners
    if profile.printer.excluded_areas:
        from printer_slicer.excluded_areas import enters_excluded_areas  # noqa: PLC0415 - few beds have such areas

        if enters_excluded_areas(lines, width, profile.printer):
            return False
    xy = np.concatenate([np.zeros((0, 2)), *lines]) if lines else np.zeros((0, 2))
    inside = (xy >= np.add(low, width / 2)) & (xy <= np.subtract(high, width / 2))
    return bool(inside.all())
