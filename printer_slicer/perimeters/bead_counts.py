"""Count the beads across each piece of the medial axis, and choose the pieces that beads follow.

Source: Kuipers et al. 2020 (arXiv 2004.13497), "central" edges and their bead counts. Short runs of a count take the
count of a neighbour.
"""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, unique_inverse
from printer_slicer.geometry.connectivity import label_components
from printer_slicer.perimeters.beading import Beading
from printer_slicer.perimeters.graph import AxisGraph, find_crossings, thin_and_thick_ends
from printer_slicer.values import Struct

__all__ = ["CountedGraph", "count_beads"]

_MAX_STEEPNESS = np.sin(np.deg2rad(25) / 2)  # loops simply turn in corners wider than this
_SHORTEST_CENTRAL_RUN = 0.6  # spacings; a shorter run in front of a wider place is part of a corner
_SHORTEST_RUN = 1.0  # mm
_MAX_EXCESS = 0.25  # spacings by which beads of a short run may exceed their limits
_LONGER_RUN = 5.0  # mm
_MAX_EXCESS_LONGER = 0.12  # spacings, the same for longer runs
_MAX_EXCESS_BULGE = 0.6  # spacings, the same where runs meet
_MAX_ROUNDS = 6
_TIP_RADIUS = 1e-6  # mm of radius
_SPUR_RADIUS_RATIO = 0.3  # of the narrowest bead's spacing
_SPUR_LENGTH = 0.05  # mm beyond the round end of a bead


class CountedGraph(Struct, frozen=True, eq=False):
    """A medial axis with the number of beads across each piece.

    Attributes:
        graph: the axis, divided where the count changes.
        used: (E,) pieces that beads may follow.
        central: (E,) used pieces whose count follows from their own thickness; the others lead to wider places or
            into corners.
        corner: (E,) used pieces that lead into corners.
        wide: (E,) pieces too thick for variable width.
        count: (E,) of central pieces; 0 elsewhere.
    """

    graph: AxisGraph
    used: Bool
    central: Bool
    corner: Bool
    wide: Bool
    count: Int


def count_beads(graph: AxisGraph, has_real_sides: Bool, beading: Beading, widest: Float) -> CountedGraph:
    """Count the beads across each piece.

    Args:
        graph: the medial axis.
        has_real_sides: (E,) whether the piece lies between real outlines.
        beading: number of beads by thickness.
        widest: (L,) radius from which pieces are wide.
    """
    graph = graph.divide_pieces(*_find_cuts(graph, beading, widest))
    has_real_sides, layer, radius = has_real_sides[graph.origin], graph.piece_layer, graph.middle_radius
    wide = has_real_sides & (radius > widest[layer])
    used = has_real_sides & ~wide
    central, base = _mark_central_pieces(graph, used, wide, beading)
    own = np.zeros(len(used), np.int64)
    for limit in beading.thresholds():
        own += radius > limit[layer]
    count = _replace_short_runs(graph, central, np.where(central, own, 0), wide, beading)
    # Rising pieces keep the count of the run below while the thickness allows; beyond, the wider place decides.
    top = _highest_counts(graph, central, count)
    rising = np.flatnonzero(used & ~central & (base >= 0))
    below = top[base[rising]]
    bulge = _find_bulge_counts(graph, rising, below, central | wide, beading)
    stays = (own[rising] == below) | (bulge >= 0)
    count[rising[stays]] = np.where(bulge >= 0, bulge, below)[stays]
    central[rising[stays]] = True
    corner = used & ~central & (base < 0)
    spur = _find_spurs(graph, corner, central, count, _spur_radius(beading))
    central[spur], corner[spur], count[spur] = True, False, 1
    return CountedGraph(graph, used, central, corner, wide, count)


def _find_cuts(graph: AxisGraph, beading: Beading, widest: Float) -> tuple[Int, Float]:
    """Return pieces (n,) and positions (n,) on them, 0 to 1, at which the number of beads may change."""
    radius, layer, limits = graph.radius.take(graph.ends), graph.piece_layer, beading.thresholds()
    least, most = np.minimum(*radius.T), np.maximum(*radius.T)
    cuts = [find_crossings(radius, widest[layer])]
    single = np.flatnonzero(most <= limits[min(1, beading.full_count - 1)][layer])
    # In a corner the count is that of the place where the corner begins.
    above = np.flatnonzero((least > _TIP_RADIUS) | (graph.steepness <= _MAX_STEEPNESS))
    for some, limit in ((single, _spur_radius(beading)), *((above, limit) for limit in limits)):
        piece, share = find_crossings(radius.take(some, axis=0), limit[layer[some]])
        cuts.append((some[piece], share))
    return np.concatenate([piece for piece, _ in cuts]), np.concatenate([share for _, share in cuts])


