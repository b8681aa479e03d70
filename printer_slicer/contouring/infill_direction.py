"""Print contoured infill from low to high, so that the nozzle does not press down what it has printed."""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, run_starts
from printer_slicer.model import Toolpaths
from printer_slicer.roles import roles_with

__all__ = ["print_from_low_to_high"]

_MIN_CORRELATION: Final = 0.3  # of height and order; less is a row that goes up and down


def print_from_low_to_high(paths: Toolpaths) -> Toolpaths:
    """Reverse lowered infill, path by path or chain by chain, where its height falls in printing order.

    Args:
        paths: in printing order; the paths of a chain follow each other.
    """
    group = np.cumsum(run_starts(paths.chain_id) | (paths.chain_id < 0) | run_starts(paths.layer)) - 1
    falls = _find_falling_groups(paths, group)
    falls &= np.bincount(group, weights=paths.closed, minlength=len(falls)) == 0
    if not falls.any():
        return paths
    first = np.flatnonzero(run_starts(group))
    last = np.append(first[1:], len(group)) - 1
    is_reversed = falls[group]
    path = np.arange(paths.n_paths)
    path = np.where(is_reversed, first[group] + last[group] - path, path)
    return paths.arrange(path, is_reversed)


def _find_falling_groups(paths: Toolpaths, group: Int) -> Bool:
    """Return which groups of paths, numbered by `group` (M,), are lowered infill that falls as it is printed."""
    n_groups = int(group[-1]) + 1
    begin, end = paths.ends_of_beads
    path = paths.path_of_bead
    lowered = np.zeros(n_groups, np.bool_)
    low = (paths.z_offset[begin] < 0) & roles_with(is_infill=True)[paths.role[path]]
    lowered[group[path[low]]] = True
    some = np.flatnonzero(lowered[group[path]])
    begin, end, number = begin[some], end[some], group[path[some]]
    length = np.hypot(*(paths.xy[end] - paths.xy[begin]).T)
    along = np.cumsum(length) - length / 2
    z = (paths.z_offset[begin] + paths.z_offset[end]) / 2
    total = np.bincount(number, length, minlength=n_groups)

    def centre(values: Float) -> Float:
        """Return values minus their mean in their group."""
        mean = np.bincount(number, values * length, minlength=n_groups) / np.maximum(total, 1e-12)
        return np.asarray(values - mean[number])

    along, z = centre(along), centre(z)
    product, one, other = (
        np.bincount(number, values * length, minlength=n_groups) for values in (along * z, along**2, z**2)
    )
    return np.asarray(product < -_MIN_CORRELATION * np.sqrt(one * other) - 1e-12)
