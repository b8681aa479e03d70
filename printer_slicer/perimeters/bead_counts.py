"""Count the beads across each piece of the medial axis, and choose the pieces that beads follow.

Source: Kuipers et al. 2020 (arXiv 2004.13497), "central" edges and their bead counts. Short runs of a count take the
count of a neighbour.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, unique_inverse
from printer_slicer.geometry.connectivity import label_components
from printer_slicer.perimeters.beading import Beading
from printer_slicer.perimeters.graph import AxisGraph, crossings, low_and_high

__all__ = ["CountedGraph", "count_beads"]

_SHARPEST = np.sin(np.deg2rad(25) / 2)  # loops simply turn in corners wider than this
_SHORTEST_CENTRAL = 0.6  # spacings; a shorter run in front of a wider place is part of a corner
_SHORTEST_RUN = 1.0  # mm
_GIVE = 0.25  # spacings by which beads of a short run may exceed their limits
_LONGER_RUN = 5.0  # mm
_GIVE_LONGER = 0.12  # spacings, the same for longer runs
_GIVE_ON_TOP = 0.6  # spacings, the same where runs meet
_ROUNDS = 6
_TIP = 1e-6  # mm of radius
_SPUR_FLOOR = 0.3  # of the narrowest bead's spacing
_SPUR = 0.05  # mm beyond the round end of a bead


@dataclass(frozen=True, slots=True, eq=False)
class CountedGraph:
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


def count_beads(graph: AxisGraph, real: Bool, beading: Beading, widest: Float) -> CountedGraph:
    """Count the beads across each piece.

    Args:
        graph: the medial axis.
        real: (E,) pieces between real outlines.
        beading: number of beads by thickness.
        widest: (L,) radius from which pieces are wide.
    """
    graph = graph.divided(*_cuts(graph, beading, widest))
    real, layer, radius = real[graph.origin], graph.piece_layer, graph.middle_radius
    wide = real & (radius > widest[layer])
    used = real & ~wide
    central, base = _central(graph, used, wide, beading)
    own = np.zeros(len(used), np.int64)
    for limit in beading.thresholds():
        own += radius > limit[layer]
    count = _without_short_runs(graph, central, np.where(central, own, 0), wide, beading)
    # Rising pieces keep the count of the run below while the thickness allows; beyond, the wider place decides.
    top = _highest(graph, central, count)
    rising = np.flatnonzero(used & ~central & (base >= 0))
    below = top[base[rising]]
    bulge = _on_top(graph, rising, below, central | wide, beading)
    stays = (own[rising] == below) | (bulge >= 0)
    count[rising[stays]] = np.where(bulge >= 0, bulge, below)[stays]
    central[rising[stays]] = True
    corner = used & ~central & (base < 0)
    spur = _spurs(graph, corner, central, count, _spur_floor(beading))
    central[spur], corner[spur], count[spur] = True, False, 1
    return CountedGraph(graph, used, central, corner, wide, count)


def _cuts(graph: AxisGraph, beading: Beading, widest: Float) -> tuple[Int, Float]:
    """Return the pieces (n,) and the positions (n,) on them, 0 to 1, where the count may change."""
    radius, layer, limits = graph.radius.take(graph.ends), graph.piece_layer, beading.thresholds()
    least, most = np.minimum(*radius.T), np.maximum(*radius.T)
    cuts = [crossings(radius, widest[layer])]
    single = np.flatnonzero(most <= limits[min(1, beading.full - 1)][layer])
    # In a corner the count is that of the place where the corner begins.
    above = np.flatnonzero((least > _TIP) | (graph.steepness <= _SHARPEST))
    for some, limit in ((single, _spur_floor(beading)), *((above, limit) for limit in limits)):
        piece, share = crossings(radius.take(some, axis=0), limit[layer[some]])
        cuts.append((some[piece], share))
    return np.concatenate([piece for piece, _ in cuts]), np.concatenate([share for _, share in cuts])


def _highest(graph: AxisGraph, central: Bool, count: Int) -> Int:
    """Return the highest count (V,) of the central pieces at each point, 0 without any."""
    top = np.zeros(len(graph.xy), np.int64)
    np.maximum.at(top, graph.ends[central].ravel(), np.repeat(count[central], 2))
    return top


def _spur_floor(beading: Beading) -> Float:
    """Return the radius (L,) down to which a bead extends into a corner."""
    return np.asarray(np.maximum(beading.thresholds()[0], _SPUR_FLOOR * beading.narrowest))


def _spurs(graph: AxisGraph, corner: Bool, central: Bool, count: Int, floor: Float) -> Int:
    """Return the corner pieces that a single bead must follow, because it would leave too much of them empty."""
    ends, radius, length = graph.ends, graph.radius, graph.length
    top = _highest(graph, central, count)
    piece = np.flatnonzero(corner)
    low, high = low_and_high(ends.take(piece, axis=0), radius)
    forks = np.bincount(high, minlength=len(radius))
    onward = np.full(len(radius), -1)
    onward[high] = np.arange(len(piece))
    start = np.flatnonzero(top[high] == 1)
    here, chain = start, np.arange(len(start))
    reached, visited = np.zeros(len(start)), [(np.zeros(0, np.int64), np.zeros(0, np.int64))]
    while len(here):
        deep = radius[low[here]] >= floor[graph.layer[low[here]]] - _TIP
        here, chain = here[deep], chain[deep]
        visited.append((here, chain))
        reached[chain] += length[piece[here]]
        goes_on = forks[low[here]] == 1
        here, chain = onward[low[here[goes_on]]], chain[goes_on]
    worth = reached > radius[high[start]] + _SPUR
    items, chains = (np.concatenate(column) for column in zip(*visited, strict=True))
    return np.asarray(piece[items[worth[chains]]])


def _on_top(graph: AxisGraph, rising: Int, below: Int, decided: Bool, beading: Beading) -> Int:
    """Return counts (n,) for rising pieces that form only a bulge where runs meet; -1 for others."""
    ends, radius = graph.ends, graph.radius
    group = label_components(ends[rising].T, len(radius))
    low, up = low_and_high(ends.take(rising, axis=0), radius)
    highest = _extreme(np.maximum, group[ends[rising, 0]], radius[up], len(radius), 0.0)
    summit = radius[up] >= highest[group[up]] - 1e-9
    led = np.zeros(len(radius), np.bool_)
    led[ends[decided]] = True
    lost = np.zeros(len(radius), np.bool_)
    lost[group[up[summit & led[up]]]] = True
    own = group[ends[rising, 0]]
    most = _extreme(np.maximum, own, below.astype(np.float64), len(radius), 0.0)[own].astype(np.int64)
    layer = graph.piece_layer[rising]
    fits = beading.strain(highest[own], most, layer) <= _GIVE_ON_TOP
    fits &= beading.strain(radius[low], most, layer) <= _GIVE_ON_TOP
    return np.where(fits & ~lost[own], most, -1)


def _central(graph: AxisGraph, used: Bool, wide: Bool, beading: Beading) -> tuple[Bool, Int]:
    """Return pieces (E,) of nearly constant thickness, and for rising pieces the point (E,) they rise from, else -1."""
    ends, radius = graph.ends, graph.radius
    central = used & (graph.steepness <= _SHARPEST)
    of_point = label_components(ends[central].T, len(radius))
    length = np.bincount(of_point[ends[central, 0]], graph.length[central], len(radius))
    # A short run with one rising piece is the end of a corner; a waist has two or more.
    low, high = low_and_high(ends, radius)
    beside = (used | wide) & ~central
    exits = np.bincount(of_point[low[beside]], minlength=len(radius))
    group = of_point[ends[:, 0]]
    short = length[group] < _SHORTEST_CENTRAL * beading.spacing[graph.piece_layer]
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


def _without_short_runs(graph: AxisGraph, central: Bool, count: Int, wide: Bool, beading: Beading) -> Int:
    """Give short runs the count of a neighbour where the widths allow; runs in front of wide places stay."""
    piece = np.flatnonzero(central)
    if not len(piece):
        return count
    count = count.copy()
    ends, layer, length = graph.ends[piece], graph.piece_layer[piece], graph.length[piece]
    mouth = np.zeros(len(graph.xy), np.bool_)
    mouth[graph.ends[wide]] = True
    length = np.where(mouth[ends].any(axis=1), np.inf, length)
    low, high = (graph.radius[point] for point in low_and_high(ends, graph.radius))
    for _ in range(_ROUNDS):
        own = count[piece]
        key = ends * (beading.full + 1) + own[:, None]
        ports, number = unique_inverse(key.ravel())
        run_of_port = label_components(number.reshape(-1, 2).T, len(ports))
        run = run_of_port[number.reshape(-1, 2)[:, 0]]
        n_runs = int(run_of_port.max()) + 1
        runs = _Runs(
            np.asarray(np.bincount(run, length, n_runs), np.float64),
            _extreme(np.minimum, run, low, n_runs, np.inf),
            _extreme(np.maximum, run, high, n_runs, -np.inf),
            _of_run(run, own, n_runs),
            _of_run(run, layer, n_runs),
        )
        met = np.flatnonzero(ports[1:] // (beading.full + 1) == ports[:-1] // (beading.full + 1))
        sides = np.stack([run_of_port[met], run_of_port[met + 1]])
        changed = runs.changed(np.concatenate([sides, sides[::-1]], axis=1), beading)
        if np.array_equal(changed, runs.count):
            break
        count[piece] = changed[run]
    return count


def _extreme(which: np.ufunc, group: Int, values: Float, n: int, start: float) -> Float:
    """Return the minimum or maximum (n,) of the values (m,) of each group; `start` for empty groups."""
    result = np.full(n, start)
    which.at(result, group, values)
    return result


def _of_run(run: Int, values: Int, n: int) -> Int:
    """Return for each run (n,) the value that all its pieces (m,) share."""
    result = np.zeros(n, np.int64)
    result[run] = values
    return result


@dataclass(frozen=True, slots=True, eq=False)
class _Runs:
    """Runs, connected pieces of one count: length, least and greatest radius, count and layer (n,)."""

    length: Float
    thinnest: Float
    thickest: Float
    count: Int
    layer: Int

    def changed(self, neighbours: Int, beading: Beading) -> Int:
        """Return the counts (n,) after the shortest of adjacent short runs took a neighbour's count."""
        own, other = neighbours
        ranked = np.lexsort((np.arange(len(self.length)), self.length))
        rank = np.zeros(len(ranked), np.int64)
        rank[ranked] = np.arange(len(ranked))
        lowest = np.full(len(rank), len(rank))
        np.minimum.at(lowest, own, rank[other])
        ask = (self.length[own] < _LONGER_RUN) & (rank[own] < lowest[own]) & (self.count[other] > 0)
        own, other = own[ask], other[ask]
        wanted, layer = self.count[other], self.layer[own]
        strain = np.maximum(
            beading.strain(self.thinnest[own], wanted, layer),
            beading.strain(self.thickest[own], wanted, layer),
        )
        longer = np.where(self.count[own] > 0, _GIVE_LONGER, -1.0)  # runs too thin for any bead stay empty
        limit = np.where(self.length[own] < _SHORTEST_RUN, _GIVE, longer)
        dip = self._dips(*neighbours)[own] & (wanted % 2 == 1)
        gives = strain <= np.where(dip, np.maximum(limit, beading.deepest_dip(layer)), limit)
        result = self.count.copy()
        best = np.lexsort((self.length[other], -strain))  # the least strain is written last
        best = best[gives[best]]
        result[own[best]] = wanted[best]
        return result

    def _dips(self, own: Int, other: Int) -> Bool:
        """Return which runs (n,) lie between two runs with one more bead and would interrupt their middle bead."""
        deeper = np.bincount(own, self.count[other] == self.count[own] + 1, len(self.count))
        met = np.bincount(own, minlength=len(self.count))
        return np.asarray((met > 1) & (deeper == met) & (self.count > 0))
