"""Find which stretches of the beads of supports are unsupported, and remove them."""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, run_starts
from printer_slicer.model import LayerPlan, Sections, Toolpaths
from printer_slicer.profile import Quality
from printer_slicer.roles import Role
from printer_slicer.supports.bead_samples import (
    BeadMap,
    BeadSamples,
    PartBelow,
    find_carried,
    find_gapless_layers,
)
from printer_slicer.values import Struct, replace

__all__ = ["SpanRules", "find_carried_beads", "find_unsupported_beads", "keep_samples", "remove_unsupported"]

_MAX_SPAN: Final = 2.2  # row spacings, the longest straight stretch that hangs between two carried ones
_MAX_LOOP_SPAN: Final = 1.8  # the same for loops, which are not straight
_MAX_END: Final = 0.6  # the same for the end of a line
_MAX_TURN_SPAN: Final = 1.0  # the same for a stretch of a line that turns
_KEPT_END: Final = 0.3  # of longer ends and turns, the length at each carried side that remains
_MIN_STRAIGHTNESS: Final = (
    0.95  # of the length of a stretch, the least distance between its ends if it is straight
)
_MIN_OF_LOOP: Final = 1 / 3  # of its length that must be carried
_MIN_OF_LINE: Final = 0.12  # the same for lines, which may run across lines or joists below
_MIN_CARRIED: Final = 0.3  # mm of short lines that must be carried
_LARGE_LOOP: Final = 6.0  # mm, length of loops that may lie across the lines of the first layer
_MIN_LENGTH: Final = 1.0  # widths; shorter rests are taken out


class SpanRules(Struct, frozen=True, eq=False):
    """Largest lengths of unsupported beads.

    Attributes:
        part: the part below support layers.
        span: length of a straight stretch of a line whose both ends are carried, mm.
        turn_span: the same for a stretch that turns.
        loop_span: the same for a loop.
        end: length of a stretch at the end of a line, mm.
        rest: length of a longer stretch that is kept beside its supported end, mm.
    """

    part: PartBelow
    span: float
    turn_span: float
    loop_span: float
    end: float
    rest: float

    @classmethod
    def of(cls, sections: Sections, layers: LayerPlan, quality: Quality) -> SpanRules:
        """Return the rules for supports with these layers and settings beside a part."""
        part = PartBelow.of(sections, layers, quality.support_bottom_gap)
        spacing = quality.support_spacing
        span = max(_MAX_SPAN * spacing, quality.support_tip_distance)
        loop_span = min(_MAX_LOOP_SPAN * spacing, span)
        return cls(part, span, _MAX_TURN_SPAN * spacing, loop_span, _MAX_END * spacing, _KEPT_END * spacing)

    def for_columns(self) -> SpanRules:
        """Return the rules by which beads get columns; shorter ends and turns are only cut."""
        return replace(self, end=self.end / _MAX_END, turn_span=self.span, rest=0.0)

    def find_unsupported(self, samples: BeadSamples, paths: Toolpaths, some: slice, carried: Bool) -> Bool:
        """Return which (k,) of some samples belong to unsupported stretches that are too long.

        Args:
            samples: of the beads.
            paths: the beads.
            some: the k samples of some paths.
            carried: (k,) which of them are carried.
        """
        path, length = samples.path[some], samples.length[some]
        if carried.all():
            return np.zeros(len(path), np.bool_)
        begins = run_starts(path)
        ends = np.append(begins[1:], True)
        first = np.flatnonzero(~carried & (begins | np.append(True, carried[:-1])))
        last = np.flatnonzero(~carried & (ends | np.append(carried[1:], True)))
        total = np.append(0.0, np.cumsum(length))
        size, of_run = total[last + 1] - total[first], path[first]
        closed = paths.closed[of_run]
        _join_over_seams(size, of_run, closed & begins[first], closed & ends[last])
        at_end = (begins[first] | ends[last]) & ~closed
        chord = samples.measure_distances(some.start + first, some.start + last) + length[first]
        inside = np.where(chord < _MIN_STRAIGHTNESS * size, self.turn_span, self.span)
        most = np.where(at_end, self.end, np.where(closed, self.loop_span, inside))
        low = total[first] + np.where(begins[first] & ~closed, 0.0, self.rest)
        high = total[last + 1] - np.where(ends[last] & ~closed, 0.0, self.rest)
        longer = np.flatnonzero(size > most)
        middle = (total[:-1] + total[1:]) / 2
        change = np.zeros(len(path) + 1, np.int64)
        np.add.at(change, np.searchsorted(middle, low[longer]), 1)
        np.add.at(change, np.searchsorted(middle, np.maximum(high, low)[longer]), -1)
        return np.asarray((np.cumsum(change[:-1]) > 0) | _mark_barely_carried(paths, path, length, carried))


