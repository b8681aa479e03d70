"""Combine perimeters of several layers into one thick extrusion where they are in the same place on all layers.

External perimeters make the surface and keep the height of their layer; the perimeters behind them only fill. Sources:
Sabourin, Houser & Bohn, Accurate exterior, fast interior layered manufacturing, 1997; Ma & He, An adaptive slicing and
selective hatching strategy for layered manufacturing, 1999.

To find where layers agree, each perimeter becomes a narrow band. The intersection of the bands of several layers shows
where the perimeters agree; it is wider the closer they are. Intersections are dropped where perimeters are too far
apart.
"""

from __future__ import annotations

import numpy as np

from printer_slicer import bead
from printer_slicer.arrays import Bool, Float, Int, consecutive, frozen_array, run_starts, unique_inverse
from printer_slicer.combine_layers import (
    choose_groups,
    compute_area_savings,
    find_last_layers,
    find_tallest_groups,
)
from printer_slicer.geometry import (
    Areas,
    ConnectedAreas,
    Polylines,
    difference,
    find_enclosing_rings,
    offset,
    offset_open,
    split_connected,
    stroke_lines,
    window_intersection,
)
from printer_slicer.geometry.clipping import clip_to_spans
from printer_slicer.model import LayerPlan, Regions, Sections, Toolpaths
from printer_slicer.profile import Profile
from printer_slicer.roles import Role
from printer_slicer.values import Struct, force_setattr, replace

__all__ = [
    "SAME_PLACE",
    "PathSpans",
    "PerimeterBands",
    "combine_perimeters",
    "cut_paths",
    "find_bands",
    "find_shared_pieces",
    "find_spans_between",
    "find_spans_within",
    "find_supported_runs",
    "unroll_paths",
]

_NOTHING = 1e-6  # mm


class PathSpans(Struct, frozen=True, eq=False):
    """Spans of paths, from one position along a path to another.

    Attributes:
        path: (S,) ascending.
        begin: (S,) mm along the path, ascending within a path.
        end: (S,) mm; greater than the length of a closed path if the span passes its first point.
    """

    path: Int
    begin: Float
    end: Float

    def __post_init__(self) -> None:
        n = len(self.path)
        for name, dtype in (("path", np.int64), ("begin", np.float64), ("end", np.float64)):
            force_setattr(self, name, frozen_array(getattr(self, name), dtype, (n,)))

    def take(self, chosen: Int) -> PathSpans:
        """Return the spans with the given indices."""
        return PathSpans(self.path[chosen], self.begin[chosen], self.end[chosen])


def unroll_paths(paths: Toolpaths, rounds: int = 1) -> tuple[Int, Int]:
    """Return the point indices (K,) of paths as open lines, and the offset (M + 1,) of each line.

    Loops end at their first point and are repeated `rounds` times.
    """
    size = np.diff(paths.start)
    count = np.where(paths.closed, rounds * size + 1, size)
    step = consecutive(np.zeros(paths.n_paths, np.int64), count)
    first = np.repeat(paths.start[:-1], count)
    return first + step % np.repeat(size, count), np.append(0, np.cumsum(count))


def find_supported_runs(paths: Toolpaths) -> tuple[Float, Int, Int]:
    """Find the fully supported runs of paths; return points (N, 2), offset (R + 1,) and layer (R,) of each run."""
    point, start = unroll_paths(paths)
    owner = np.repeat(np.arange(paths.n_paths), np.diff(start))
    laid = np.append(np.diff(owner) == 0, False)
    laid &= paths.support_ratio[point] >= 1
    first = np.flatnonzero(laid & ~np.append(False, laid[:-1]))
    last = np.flatnonzero(laid & ~np.append(laid[1:], False))
    size = last - first + 2
    chosen = point[consecutive(first, size)]
    return paths.xy.take(chosen, axis=0), np.append(0, np.cumsum(size)), paths.layer[owner[first]]


def find_spans_within(paths: Toolpaths, areas: Areas, shortest: float) -> PathSpans:
    """Find the spans of paths inside the areas of their layers that are at least `shortest` mm long."""
    point, start = unroll_paths(paths)
    lines = Polylines.of(paths.xy.take(point, axis=0), np.diff(start), paths.layer)
    path, begin, end = clip_to_spans(areas, lines)
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
    return PathSpans(path, begin, end).take(np.flatnonzero(kept))


