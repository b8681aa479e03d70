"""Toolpaths -> Toolpaths: inner perimeters of several layers in one bead, where these do not change.

The outermost bead gives the surface and stays as thin as its layer; what lies behind it only has to fill. Sources:
Sabourin, Houser & Bohn, Accurate exterior, fast interior layered manufacturing, 1997; Ma & He, An adaptive slicing and
selective hatching strategy for layered manufacturing, 1999.

Where neighbouring layers agree: every perimeter is drawn with a narrow pen. What the drawings of several layers have in
common is a band as long as the perimeters agree, and the wider the nearer they are to each other; what is narrower than
two that lie as far apart as they may is left out.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from printer_slicer import bead
from printer_slicer.arrays import Bool, Float, Int, consecutive, frozen_array, run_starts, unique_inverse
from printer_slicer.combine_layers import area_savings, choose_groups, last_layers, tallest_groups
from printer_slicer.geometry import (
    Areas,
    Pieces,
    Polylines,
    difference,
    offset,
    offset_open,
    pieces_of,
    rings_around,
    stroked,
    window_intersection,
)
from printer_slicer.geometry.clipping import spans
from printer_slicer.model import LayerPlan, Regions, Sections, Toolpaths
from printer_slicer.profile import Profile
from printer_slicer.roles import Role

__all__ = [
    "SAME_PLACE",
    "Bands",
    "Spans",
    "bands_of",
    "common",
    "cut",
    "opened",
    "runs",
    "spans_between",
    "spans_within",
    "thickened",
]

_NOTHING = 1e-6  # mm


@dataclass(frozen=True, slots=True, eq=False)
class Spans:
    """Stretches of paths.

    Attributes:
        path: (S,) ascending.
        begin: (S,) mm along the path, ascending within a path.
        end: (S,) mm; beyond the length of a closed path where the stretch goes on from its first point.
    """

    path: Int
    begin: Float
    end: Float

    def __post_init__(self) -> None:
        n = len(self.path)
        for name, dtype in (("path", np.int64), ("begin", np.float64), ("end", np.float64)):
            object.__setattr__(self, name, frozen_array(getattr(self, name), dtype, (n,)))

    def take(self, chosen: Int) -> Spans:
        """Some of them, by their indices."""
        return Spans(self.path[chosen], self.begin[chosen], self.end[chosen])


def opened(paths: Toolpaths, rounds: int = 1) -> tuple[Int, Int]:
    """(K,) the points of the paths one after the other, and (M + 1,) where each begins; loops end where they began.

    Loops are gone around as often as `rounds` says.
    """
    size = np.diff(paths.start)
    count = np.where(paths.closed, rounds * size + 1, size)
    step = consecutive(np.zeros(paths.n_paths, np.int64), count)
    first = np.repeat(paths.start[:-1], count)
    return first + step % np.repeat(size, count), np.append(0, np.cumsum(count))


def runs(paths: Toolpaths) -> tuple[Float, Int, Int]:
    """What is fully carried of the paths: points (N, 2), where each run begins (R + 1,), its layer (R,)."""
    point, start = opened(paths)
    owner = np.repeat(np.arange(paths.n_paths), np.diff(start))
    laid = np.append(np.diff(owner) == 0, False)
    laid &= paths.support_ratio[point] >= 1
    first = np.flatnonzero(laid & ~np.append(False, laid[:-1]))
    last = np.flatnonzero(laid & ~np.append(laid[1:], False))
    size = last - first + 2
    chosen = point[consecutive(first, size)]
    return paths.xy.take(chosen, axis=0), np.append(0, np.cumsum(size)), paths.layer[owner[first]]


def spans_within(paths: Toolpaths, areas: Areas, shortest: float) -> Spans:
    """What of the paths lies in the areas of their layers, in stretches of at least `shortest` mm."""
    point, start = opened(paths)
    lines = Polylines.of(paths.xy.take(point, axis=0), np.diff(start), paths.layer)
    path, begin, end = spans(areas, lines)
    order = np.argsort(path, kind="stable")
    path, begin, end = path[order], begin[order], end[order]
    long = paths.length()
    new = run_starts(path)
    first = np.flatnonzero(new & paths.closed[path] & (begin <= _NOTHING))
    last = np.searchsorted(path, path[first], side="right") - 1
    goes_on = (end[last] >= long[path[last]] - _NOTHING) & (last > first)
    first, last = first[goes_on], last[goes_on]
    end[last] = long[path[last]] + end[first]
    kept = end - begin >= shortest
    kept[first] = False
    return Spans(path, begin, end).take(np.flatnonzero(kept))


def spans_between(paths: Toolpaths, inside: Spans) -> Spans:
    """What is left of the paths that have stretches cut out of them."""
    long = paths.length()
    path, low, high = inside.path, inside.begin, inside.end
    is_first = run_starts(path)
    is_last = np.append(np.diff(path) != 0, True)[: len(path)]
    first, last = np.flatnonzero(is_first), np.flatnonzero(is_last)
    around = paths.closed[path[first]]
    # From the end of each stretch to the beginning of the next one, of a loop's last one to that of the first.
    following = np.append(low[1:], 0.0)[: len(path)]
    following[last] = long[path[last]] + np.where(around, low[first], 0.0)
    before = first[~around]
    path = np.concatenate([path, path[before]])
    begin = np.concatenate([high, np.zeros(len(before))])
    end = np.concatenate([following, low[before]])
    order = np.lexsort((begin, path))
    order = order[(end - begin)[order] > _NOTHING]
    return Spans(path[order], begin[order], end[order])


def cut(paths: Toolpaths, stretches: Spans) -> Toolpaths:
    """Paths of their own of some stretches, with the widths and the shares carried that they have there.

    A stretch that is all of a loop stays closed.
    """
    if not len(stretches.path):
        return paths.take(np.zeros(0, np.int64))
    point, start = opened(paths, 2)
    xy = paths.xy.take(point, axis=0)
    step = np.hypot(*np.diff(xy, axis=0, append=xy[-1:]).T)
    step[start[1:] - 1] = 1.0  # from path to path, so that distances ascend
    reached = np.cumsum(step) - step
    once = np.diff(paths.start) - ~paths.closed
    long = reached[start[:-1] + once] - reached[start[:-1]]
    origin = reached[start[:-1]][stretches.path]
    whole = paths.closed[stretches.path] & (
        stretches.end - stretches.begin >= long[stretches.path] - _NOTHING
    )
    low, high = origin + stretches.begin, origin + stretches.end
    first = np.searchsorted(reached, low + _NOTHING)
    inner = np.maximum(np.searchsorted(reached, high - _NOTHING) - first, 0)
    size = inner + 2 - whole
    begins = np.cumsum(size) - size
    place = np.zeros(int(size.sum()))
    place[begins] = low
    place[consecutive(begins + 1, inner)] = reached[consecutive(first, inner)]
    place[(begins + size - 1)[~whole]] = high[~whole]
    segment = np.searchsorted(reached, place + _NOTHING, side="right") - 1
    layer, columns = paths.layer[stretches.path], (*xy.T, paths.width[point])
    x, y, width = (np.interp(place, reached, column) for column in columns)
    return Toolpaths.gathered(
        paths.plan,
        xy=np.column_stack([x, y]),
        size=size,
        layer=layer,
        role=paths.role[stretches.path],
        width=width,
        closed=whole,
        height=paths.height[stretches.path],
        support_ratio=paths.support_ratio[point[segment]],
    )


SAME_PLACE = 0.03  # mm: simplified outlines of one surface differ by up to 0.025; a tenth of a bead is 0.045
_PEN = SAME_PLACE  # mm, radius: two lines that far apart have a band of half its width in common
_SHORTEST = 20.0  # mm of perimeter: cutting out less costs more for starts and travels than it saves


@dataclass(frozen=True, slots=True, eq=False)
class Bands:
    """Bands along perimeters, about 0.06 mm wide.

    Attributes:
        standing: for each layer what stands in the same place on the layer below.
        seen: for each layer what does not lie under the next one.
    """

    standing: Areas
    seen: Areas

    def shared(self, first: Int, last: Int) -> Areas:
        """For each layer k what stands in one place from `first[k]` up to `last[k]`; nothing where equal."""
        several = last > first
        own = np.arange(len(first))
        window = window_intersection(
            self.standing, np.where(several, first + 1, own), np.where(several, last + 1, own + 1)
        )
        hidden = self.seen.for_each(last)
        return difference(window.of_layers(several), hidden.of_layers(several))

    def savings(self, lowest: Int) -> Float:
        """(n, L) mm of perimeters saved by laying `extra` (row) layers and the one after them (column) as one.

        `lowest` (L,) is where the highest groups that end with each layer begin.
        """
        own = np.arange(len(lowest))
        saved = np.zeros((int((own - lowest).max(initial=0)) + 1, len(own)))
        for extra in range(1, len(saved)):
            fits = own - extra >= lowest
            saved[extra] = extra * self.shared(np.where(fits, own - extra, own), own).area() / (2 * _PEN)
        return saved


def bands_of(inner: Toolpaths, sections: Sections, regions: Regions, width: float) -> Bands:
    """The bands of inner perimeters; what hangs over air anywhere has none.

    Bridges, over air or over sparse infill, need the perimeters on which they end on the layer below: what is next to
    one does not stand on what is under it.

    Args:
        inner: the perimeters.
        sections: of the part.
        regions: what is inside the perimeters.
        width: mm, of a bead.
    """
    n, own = inner.plan.n_layers, np.arange(inner.plan.n_layers)
    xy, start, layer = runs(inner)
    drawn = stroked(xy, start, layer, np.full(len(layer), _PEN), n)
    both = window_intersection(drawn, own - 1, own + 1)
    bridges = offset(regions.bridge.merge(regions.internal_bridge), width)
    above = window_intersection(sections.solid, own + 1, own + 2)
    return Bands(_wide(difference(both, bridges)), difference(drawn, offset(above, -width / 2)))


def common(bands: Bands, groups: Int) -> Pieces:
    """What of the perimeters of each group of layers is worth to be laid together, grown around the perimeters.

    Each piece, on the last layer of its group, holds a stretch of perimeter on every layer of the group.
    """
    own = np.arange(len(groups))
    shared = _wide(bands.shared(np.where(last_layers(groups) == own, groups, own), own))
    pieces = pieces_of(shared)
    rings = np.bincount(pieces.areas.ring_layer, minlength=pieces.count)
    worth = (rings > 1) | (pieces.areas.area() >= 2 * _PEN * _SHORTEST)
    kept = pieces.on_layers(shared.n_layers, np.flatnonzero(worth))
    return pieces_of(offset(kept, 1.5 * _PEN))


def _wide(bands: Areas) -> Areas:
    return offset_open(bands, (2 * _PEN - SAME_PLACE) / 2)


_SLIVER = 0.5  # mm; less of a path beside another one's stretch is not cut out of it
_EQUAL = 0.05  # by how much the layers of a stretch may differ in length


def thickened(
    paths: Toolpaths, sections: Sections, regions: Regions, profile: Profile
) -> tuple[Toolpaths, Int | None]:
    """The perimeters, with the inner ones of several layers as one bead where these are in the same place.

    Layers are printed together in groups up to `quality.perimeters_every` high, the same groups as for sparse
    infill. What of the inner perimeters is in one place on all layers of a group is laid on the last of them, with as
    much plastic; the rest on its own layer. So are the first layer, what hangs over air, what nothing lies on, and
    what bridges end on in the midst of a group.

    Args:
        paths: the perimeters, with what is carried of them.
        sections: of the part.
        regions: what is inside the perimeters.
        profile: how high beads may be.

    Returns:
        The paths, and (L,) the first layer of the group of each layer; None where nothing is printed together.
    """
    plan, limit = paths.plan, min(profile.quality.perimeters_every, profile.highest_bead)
    lowest = tallest_groups(plan, limit)
    inner = paths.role == Role.PERIMETER
    if (lowest == np.arange(plan.n_layers)).all() or not inner.any():
        return paths, None
    bands = bands_of(paths.take(np.flatnonzero(inner)), sections, regions, profile.extrusion_width)
    groups = _groups(bands, plan, lowest, regions.sparse, profile)
    inner &= np.bincount(groups, minlength=plan.n_layers)[groups[paths.layer]] > 1
    some = paths.take(np.flatnonzero(inner))
    stretches, piece = _stretches(some, common(bands, groups), groups)
    touched = np.isin(np.arange(some.n_paths), stretches.path)
    parts = [
        paths.take(np.flatnonzero(~inner)),
        some.take(np.flatnonzero(~touched)),
        cut(some, spans_between(some, stretches)),
        _as_one(cut(some, stretches), piece, groups),
    ]
    return Toolpaths.joined(plan, parts), groups


def _groups(bands: Bands, plan: LayerPlan, lowest: Int, sparse: Areas, profile: Profile) -> Int:
    """(L,) the first layer of each one's group: what saves most of perimeters and sparse infill together, mm."""
    quality = profile.quality
    of_infill = area_savings(
        sparse, tallest_groups(plan, min(quality.internal_infill_every, profile.highest_bead))
    )
    of_infill *= quality.infill_density / profile.extrusion_width
    saved = bands.savings(lowest)
    several = np.zeros((max(len(saved), len(of_infill)), plan.n_layers))
    several[: len(saved)] += saved
    several[: len(of_infill)] += of_infill
    return choose_groups(several)