def _join_over_seams(size: Float, path: Int, at_begin: Bool, at_end: Bool) -> None:
    """Change the sizes (r,) of stretches that go on over the seam of their loop to the sum of both."""
    head, tail = np.flatnonzero(at_begin & ~at_end), np.flatnonzero(at_end & ~at_begin)
    common, head_place, tail_place = np.intersect1d(path[head], path[tail], return_indices=True)
    if len(common):
        head, tail = head[head_place], tail[tail_place]
        size[head] = size[tail] = size[head] + size[tail]


def _mark_barely_carried(paths: Toolpaths, path: Int, length: Float, carried: Bool) -> Bool:
    """Return which samples (k,) belong to a path of which too little is carried."""
    low = int(path[0])
    whole, part = (np.bincount(path - low, weight) for weight in (length, length * carried))
    numbers = np.arange(low, low + len(whole))
    # Large loops of the second layer may lie across the lines of the first one.
    across = (paths.layer[numbers] <= 1) & (whole > _LARGE_LOOP)
    is_loop = paths.closed[numbers] & (paths.role[numbers] == Role.SUPPORT) & ~across
    least = np.maximum(_MIN_OF_LINE * whole, np.minimum(_MIN_CARRIED, whole / 2))
    little = part < np.where(is_loop, _MIN_OF_LOOP * whole, least)
    return np.asarray(little[path - low])


def find_unsupported_beads(samples: BeadSamples, paths: Toolpaths, rules: SpanRules) -> Bool:
    """Return which samples (n,) belong to unsupported stretches that are too long if all beads below are there.

    If none hangs, all beads stand, because those of the lowest layer do.
    """
    carried = find_carried_beads(samples, paths, rules)
    return rules.find_unsupported(samples, paths, slice(0, samples.count), carried)


def find_carried_beads(
    samples: BeadSamples, paths: Toolpaths, rules: SpanRules, suspect: Bool | None = None
) -> Bool:
    """Return which samples (n,) lie on beads below, on the bed, or, if nothing else is below, on the part.

    With a mask (S,), those in other layers count as carried.
    """
    carried = find_carried(samples, paths)
    if suspect is not None:
        carried |= ~suspect[paths.layer[samples.path]]
    # Few beads lie on the part, so only those are compared with it that hang otherwise.
    suspect = np.zeros(paths.n_paths, np.bool_)
    suspect[samples.path[rules.find_unsupported(samples, paths, slice(0, samples.count), carried)]] = True
    left = np.flatnonzero(suspect[samples.path] & ~carried)
    if len(left):
        carried[left] = rules.part.carries(samples, left, paths.layer[samples.path[left]])
    return carried


def remove_unsupported(samples: BeadSamples, paths: Toolpaths, hanging: Bool, rules: SpanRules) -> Bool:
    """Return the samples (n,) that remain when unsupported ones are removed, from the bed upwards.

    Args:
        samples: of all beads, in all layers.
        paths: the beads.
        hanging: (n,) result of `find_unsupported_beads`.
        rules: largest lengths of unsupported beads.
    """
    kept, covered = np.ones(samples.count, np.bool_), BeadMap(samples)
    start, gapless = samples.layer_start, find_gapless_layers(paths.plan)
    has_hanging = np.add.reduceat(np.append(hanging, False), np.minimum(start[:-1], samples.count)) > 0
    has_hanging &= np.diff(start) > 0
    is_less = False  # whether something was taken out in the layer below
    for layer in range(1, paths.plan.n_layers):
        some, below = slice(start[layer], start[layer + 1]), np.arange(start[layer - 1], start[layer])
        if not (has_hanging[layer] or (is_less and some.stop > some.start)):
            is_less = False
            continue
        covered.mark(below[kept[below]])
        count = some.stop - some.start
        carried = covered.carries(some) if gapless[layer] else np.zeros(count, np.bool_)
        left = np.flatnonzero(~carried)
        carried[left] = rules.part.carries(samples, left + some.start, np.full(len(left), layer))
        stays = ~rules.find_unsupported(samples, paths, some, carried)
        kept[some] = stays & ~_mark_short_rests(samples, paths, some, stays)
        is_less = not kept[some].all()
    return kept


