"""Toolpaths -> Toolpaths: short lines that nearly lie on one line become one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from printer_slicer.arrays import Bool, Int, consecutive
from printer_slicer.curves.lines import PathLines, stretches
from printer_slicer.model import Toolpaths

__all__ = ["merged"]


def merged(paths: Toolpaths, chosen: Bool, tolerance: float) -> Toolpaths:
    """The paths; lines of those `chosen` (M,) are joined where nothing is moved by more than `tolerance` mm."""
    line = PathLines.of(paths)
    owner = np.searchsorted(paths.start, line.begin, side="right") - 1
    arc = np.isfinite(paths.centre[line.begin, 0])
    # Neither a chord of an arc nor what follows it is joined with what stands before.
    line = replace(line, apart=line.apart | ~chosen[owner] | arc | np.append(False, arc[:-1]))

    def fits(first: Int, stop: Int) -> Bool:
        return _fits(line, first, stop, tolerance)

    first, stop = stretches(line, fits)
    kept = np.ones(len(paths.xy), np.bool_)
    kept[line.begin[consecutive(first + 1, stop - first - 1)]] = False
    return paths.of_points(
        np.flatnonzero(kept), np.append(0, np.cumsum(kept))[paths.start], np.arange(paths.n_paths)
    )


def _fits(line: PathLines, first: Int, stop: Int, tolerance: float) -> Bool:
    """(T,) whether all points of lines `first` up to `stop` lie near to the one from begin to end, and in turn."""
    size = stop - first
    begin, last = line.xy[first], line.xy[stop - 1] + line.way[stop - 1]
    chord = last - begin
    length = np.maximum(np.hypot(*chord.T), 1e-9)
    owner, lines = np.repeat(np.arange(len(first)), size), consecutive(first, size)
    to, along = line.xy[lines] - begin[owner], (chord / length[:, None])[owner]
    off = np.abs(to[:, 0] * along[:, 1] - to[:, 1] * along[:, 0])
    ahead = (line.way[lines] * along).sum(axis=1)
    starts = np.cumsum(size) - size
    return np.asarray(
        (np.maximum.reduceat(off, starts) <= tolerance) & (np.minimum.reduceat(ahead, starts) > 0)
    )