def _stretches(some: Toolpaths, pieces: Pieces, groups: Int) -> tuple[Spans, Int]:
    """What of the paths, all in groups of layers, is laid together; and (S,) the piece that each stretch lies in."""
    last = last_layers(groups)
    area = pieces.on_layers(len(groups), np.arange(pieces.count))
    spans = spans_within(some, area.for_each(last), _SLIVER)
    made = cut(some, spans)
    size = np.diff(made.start)
    middle = made.xy[made.start[:-1] + size // 2 - 1] + made.xy[made.start[:-1] + size // 2]
    ring = rings_around(area, middle / 2, last[made.layer])
    piece = np.append(pieces.areas.ring_layer, -1)[ring]
    good = np.flatnonzero(np.append(_alike(made, piece, pieces.count, groups), False)[piece])
    return spans.take(good), piece[good]


def _alike(made: Toolpaths, piece: Int, count: int, groups: Int) -> Bool:
    """(count,) which pieces hold a stretch as long and as wide on every layer of their group, and wide enough.

    Args:
        made: stretches.
        piece: (M,) of each of them; -1 for none.
        count: how many pieces there are.
        groups: (L,) the first layer of the group of each layer.
    """
    plan, known = made.plan, np.flatnonzero(piece >= 0)
    if not len(known):
        return np.zeros(count, np.bool_)
    made, piece = made.take(known), piece[known]
    spacing = bead.spacing(made.width, np.repeat(made.height, np.diff(made.start)))
    long = made.length()
    least, most = np.full((4, count), np.inf), np.full((4, count), -np.inf)
    low, high = (ends.reduceat(spacing, made.start[:-1]) for ends in (np.minimum, np.maximum))
    for row, values in enumerate((made.area() / long, low, high)):
        np.minimum.at(least[row], piece, values)
        np.maximum.at(most[row], piece, values)
    # Layers of one group follow each other.
    where, number = unique_inverse(piece * plan.n_layers + made.layer)
    on_layer, owner = np.bincount(number, long), where // plan.n_layers
    np.minimum.at(least[3], owner, on_layer)
    np.maximum.at(most[3], owner, on_layer)
    first = np.zeros(count, np.int64)
    first[piece] = groups[made.layer]
    last = last_layers(groups)[first]
    everywhere = np.bincount(owner, minlength=count) == last - first + 1
    thick = plan.top[last] - plan.bottom[first]
    even = (most[:3] - least[:3] <= SAME_PLACE).all(axis=0)
    even &= most[3] - least[3] <= _EQUAL * most[3] + _SLIVER
    return np.asarray(everywhere & even & (bead.width_for_spacing(least[1], thick) >= thick))


def _as_one(made: Toolpaths, piece: Int, groups: Int) -> Toolpaths:
    """Of the stretches in each piece (M,) those on the last layer, with the plastic of all."""
    plan = made.plan
    laid = np.bincount(piece, made.area() * made.height)
    kept = np.flatnonzero(made.layer == last_layers(groups)[made.layer])
    made, piece = made.take(kept), piece[kept]
    size = np.diff(made.start)
    height = np.round(plan.top[made.layer] - plan.bottom[groups[made.layer]], 7)
    more = laid / np.maximum(np.bincount(piece, made.area() * height, minlength=len(laid)), 1e-12)
    own, high = np.repeat(made.height, size), np.repeat(height, size)
    width = bead.width_for_spacing(bead.spacing(made.width, own) * np.repeat(more[piece], size), high)
    return replace(made, height=height, width=np.maximum(np.round(width, 4), high))