def _mark_short_rests(samples: BeadSamples, paths: Toolpaths, some: slice, kept: Bool) -> Bool:
    """Return which (k,) of some samples belong to rests of paths that are too short to print."""
    path, length = samples.path[some], samples.length[some]
    begins = kept & (np.append(True, np.diff(path) != 0) | np.append(True, ~kept[:-1]))
    run = np.cumsum(begins) - 1
    size = np.bincount(run[kept], length[kept], minlength=max(int(begins.sum()), 1))
    whole = np.ones(paths.n_paths, np.bool_)
    whole[path[~kept]] = False
    width = paths.width[paths.start[path]]
    return np.asarray(kept & ~whole[path] & (size[np.maximum(run, 0)] < _MIN_LENGTH * width))


def keep_samples(samples: BeadSamples, paths: Toolpaths, kept: Bool) -> Toolpaths:
    """Return the paths without the stretches whose samples (n,) are not kept; loops that are cut become lines."""
    cut = np.zeros(paths.n_paths, np.bool_)
    cut[samples.path[~kept]] = True
    whole = paths.take(np.flatnonzero(~cut))
    which = _start_loops_after_gaps(samples, paths, np.flatnonzero(kept & cut[samples.path]))
    if not len(which):
        return whole
    xy, size = _draw_stretches(samples, paths, which)
    of_run = samples.path[which[_find_run_starts(samples, which)]]
    pieces = Toolpaths.gathered(
        paths.plan,
        xy=xy,
        size=size,
        layer=paths.layer[of_run],
        role=paths.role[of_run],
        width=paths.width[paths.start[of_run]],
        closed=False,
        height=paths.height[of_run],
    )
    return Toolpaths.joined(paths.plan, [whole, pieces])


def _start_loops_after_gaps(samples: BeadSamples, paths: Toolpaths, which: Int) -> Int:
    """Return samples (k,) in another order, in which no stretch of a loop ends at its seam and goes on behind it."""
    first = np.searchsorted(samples.path, np.arange(paths.n_paths + 1))
    result = []
    for part in np.split(which, np.flatnonzero(np.diff(samples.path[which])) + 1):
        path = int(samples.path[part[0]]) if len(part) else 0
        gaps = np.flatnonzero(np.diff(part) > 1)
        wraps = len(part) and part[0] == first[path] and part[-1] == first[path + 1] - 1
        turn = int(gaps[-1]) + 1 if paths.closed[path] and wraps and len(gaps) else 0
        result.append(np.roll(part, -turn))
    return np.concatenate(result)


def _find_run_starts(samples: BeadSamples, which: Int) -> Bool:
    """Return which (k,) of the samples begin a stretch."""
    path = samples.path[which]
    follows = np.diff(which) == 1
    # The first sample of a loop follows the last one.
    seam = (np.diff(which) < 0) & (np.diff(path) == 0)
    return np.append(True, (np.diff(path) != 0) | ~(follows | seam))


def _draw_stretches(samples: BeadSamples, paths: Toolpaths, which: Int) -> tuple[Float, Int]:
    """Return the points (n, 2) of stretches of samples (k,), one after the other, and their number in each stretch."""
    begins, bead = _find_run_starts(samples, which), samples.bead[which]
    ends = np.append(begins[1:], True)
    begin, end = (paths.xy[of] for of in paths.ends_of_beads)
    way = end - begin
    way /= np.maximum(np.hypot(*way.T), 1e-9)[:, None]
    half, middle = way[bead] * samples.length[which, None] / 2, samples.points(which)
    turns = ~begins & np.append(False, np.diff(bead) != 0)
    before = np.where(turns[:, None], begin[bead], middle - half)
    # A bead that ends in a stretch has a corner there, and each stretch has two ends.
    rows = np.concatenate([before[begins | turns], (middle + half)[ends]])
    place = np.concatenate([2 * np.flatnonzero(begins | turns), 2 * np.flatnonzero(ends) + 1])
    size = np.bincount(np.cumsum(begins) - 1, begins | turns).astype(np.int64) + 1
    return rows[np.argsort(place, kind="stable")], size
