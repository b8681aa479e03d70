"""Toolpaths -> Toolpaths: stretches of short lines that lie on a circle become arcs.

A circle goes through both ends of a stretch, so one number is left to be found, by least squares. Stretches grow by
joining neighbours, all over the stack at once, as long as no point and no line is farther from the circle than the
tolerance. The points of an arc are then those of the chords that firmware makes of it: what is timed, drawn and
measured is what the machine does.

Source: for a circle through two points, P. D. Thomas and Y. T. Chan 1989, "A simple approach for the estimation of
circular arc center and its radius"; chords as in `motion.arcs`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, consecutive
from printer_slicer.curves.lines import PathLines, stretches
from printer_slicer.model import Toolpaths
from printer_slicer.motion.arcs import CHORDS_PER_TURN, LONGEST_CHORD, SHORTEST_CHORD
from printer_slicer.profile import Profile

__all__ = ["curved"]

_LEAST = 3  # lines in an arc: fewer are no curve
# Mm, radius of an arc. Of smaller ones firmware makes chords so short that they use up the moves that it plans ahead.
_SMALLEST, _LARGEST = 2.5, 500.0
_WIDEST_TURN = np.radians(160)  # of an arc


def curved(paths: Toolpaths, profile: Profile) -> Toolpaths:
    """The paths with arcs where `quality.arc_tolerance` allows; beads whose width changes stay lines."""
    tolerance = profile.quality.arc_tolerance
    if not tolerance or not paths.n_paths:
        return paths
    line = PathLines.of(paths)

    def fits(first: Int, stop: Int) -> Bool:
        return _fits(line, first, stop, tolerance)

    first, stop = stretches(line, fits)
    arc = np.flatnonzero(stop - first >= _LEAST)
    return _with_arcs(paths, line, first[arc], stop[arc]) if len(arc) else paths


def _fits(line: PathLines, first: Int, stop: Int, tolerance: float) -> Bool:
    """(T,) whether lines `first` up to `stop` lie on a circle."""
    centre, radius = _circles(line, first, stop)
    size = stop - first
    owner, lines = np.repeat(np.arange(len(first)), size), consecutive(first, size)
    begin, way = line.xy[lines], line.way[lines]
    out = begin - centre[owner]
    off = np.abs(np.hypot(*out.T) - radius[owner])
    length = np.hypot(*way.T)
    # In the middle of a line the circle is farther out.
    off = np.maximum(off, np.abs(np.hypot(*(out + way / 2).T) - radius[owner]))
    half = np.minimum(length / 2, radius[owner])
    side = out[:, 0] * way[:, 1] - out[:, 1] * way[:, 0]
    turned = 2 * np.arcsin(np.minimum(half / radius[owner], 1.0))
    starts = np.cumsum(size) - size
    worst = np.maximum.reduceat(off, starts)
    one_way = (np.minimum.reduceat(side, starts) > 0) | (np.maximum.reduceat(side, starts) < 0)
    total = np.add.reduceat(turned, starts)
    good = (worst <= tolerance) & one_way & (total <= _WIDEST_TURN)
    return np.asarray(good & (radius >= _SMALLEST) & (radius <= _LARGEST))


def _circles(line: PathLines, first: Int, stop: Int) -> tuple[Float, Float]:
    """Centre (T, 2) and radius (T,) of the circle through both ends of each stretch that fits its points best."""
    begin, last = line.xy[first], line.xy[stop - 1] + line.way[stop - 1]
    middle, chord = (begin + last) / 2, last - begin
    length = np.maximum(np.hypot(*chord.T), 1e-9)
    normal = np.column_stack([-chord[:, 1], chord[:, 0]]) / length[:, None]
    size = stop - first - 1
    some = size > 0
    starts = (np.cumsum(size) - size)[some]
    owner, inner = np.repeat(np.arange(len(first)), size), consecutive(first + 1, size)
    to = line.xy[inner] - middle[owner]
    beside = (to * normal[owner]).sum(axis=1)
    excess = (to * to).sum(axis=1) - (length[owner] / 2) ** 2
    shift = np.full(len(first), np.inf)
    if len(starts):
        weight = np.add.reduceat(beside * beside, starts)
        shift[some] = np.add.reduceat(excess * beside, starts) / np.maximum(2 * weight, 1e-18)
    shift = np.clip(shift, -10 * _LARGEST, 10 * _LARGEST)
    return middle + shift[:, None] * normal, np.hypot(shift, length / 2)


def _with_arcs(paths: Toolpaths, line: PathLines, first: Int, stop: Int) -> Toolpaths:
    """The paths with the points of arcs in the place of those of lines `first` up to `stop` (A,)."""
    centre, radius = _circles(line, first, stop)
    begin, last = line.xy[first], line.xy[stop - 1] + line.way[stop - 1]
    out, home = begin - centre, last - centre
    angle = np.arctan2(out[:, 1], out[:, 0])
    side = out[:, 0] * line.way[first, 1] - out[:, 1] * line.way[first, 0]
    sweep = np.mod(np.arctan2(home[:, 1], home[:, 0]) - angle, 2 * np.pi)
    sweep = np.where(side > 0, sweep, sweep - 2 * np.pi)
    chord = np.clip(radius * 2 * np.pi / CHORDS_PER_TURN, SHORTEST_CHORD, LONGEST_CHORD)
    pieces = np.maximum(np.ceil(radius * np.abs(sweep) / chord - 1e-9).astype(np.int64), 1)
    # Each point is followed by what its line has become: itself, or if an arc begins there the ends of its chords.
    count = np.ones(len(paths.xy), np.int64)
    inner = consecutive(first + 1, stop - first - 1)
    count[line.begin[inner]] = 0
    count[line.begin[first]] = pieces
    source = np.repeat(np.arange(len(paths.xy)), count)
    step = consecutive(np.zeros_like(count), count)
    total = np.append(0, np.cumsum(count))
    some = paths.of_points(source, total[paths.start], np.arange(paths.n_paths))
    arc = np.full(len(paths.xy), -1)
    arc[line.begin[first]] = np.arange(len(first))
    of = arc[source]
    on = np.flatnonzero(of >= 0)
    turned = angle[of[on]] + sweep[of[on]] * step[on] / pieces[of[on]]
    xy, centres = some.xy.copy(), np.full((len(source), 2), np.nan)
    round_about = centre[of[on]] + radius[of[on]][:, None] * np.column_stack([np.cos(turned), np.sin(turned)])
    xy[on] = np.where((step[on] > 0)[:, None], round_about, xy[on])
    centres[on] = centre[of[on]]
    return replace(some, xy=xy, centre=centres)