def find_spans_between(paths: Toolpaths, inside: PathSpans) -> PathSpans:
    """Find the remaining spans between the spans `inside`, on paths that have a span inside."""
    long = paths.length()
    path, low, high = inside.path, inside.begin, inside.end
    is_first = run_starts(path)
    is_last = np.append(np.diff(path) != 0, True)[: len(path)]
    first, last = np.flatnonzero(is_first), np.flatnonzero(is_last)
    around = paths.closed[path[first]]
    # Each remaining span leads from the end of one span to the begin of the next; on loops, from the last to the first.
    following = np.append(low[1:], 0.0)[: len(path)]
    following[last] = long[path[last]] + np.where(around, low[first], 0.0)
    before = first[~around]
    path = np.concatenate([path, path[before]])
    begin = np.concatenate([high, np.zeros(len(before))])
    end = np.concatenate([following, low[before]])
    order = np.lexsort((begin, path))
    order = order[(end - begin)[order] > _NOTHING]
    return PathSpans(path[order], begin[order], end[order])


def cut_paths(paths: Toolpaths, chosen_spans: PathSpans) -> Toolpaths:
    """Cut spans out of paths, with their widths and support ratios; a span of a whole loop stays closed."""
    if not len(chosen_spans.path):
        return paths.take(np.zeros(0, np.int64))
    point, start = unroll_paths(paths, 2)
    xy = paths.xy.take(point, axis=0)
    step = np.hypot(*np.diff(xy, axis=0, append=xy[-1:]).T)
    step[start[1:] - 1] = 1.0  # between paths, so that distances ascend
    reached = np.cumsum(step) - step
    once = np.diff(paths.start) - ~paths.closed
    long = reached[start[:-1] + once] - reached[start[:-1]]
    origin = reached[start[:-1]][chosen_spans.path]
    whole = paths.closed[chosen_spans.path] & (
        chosen_spans.end - chosen_spans.begin >= long[chosen_spans.path] - _NOTHING
    )
    low, high = origin + chosen_spans.begin, origin + chosen_spans.end
    first = np.searchsorted(reached, low + _NOTHING)
    inner = np.maximum(np.searchsorted(reached, high - _NOTHING) - first, 0)
    size = inner + 2 - whole
    begins = np.cumsum(size) - size
    place = np.zeros(int(size.sum()))
    place[begins] = low
    place[consecutive(begins + 1, inner)] = reached[consecutive(first, inner)]
    place[(begins + size - 1)[~whole]] = high[~whole]
    segment = np.searchsorted(reached, place + _NOTHING, side="right") - 1
    layer, columns = paths.layer[chosen_spans.path], (*xy.T, paths.width[point])
    x, y, width = (np.interp(place, reached, column) for column in columns)
    return Toolpaths.gathered(
        paths.plan,
        xy=np.column_stack([x, y]),
        size=size,
        layer=layer,
        role=paths.role[chosen_spans.path],
        width=width,
        closed=whole,
        height=paths.height[chosen_spans.path],
        support_ratio=paths.support_ratio[point[segment]],
    )


SAME_PLACE = 0.03  # mm; simplified outlines of one surface differ by up to 0.025, a tenth of a width is 0.045
_PEN = SAME_PLACE  # mm, half the width of a band; the bands of lines this far apart overlap by half
_SHORTEST = 20.0  # mm of perimeter; shorter spans cost more in starts and travels than they save


