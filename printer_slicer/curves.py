"""Replace runs of short moves by arcs or by longer lines.

Ranges of moves grow by joining neighbours, in the whole stack at once, as long as no point and no move deviates from
the arc or line by more than the tolerance. An arc passes through both ends of its range, so only one number is fitted,
by least squares. The points of an arc are the ends of the chords into which the firmware splits it, so that timing,
drawing and measuring see what the machine does.

Source: for a circle through two points, P. D. Thomas and Y. T. Chan 1989, "A simple approach for the estimation of
circular arc center and its radius"; chords as in `motion.arcs`.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, consecutive, run_starts
from printer_slicer.model import Toolpaths
from printer_slicer.motion.arcs import CHORDS_PER_TURN, LONGEST_CHORD, SHORTEST_CHORD
from printer_slicer.profile import Profile
from printer_slicer.values import Struct, replace

__all__ = ["PathLines", "fit_arcs", "fit_ranges", "merge_moves"]

_SAME_WIDTH = 0.002  # mm
_ROUNDS = 40

Fits = Callable[[Int, Int], Bool]
"""Tests whether ranges of moves, from `first` (T,) up to `stop` (T,), may be joined."""


class PathLines(Struct, frozen=True, eq=False):
    """Straight moves of all paths.

    Attributes:
        begin: (S,) index of the first point.
        end: (S,) index of the last point.
        xy: (S, 2) mm, position of the first point.
        way: (S, 2) mm, vector to the last point.
        apart: (S,) whether the move cannot be joined with the previous one.
    """

    begin: Int
    end: Int
    xy: Float
    way: Float
    apart: Bool

    @classmethod
    def from_paths(cls, paths: Toolpaths) -> PathLines:
        """Return the straight moves of paths, path by path; a loop ends with the move to its first point."""
        begin, end = paths.ends_of_beads
        owner = paths.path_of_bead
        way = paths.xy[end] - paths.xy[begin]
        even = np.abs(paths.width[end] - paths.width[begin]) < _SAME_WIDTH
        flat = (paths.z_offset[begin] == paths.z_offset[end]) & (
            paths.flow_ratio[begin] == paths.flow_ratio[end]
        )
        plain = even & flat
        apart = run_starts(owner)
        apart |= ~plain | ~np.append(False, plain[:-1])
        apart[1:] |= (paths.support_ratio[begin[1:]] != paths.support_ratio[begin[:-1]]) | (
            np.abs(paths.width[begin[1:]] - paths.width[begin[:-1]]) > _SAME_WIDTH
        )
        return cls(begin, end, paths.xy[begin], way, apart)


def fit_ranges(line: PathLines, fits: Fits) -> tuple[Int, Int]:
    """Join moves into ranges (T,), from `first` up to `stop`, until no two consecutive ranges fit together."""
    first = np.arange(len(line.begin))
    stop = first + 1
    idle = 0  # rounds in which nothing was joined
    for turn in range(_ROUNDS):
        first, stop, joined = _join_ranges(line, first, stop, fits, odd=turn % 2 == 1)
        idle = 0 if joined else idle + 1
        if idle == 2:
            break
    return first, stop


def _join_ranges(line: PathLines, first: Int, stop: Int, fits: Fits, *, odd: bool) -> tuple[Int, Int, bool]:
    """Join ranges (T,) with their successors where they fit together; also return whether any were joined.

    Every second range is tested, alternating between odd and even ones.
    """
    may = np.flatnonzero(np.append(~line.apart[first[1:]], False))
    run = np.cumsum(np.append(True, np.diff(may) > 1)) if len(may) else may
    begins = np.flatnonzero(np.append(True, np.diff(run) != 0)) if len(may) else may
    within = np.arange(len(may)) - begins[run - 1] if len(may) else may
    asked = may[within % 2 == int(odd)]
    if not len(asked):
        return first, stop, False
    good = asked[fits(first[asked], stop[asked + 1])]
    kept = np.ones(len(first), np.bool_)
    kept[good + 1] = False
    stop = stop.copy()
    stop[good] = stop[good + 1]
    return first[kept], stop[kept], len(good) > 0


_LEAST = 3  # moves in an arc
# Radius of an arc, mm. Firmware divides smaller arcs into chords so short that they fill its look-ahead queue.
_SMALLEST, _LARGEST = 2.5, 500.0
_WIDEST_TURN = np.radians(160)  # of an arc


def fit_arcs(paths: Toolpaths, profile: Profile) -> Toolpaths:
    """Replace moves by arcs where `quality.arc_tolerance` allows; moves with changing width stay lines."""
    tolerance = profile.quality.arc_tolerance
    if not tolerance or not paths.n_paths:
        return paths
    line = PathLines.from_paths(paths)

    def fits(first: Int, stop: Int) -> Bool:
        return _mark_ranges_on_circle(line, first, stop, tolerance)

    first, stop = fit_ranges(line, fits)
    arc = np.flatnonzero(stop - first >= _LEAST)
    return _insert_arcs(paths, line, first[arc], stop[arc]) if len(arc) else paths


def _mark_ranges_on_circle(line: PathLines, first: Int, stop: Int, tolerance: float) -> Bool:
    """Return a mask (T,) of ranges whose moves lie on a circle within the tolerance."""
    centre, radius = _fit_circles(line, first, stop)
    size = stop - first
    owner, lines = np.repeat(np.arange(len(first)), size), consecutive(first, size)
    begin, way = line.xy[lines], line.way[lines]
    out = begin - centre[owner]
    off = np.abs(np.hypot(*out.T) - radius[owner])
    length = np.hypot(*way.T)
    # Between the ends of a move, the circle lies farther out than the move.
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


def _fit_circles(line: PathLines, first: Int, stop: Int) -> tuple[Float, Float]:
    """Return the centre (T, 2) and radius (T,) of the best-fitting circle through both ends of each range."""
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


def _insert_arcs(paths: Toolpaths, line: PathLines, first: Int, stop: Int) -> Toolpaths:
    """Replace the points of ranges (A,) by the points of fitted arcs."""
    centre, radius = _fit_circles(line, first, stop)
    begin, last = line.xy[first], line.xy[stop - 1] + line.way[stop - 1]
    out, home = begin - centre, last - centre
    angle = np.arctan2(out[:, 1], out[:, 0])
    side = out[:, 0] * line.way[first, 1] - out[:, 1] * line.way[first, 0]
    sweep = np.mod(np.arctan2(home[:, 1], home[:, 0]) - angle, 2 * np.pi)
    sweep = np.where(side > 0, sweep, sweep - 2 * np.pi)
    chord = np.clip(radius * 2 * np.pi / CHORDS_PER_TURN, SHORTEST_CHORD, LONGEST_CHORD)
    pieces = np.maximum(np.ceil(radius * np.abs(sweep) / chord - 1e-9).astype(np.int64), 1)
    # A point at which an arc begins becomes the ends of its chords; every other point stays one point.
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


def merge_moves(paths: Toolpaths, chosen: Bool, tolerance: float) -> Toolpaths:
    """Merge moves of the chosen paths (M,) where the path changes by at most `tolerance` mm."""
    line = PathLines.from_paths(paths)
    owner = np.searchsorted(paths.start, line.begin, side="right") - 1
    arc = np.isfinite(paths.centre[line.begin, 0])
    # Chords of an arc, and moves after them, are not joined with the previous move.
    line = replace(line, apart=line.apart | ~chosen[owner] | arc | np.append(False, arc[:-1]))

    def fits(first: Int, stop: Int) -> Bool:
        return _mark_ranges_on_line(line, first, stop, tolerance)

    first, stop = fit_ranges(line, fits)
    kept = np.ones(len(paths.xy), np.bool_)
    kept[line.begin[consecutive(first + 1, stop - first - 1)]] = False
    return paths.of_points(
        np.flatnonzero(kept), np.append(0, np.cumsum(kept))[paths.start], np.arange(paths.n_paths)
    )


def _mark_ranges_on_line(line: PathLines, first: Int, stop: Int, tolerance: float) -> Bool:
    """Return a mask (T,) of ranges whose moves lie near the line from start to end of the range, and go forward."""
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
