"""Print time of supports by group of overhangs, from the moves that print their paths.

Most layers of supports are like their neighbours. So only some layers are put in order and timed; in the others, the
paths of a group take the same time per mm.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Final

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, distinct
from printer_slicer.extrusion import compute_path_seconds
from printer_slicer.model import Areas, Sections, Toolpaths
from printer_slicer.ordering import order
from printer_slicer.profile import Profile
from printer_slicer.roles import Role
from printer_slicer.travels import travel
from printer_slicer.values import replace

__all__ = ["measure_group_times"]

_SAMPLES: Final = 32  # layers of each kind that are timed


def measure_group_times(paths: Toolpaths, group: Int, n_groups: int, profile: Profile) -> Float:
    """Return the time (n_groups,) that the paths of each group take, with the travels to them, s.

    Args:
        paths: of supports.
        group: (M,) group of each path.
        n_groups: number of groups.
        profile: speeds, and the limits of the printer.
    """
    if not paths.n_paths:
        return np.zeros(n_groups)
    kind = np.where(paths.closed, _Kind.LOOPS, _Kind.LINES)
    kind[paths.role == Role.SUPPORT_INTERFACE] = _Kind.INTERFACE
    kind[paths.layer == 0] = _Kind.FIRST_LAYER
    timed = _choose_layers(paths, kind)[paths.layer]
    class_of, n = group * len(_Kind) + kind, n_groups * len(_Kind)
    length = paths.length()
    spent = _time_paths(paths.take(np.flatnonzero(timed)), class_of[timed], n, profile)
    known, rest = (np.bincount(class_of[some], length[some], n) for some in (timed, ~timed))
    rate = np.where(known > 0, spent / np.maximum(known, 1e-9), spent.sum() / max(known.sum(), 1e-9))
    return np.asarray((spent + rate * rest).reshape(n_groups, -1).sum(axis=1))


class _Kind(IntEnum):
    """Kinds of paths, which take different times per mm."""

    FIRST_LAYER = 0
    LOOPS = 1
    LINES = 2
    INTERFACE = 3


def _choose_layers(paths: Toolpaths, kind: Int) -> Bool:
    """Return a mask (L,) of the layers that are timed: for each kind (M,) of paths some, evenly spaced."""
    chosen = np.zeros(paths.plan.n_layers, np.bool_)
    for one in _Kind:
        layers = distinct(paths.layer[kind == one])
        step = np.linspace(0, len(layers) - 1, min(_SAMPLES, len(layers)))
        chosen[layers[np.rint(step).astype(np.int64)]] = True
    return chosen


def _time_paths(paths: Toolpaths, class_of: Int, n_classes: int, profile: Profile) -> Float:
    """Return the time (n_classes,) that the paths of each class take when they are printed in order, s.

    The nozzle rises from layer to layer as if there were no others between them.
    """
    used, entry = np.unique(paths.layer, return_inverse=True)
    z = np.cumsum(paths.plan.height[used])[entry]
    around = Sections(paths.plan, Areas.empty(paths.plan.n_layers))
    ordered = order(replace(paths, z_top=z, settings_id=class_of), around, profile)
    class_of, ordered = ordered.settings_id, replace(ordered, settings_id=np.zeros_like(ordered.settings_id))
    seconds = compute_path_seconds(ordered, travel(ordered, around, profile), profile)
    return np.bincount(class_of, seconds, n_classes).astype(np.float64)