class PerimeterBands(Struct, frozen=True, eq=False):
    """Bands along perimeters, about 0.06 mm wide.

    Attributes:
        same_as_below: for each layer, the bands in the same place as on the layer below.
        uncovered: for each layer, the bands that the next layer does not cover.
    """

    same_as_below: Areas
    uncovered: Areas

    def find_shared(self, first: Int, last: Int) -> Areas:
        """Return for each k the bands shared by layers `first[k]` to `last[k]`; nothing for a single layer."""
        several = last > first
        own = np.arange(len(first))
        window = window_intersection(
            self.same_as_below, np.where(several, first + 1, own), np.where(several, last + 1, own + 1)
        )
        hidden = self.uncovered.copy_layers(last)
        return difference(window.of_layers(several), hidden.of_layers(several))

    def compute_savings(self, lowest: Int) -> Float:
        """Return the length (n, L), mm, saved by combining each layer (column) with the n layers (row n) below it.

        `lowest` (L,) is the first layer of the highest group that ends with each layer.
        """
        own = np.arange(len(lowest))
        saved = np.zeros((int((own - lowest).max(initial=0)) + 1, len(own)))
        for extra in range(1, len(saved)):
            fits = own - extra >= lowest
            saved[extra] = extra * self.find_shared(np.where(fits, own - extra, own), own).area() / (2 * _PEN)
        return saved


def find_bands(inner: Toolpaths, sections: Sections, regions: Regions, width: float) -> PerimeterBands:
    """Find the bands along perimeters; unsupported perimeters have no bands.

    Bridges and internal bridges need the perimeters on which they end, so perimeters next to a bridge are not combined
    with those below.

    Args:
        inner: the perimeters, without external ones.
        sections: of the part.
        regions: the area inside the perimeters.
        width: mm, extrusion width.
    """
    n, own = inner.plan.n_layers, np.arange(inner.plan.n_layers)
    xy, start, layer = find_supported_runs(inner)
    drawn = stroke_lines(xy, start, layer, np.full(len(layer), _PEN), n)
    both = window_intersection(drawn, own - 1, own + 1)
    bridges = offset(regions.bridge.merge(regions.internal_bridge), width)
    above = window_intersection(sections.solid, own + 1, own + 2)
    return PerimeterBands(
        _drop_narrow_bands(difference(both, bridges)), difference(drawn, offset(above, -width / 2))
    )


def find_shared_pieces(bands: PerimeterBands, groups: Int) -> ConnectedAreas:
    """Find the pieces of perimeters in each group that are worth combining, grown around the perimeters.

    Each piece is on the last layer of its group and contains a span of perimeter on every layer of the group.
    """
    own = np.arange(len(groups))
    shared = _drop_narrow_bands(
        bands.find_shared(np.where(find_last_layers(groups) == own, groups, own), own)
    )
    pieces = split_connected(shared)
    rings = np.bincount(pieces.areas.ring_layer, minlength=pieces.count)
    worth = (rings > 1) | (pieces.areas.area() >= 2 * _PEN * _SHORTEST)
    kept = pieces.on_layers(shared.n_layers, np.flatnonzero(worth))
    return split_connected(offset(kept, 1.5 * _PEN))


def _drop_narrow_bands(bands: Areas) -> Areas:
    """Drop the narrow bands that remain where perimeters are too far apart to be combined."""
    return offset_open(bands, (2 * _PEN - SAME_PLACE) / 2)


_SLIVER = 0.5  # mm; shorter spans are not cut out
_EQUAL = 0.05  # largest relative difference in length between the layers of a span


def combine_perimeters(
    paths: Toolpaths, sections: Sections, regions: Regions, profile: Profile
) -> tuple[Toolpaths, Int | None]:
    """Combine perimeters of several layers into one extrusion where they are in the same place.

    Layers are combined in groups up to `quality.perimeters_every` high, the same groups as for internal infill.
    Perimeters in one place on all layers of a group are printed on its last layer, with the same volume. All others are
    printed on their own layers: external perimeters, the first layer, unsupported and uncovered perimeters, and
    perimeters on which bridges end within a group.

    Args:
        paths: the perimeters, with their supports.
        sections: of the part.
        regions: the area inside the perimeters.
        profile: limits of the height.

    Returns:
        The paths, and the first layer (L,) of the group of each layer; None if nothing is combined.
    """
    plan, limit = paths.plan, min(profile.quality.perimeters_every, profile.highest_bead)
    lowest = find_tallest_groups(plan, limit)
    inner = paths.role == Role.PERIMETER
    if (lowest == np.arange(plan.n_layers)).all() or not inner.any():
        return paths, None
    bands = find_bands(paths.take(np.flatnonzero(inner)), sections, regions, profile.extrusion_width)
    groups = _choose_perimeter_groups(bands, plan, lowest, regions.internal_infill, profile)
    inner &= np.bincount(groups, minlength=plan.n_layers)[groups[paths.layer]] > 1
    some = paths.take(np.flatnonzero(inner))
    chosen_spans, piece = _find_combinable_spans(some, find_shared_pieces(bands, groups), groups)
    touched = np.isin(np.arange(some.n_paths), chosen_spans.path)
    parts = [
        paths.take(np.flatnonzero(~inner)),
        some.take(np.flatnonzero(~touched)),
        cut_paths(some, find_spans_between(some, chosen_spans)),
        _merge_spans(cut_paths(some, chosen_spans), piece, groups),
    ]
    return Toolpaths.joined(plan, parts), groups