def _highest_counts(graph: AxisGraph, central: Bool, count: Int) -> Int:
    """Return for each point (V,) the highest count of its central pieces; 0 if it has none."""
    top = np.zeros(len(graph.xy), np.int64)
    np.maximum.at(top, graph.ends[central].ravel(), np.repeat(count[central], 2))
    return top


def _spur_radius(beading: Beading) -> Float:
    """Return the radius (L,) down to which a bead extends into a corner."""
    return np.asarray(np.maximum(beading.thresholds()[0], _SPUR_RADIUS_RATIO * beading.narrowest))


def _find_spurs(graph: AxisGraph, corner: Bool, central: Bool, count: Int, least_radius: Float) -> Int:
    """Return the pieces into corners that a single bead must follow; otherwise the corners would stay too empty."""
    ends, radius, length = graph.ends, graph.radius, graph.length
    top = _highest_counts(graph, central, count)
    piece = np.flatnonzero(corner)
    low, high = thin_and_thick_ends(ends.take(piece, axis=0), radius)
    forks = np.bincount(high, minlength=len(radius))
    onward = np.full(len(radius), -1)
    onward[high] = np.arange(len(piece))
    start = np.flatnonzero(top[high] == 1)
    here, chain = start, np.arange(len(start))
    reached, visited = np.zeros(len(start)), [(np.zeros(0, np.int64), np.zeros(0, np.int64))]
    while len(here):
        deep = radius[low[here]] >= least_radius[graph.layer[low[here]]] - _TIP_RADIUS
        here, chain = here[deep], chain[deep]
        visited.append((here, chain))
        reached[chain] += length[piece[here]]
        goes_on = forks[low[here]] == 1
        here, chain = onward[low[here[goes_on]]], chain[goes_on]
    worth = reached > radius[high[start]] + _SPUR_LENGTH
    items, chains = (np.concatenate(column) for column in zip(*visited, strict=True))
    return np.asarray(piece[items[worth[chains]]])


def _find_bulge_counts(graph: AxisGraph, rising: Int, below: Int, is_decided: Bool, beading: Beading) -> Int:
    """Return the bead counts (n,) for pieces `rising` that form only a bulge where runs meet; -1 for other pieces."""
    ends, radius = graph.ends, graph.radius
    group = label_components(ends[rising].T, len(radius))
    low, up = thin_and_thick_ends(ends.take(rising, axis=0), radius)
    highest = _reduce_groups(np.maximum, group[ends[rising, 0]], radius[up], len(radius), 0.0)
    summit = radius[up] >= highest[group[up]] - 1e-9
    led = np.zeros(len(radius), np.bool_)
    led[ends[is_decided]] = True
    lost = np.zeros(len(radius), np.bool_)
    lost[group[up[summit & led[up]]]] = True
    own = group[ends[rising, 0]]
    most = _reduce_groups(np.maximum, own, below.astype(np.float64), len(radius), 0.0)[own].astype(np.int64)
    layer = graph.piece_layer[rising]
    fits = beading.width_excess(highest[own], most, layer) <= _MAX_EXCESS_BULGE
    fits &= beading.width_excess(radius[low], most, layer) <= _MAX_EXCESS_BULGE
    return np.where(fits & ~lost[own], most, -1)


def _mark_central_pieces(graph: AxisGraph, used: Bool, wide: Bool, beading: Beading) -> tuple[Bool, Int]:
    """Return which pieces (E,) are central (have nearly constant thickness), and the base (E,) of other pieces.

    The base of a piece that gets thicker is the point of a central piece where the rise begins; -1 if there is none.
    """
    ends, radius = graph.ends, graph.radius
    central = used & (graph.steepness <= _MAX_STEEPNESS)
    of_point = label_components(ends[central].T, len(radius))
    length = np.bincount(of_point[ends[central, 0]], graph.length[central], len(radius))
    # A short run with one rising piece is the end of a corner; a waist has two or more.
    low, high = thin_and_thick_ends(ends, radius)
    beside = (used | wide) & ~central
    exits = np.bincount(of_point[low[beside]], minlength=len(radius))
    group = of_point[ends[:, 0]]
    short = length[group] < _SHORTEST_CENTRAL_RUN * beading.spacing[graph.piece_layer]
    central &= ~(short & (exits[group] == 1))
    base = np.full(len(radius), -1)
    base[ends[central]] = ends[central]
    result = np.full(len(central), -1)
    left = np.flatnonzero(used & ~central)
    while len(left):
        climbing = left[base[low[left]] >= 0]
        if not len(climbing):
            break
        result[climbing] = base[low[climbing]]
        new = climbing[base[high[climbing]] < 0]
        base[high[new]] = base[low[new]]
        left = left[result[left] < 0]
    return central, result


