"""Tips of trees: the places right under an overhang at which branches begin."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, run_starts
from printer_slicer.geometry import Areas, depths, hatch, split_connected
from printer_slicer.geometry.boxes import Boxes
from printer_slicer.geometry.vectors import norm
from printer_slicer.model import Overhangs, SupportPlan
from printer_slicer.supports.roofs import Joists
from printer_slicer.supports.tree_settings import TreeSettings
from printer_slicer.values import Struct

__all__ = [
    "LOWEST_TIP",
    "REACH_IN_Z",
    "Tips",
    "choose_tips",
    "choose_unreached_places",
    "join_tips",
    "list_island_tips",
    "list_joist_tips",
    "list_strip_places",
    "sample_inner_points",
]

_REACH_OF_SLOPES, _REACH_OF_FLATS = 0.9, 0.7  # of the spacing of joists
_REACH_OF_TIPS = 1.9  # mm from the side of a tip up to the edge of a strip
_MIN_REACH = 1.0  # mm
REACH_IN_Z = 2.0  # mm from a place up to the tip; below the tip, its branch carries what is beside it
LOWEST_TIP = 0.6  # mm from a place down to the tip
_CELL_RATIO = 1.4  # reaches; larger cells leave places that need another round, smaller ones give more tips
_SAMPLE = 0.5  # mm between places in narrow strips
_MAX_CHORD = 3.0  # mm; strips are narrower than a roof, 2 mm, and may lie diagonally
_AT_ISLAND = 0.5  # mm between a tip and the island that it carries
_BESIDE_FAILED = 0.5  # mm; tips this near to one that no branch reaches are not tried


class Tips(Struct, frozen=True, eq=False):
    """Places where branches begin.

    Attributes:
        place: (T, 3) mm.
        layer: (T,) support layer on whose top the overhang or the joist lies.
        of_joist: (T,) index of the tip among those of joists; -1: under a strip or an island.
        island: (T,) whether the tip carries the lowest piece of a body.
        reach: (T,) distance sideways within which the place must have a tip, mm.
    """

    place: Float
    layer: Int
    of_joist: Int
    island: Bool
    reach: Float

    @property
    def count(self) -> int:
        """Number of tips."""
        return len(self.layer)

    def take(self, which: Int | Bool) -> Tips:
        """Return the tips with these indices (n,), or of a mask (T,)."""
        return Tips(*(getattr(self, name)[which] for name in self.__struct_fields__))


def list_joist_tips(joists: Joists, top: Float, interface_layers: int) -> Tips:
    """Return the tips under joists; joists on the bed, and roofs without joists, need none."""
    layer = joists.roof_layer[joists.of_tip] - interface_layers - 1
    above = np.flatnonzero(layer >= 0)
    layer = layer[above]
    place = np.column_stack([joists.tip_places[above], top[layer]])
    return Tips(place, layer, above, np.zeros(len(above), np.bool_), np.zeros(len(above)))


def list_island_tips(islands: Areas, carrier: Int, top: Float) -> Tips:
    """Return a tip at an inner point of each island.

    Args:
        islands: areas under the lowest pieces of bodies, by layer of the part.
        carrier: (L,) support layer on whose top the overhang of each layer of the part rests.
        top: (S,) z of the top of each support layer, mm.
    """
    pieces = split_connected(islands)
    layer, n = carrier[pieces.layer], pieces.count
    place = np.column_stack([_find_poles(pieces.areas), top[layer]])
    return Tips(place, layer, np.full(n, -1), np.ones(n, np.bool_), np.full(n, _AT_ISLAND))


def list_strip_places(strips: Areas, overhangs: Overhangs, plan: SupportPlan, settings: TreeSettings) -> Tips:
    """Return all places at which tips under strips, areas by layer of the part, may begin.

    Under flats, tips are closer together than under slopes, which branches also carry with their sides.
    """
    points, layer = sample_inner_points(strips)
    carrier, n = plan.carrier[layer], len(layer)
    place = np.column_stack([points, plan.layers.top[carrier]])
    reach = np.where(overhangs.is_flat[layer], _REACH_OF_FLATS, _REACH_OF_SLOPES) * settings.joist
    # The edges of wide strips, on slopes that are nearly level, are farther from a tip than the middle.
    half = np.nan_to_num(depths(strips, points, layer, _MAX_CHORD / 2))
    reach = np.minimum(reach, np.maximum(_REACH_OF_TIPS + settings.tip_radius - half, _MIN_REACH))
    return Tips(place, carrier, np.full(n, -1), np.zeros(n, np.bool_), reach)


def choose_tips(places: Tips, tips: Tips, found: Bool) -> Tips:
    """Choose among places those that have no tip near them, so that each then has one.

    Args:
        places: under strips.
        tips: tips tried so far.
        found: (T,) whether a branch reaches each.
    """
    left = ~_is_near(places, tips.take(found)) & ~_is_beside(places, tips.take(~found), _BESIDE_FAILED)
    return _choose_covering(places.take(left))


def choose_unreached_places(places: Tips, tips: Tips, found: Bool) -> Tips:
    """Return the places that are left without a tip near them, one of each group of neighbours, and such islands."""
    chosen = _choose_covering(places.take(~_is_near(places, tips.take(found))))
    lost = tips.take(tips.island & ~found)
    return join_tips([lost.take(~_is_near(lost, tips.take(found))), chosen])


def join_tips(parts: list[Tips]) -> Tips:
    """Return the tips of several values, one after the other."""
    return Tips(*(np.concatenate([getattr(part, name) for part in parts]) for name in Tips.__struct_fields__))


def sample_inner_points(strips: Areas) -> tuple[Float, Int]:
    """Return points (n, 2) near the middle of narrow strips, about 0.5 mm apart, and the layer (n,) of each.

    They are the middles of the chords along x and along y. Every piece has at least one.
    """
    found = [hatch(strips, angle=angle, spacing=_SAMPLE) for angle in (0.0, np.pi / 2)]
    ends, layer = np.concatenate([one.ends for one in found]), np.concatenate([one.layer for one in found])
    short = norm(ends[:, 1] - ends[:, 0]) <= _MAX_CHORD
    points, layer = ends[short].mean(axis=1), layer[short]
    pieces = split_connected(strips)
    poles = _find_poles(pieces.areas)
    return np.concatenate([points, poles]), np.concatenate([layer, pieces.layer])


def _find_poles(pieces: Areas) -> Float:
    """Return an inner point (P, 2) of each piece, one per layer: the middle of the longest chord through its middle."""
    low, high = pieces.boxes()
    middle = (low + high) / 2
    moved = Areas(
        pieces.xy - middle[pieces.point_layer], pieces.ring_start, pieces.ring_layer, pieces.n_layers
    )
    lines = hatch(moved, angle=0.0, spacing=1e4)
    order = np.lexsort((-norm(lines.ends[:, 1] - lines.ends[:, 0]), lines.layer))
    first = order[run_starts(lines.layer[order])]
    result = middle.copy()
    result[lines.layer[first]] += lines.ends[first].mean(axis=1)
    return result


def _choose_covering(places: Tips) -> Tips:
    """Choose places so that every place has a chosen one within its reach, see `_is_near`.

    Cells of 1.4 reaches take turns in eight groups, in each of which no two are neighbours; each cell chooses the place
    nearest to its middle.
    """
    size = np.column_stack([np.outer(places.reach, [_CELL_RATIO] * 2), np.full(places.count, REACH_IN_Z)])
    share = places.place / size
    cell = np.floor(share).astype(np.int64)
    off = norm((share - cell - 0.5)[:, :2])
    group = (cell % 2) @ np.array([1, 2, 4])
    left, chosen = np.ones(places.count, np.bool_), list[Int]()
    while left.any():
        for turn in range(8):
            some = np.flatnonzero(left & (group == turn))
            if not len(some):
                continue
            order = some[np.lexsort((off[some], *cell[some].T))]
            new = np.ones(len(order), np.bool_)
            new[1:] = (np.diff(cell[order], axis=0) != 0).any(axis=1)
            chosen.append(order[new])
            rest = np.flatnonzero(left)
            left[rest] = ~_is_near(places.take(rest), places.take(order[new]))
            left[order[new]] = False
    return places.take(np.sort(np.concatenate([np.zeros(0, np.int64), *chosen])))


def _is_near(places: Tips, tips: Tips) -> Bool:
    """Return a mask (N,) of places with a tip within their reach, from 0.6 mm below to 2 mm above."""
    return _is_beside(places, tips, places.reach)


def _is_beside(places: Tips, tips: Tips, reach: Float | float) -> Bool:
    """Return a mask (N,) of places with a tip within `reach` mm, one for all or (N,), see `_is_near`."""
    result = np.zeros(places.count, np.bool_)
    reach = np.broadcast_to(reach, (places.count,))
    ends = [(one.place[:, :2], np.zeros(one.count, np.int64)) for one in (places, tips)]
    points, others = (Boxes(xy, xy, layer) for xy, layer in ends)
    own, other = points.expand(reach).find_overlapping(others)
    gap = places.place[own] - tips.place[other]
    result[own[(norm(gap[:, :2]) <= reach[own]) & (gap[:, 2] <= LOWEST_TIP) & (gap[:, 2] >= -REACH_IN_Z)]] = (
        True
    )
    return result