def _choose_perimeter_groups(
    bands: PerimeterBands, plan: LayerPlan, lowest: Int, infill: Areas, profile: Profile
) -> Int:
    """Return the first layer (L,) of each layer's group, for the groups that save the most extrusion."""
    quality = profile.quality
    of_infill = compute_area_savings(
        infill, find_tallest_groups(plan, min(quality.internal_infill_every, profile.highest_bead))
    )
    of_infill *= quality.infill_density / profile.extrusion_width
    saved = bands.compute_savings(lowest)
    several = np.zeros((max(len(saved), len(of_infill)), plan.n_layers))
    several[: len(saved)] += saved
    several[: len(of_infill)] += of_infill
    return choose_groups(several)


def _find_combinable_spans(paths: Toolpaths, pieces: ConnectedAreas, groups: Int) -> tuple[PathSpans, Int]:
    """Return the spans of paths to combine, and the piece (S,) that contains each span."""
    last = find_last_layers(groups)
    area = pieces.on_layers(len(groups), np.arange(pieces.count))
    spans = find_spans_within(paths, area.copy_layers(last), _SLIVER)
    made = cut_paths(paths, spans)
    size = np.diff(made.start)
    middle = made.xy[made.start[:-1] + size // 2 - 1] + made.xy[made.start[:-1] + size // 2]
    ring = find_enclosing_rings(area, middle / 2, last[made.layer])
    piece = np.append(pieces.areas.ring_layer, -1)[ring]
    good = np.flatnonzero(np.append(_mark_uniform_pieces(made, piece, pieces.count, groups), False)[piece])
    return spans.take(good), piece[good]


def _mark_uniform_pieces(made: Toolpaths, piece: Int, count: int, groups: Int) -> Bool:
    """Return a mask (count,) of pieces whose spans have similar length and width on all layers of their group.

    Args:
        made: the spans as paths.
        piece: (M,) piece of each span; -1 for none.
        count: number of pieces.
        groups: (L,) first layer of the group of each layer.
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
    last = find_last_layers(groups)[first]
    everywhere = np.bincount(owner, minlength=count) == last - first + 1
    thick = plan.top[last] - plan.bottom[first]
    even = (most[:3] - least[:3] <= SAME_PLACE).all(axis=0)
    even &= most[3] - least[3] <= _EQUAL * most[3] + _SLIVER
    return np.asarray(everywhere & even & (bead.width_for_spacing(least[1], thick) >= thick))


def _merge_spans(made: Toolpaths, piece: Int, groups: Int) -> Toolpaths:
    """Keep only the spans on the last layer of each piece (M,), with the volume of all layers."""
    plan = made.plan
    laid = np.bincount(piece, made.area() * made.height)
    kept = np.flatnonzero(made.layer == find_last_layers(groups)[made.layer])
    made, piece = made.take(kept), piece[kept]
    size = np.diff(made.start)
    height = np.round(plan.top[made.layer] - plan.bottom[groups[made.layer]], 7)
    more = laid / np.maximum(np.bincount(piece, made.area() * height, minlength=len(laid)), 1e-12)
    own, high = np.repeat(made.height, size), np.repeat(height, size)
    width = bead.width_for_spacing(bead.spacing(made.width, own) * np.repeat(more[piece], size), high)
    return replace(made, height=height, width=np.maximum(np.round(width, 4), high))