def _replace_short_runs(graph: AxisGraph, central: Bool, count: Int, wide: Bool, beading: Beading) -> Int:
    """Give short runs the bead count of a neighbour where the widths allow; runs beside wide places keep theirs."""
    piece = np.flatnonzero(central)
    if not len(piece):
        return count
    count = count.copy()
    ends, layer, length = graph.ends[piece], graph.piece_layer[piece], graph.length[piece]
    mouth = np.zeros(len(graph.xy), np.bool_)
    mouth[graph.ends[wide]] = True
    length = np.where(mouth[ends].any(axis=1), np.inf, length)
    low, high = (graph.radius[point] for point in thin_and_thick_ends(ends, graph.radius))
    for _ in range(_MAX_ROUNDS):
        own = count[piece]
        key = ends * (beading.full_count + 1) + own[:, None]
        ports, number = unique_inverse(key.ravel())
        run_of_port = label_components(number.reshape(-1, 2).T, len(ports))
        run = run_of_port[number.reshape(-1, 2)[:, 0]]
        n_runs = int(run_of_port.max()) + 1
        runs = _Runs(
            np.asarray(np.bincount(run, length, n_runs), np.float64),
            _reduce_groups(np.minimum, run, low, n_runs, np.inf),
            _reduce_groups(np.maximum, run, high, n_runs, -np.inf),
            _values_of_runs(run, own, n_runs),
            _values_of_runs(run, layer, n_runs),
        )
        met = np.flatnonzero(ports[1:] // (beading.full_count + 1) == ports[:-1] // (beading.full_count + 1))
        sides = np.stack([run_of_port[met], run_of_port[met + 1]])
        changed = runs.absorb_short_runs(np.concatenate([sides, sides[::-1]], axis=1), beading)
        if np.array_equal(changed, runs.count):
            break
        count[piece] = changed[run]
    return count


def _reduce_groups(reduction: np.ufunc, group: Int, values: Float, n: int, start: float) -> Float:
    """Reduce the values (m,) of each group to their minimum or maximum (n,); empty groups get `start`."""
    result = np.full(n, start)
    reduction.at(result, group, values)
    return result


def _values_of_runs(run: Int, values: Int, n: int) -> Int:
    """Return the value of each run (n,), given the values (m,) of pieces, which are equal within a run."""
    result = np.zeros(n, np.int64)
    result[run] = values
    return result


class _Runs(Struct, frozen=True, eq=False):
    """Runs of connected pieces of one bead count: length, least and greatest radius, count and layer, each (n,)."""

    length: Float
    thinnest: Float
    thickest: Float
    count: Int
    layer: Int

    def absorb_short_runs(self, neighbours: Int, beading: Beading) -> Int:
        """Give short runs the count of a neighbour, only the shortest of adjacent runs; return all counts (n,)."""
        own, other = neighbours
        ranked = np.lexsort((np.arange(len(self.length)), self.length))
        rank = np.zeros(len(ranked), np.int64)
        rank[ranked] = np.arange(len(ranked))
        lowest = np.full(len(rank), len(rank))
        np.minimum.at(lowest, own, rank[other])
        ask = (self.length[own] < _LONGER_RUN) & (rank[own] < lowest[own]) & (self.count[other] > 0)
        own, other = own[ask], other[ask]
        wanted, layer = self.count[other], self.layer[own]
        excess = np.maximum(
            beading.width_excess(self.thinnest[own], wanted, layer),
            beading.width_excess(self.thickest[own], wanted, layer),
        )
        longer = np.where(
            self.count[own] > 0, _MAX_EXCESS_LONGER, -1.0
        )  # runs too thin for any bead stay empty
        limit = np.where(self.length[own] < _SHORTEST_RUN, _MAX_EXCESS, longer)
        dip = self._find_dips(*neighbours)[own] & (wanted % 2 == 1)
        gives = excess <= np.where(dip, np.maximum(limit, beading.max_dip_excess(layer)), limit)
        result = self.count.copy()
        best = np.lexsort((self.length[other], -excess))  # the least excess is written last
        best = best[gives[best]]
        result[own[best]] = wanted[best]
        return result

    def _find_dips(self, own: Int, other: Int) -> Bool:
        """Return which runs (n,) lie between runs with one more bead, whose middle bead they would interrupt."""
        deeper = np.bincount(own, self.count[other] == self.count[own] + 1, len(self.count))
        met = np.bincount(own, minlength=len(self.count))
        return np.asarray((met > 1) & (deeper == met) & (self.count > 0))
