"""Bridges: the direction in which they rest on something at both ends, and how far they reach onto it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.geometry import (
    Areas,
    Lines,
    Pieces,
    difference,
    hatch,
    intersection,
    offset,
    offset_open,
    pieces_of,
    swept,
    union,
)
from printer_slicer.geometry.boxes import Boxes

__all__ = ["Bridges", "bridge_angles", "bridges_over", "over_sparse"]

_DIRECTIONS = 12  # 15° apart
_FINER = (-np.pi / 36, np.pi / 36)  # tried beside the best of them: 5° to either side
_WORTH = np.array([0.0, 0.5, 1.0])  # of a line of which so many ends are carried
_BESIDE = 0.05  # mm: what lies right beside a bridge holds it too, as walls do over an inside that is empty
_SHORTER = 0.02  # share of lines that rest, for which lines half as long are taken
_POSITIVE = 0.5  # added so that no line that rests counts less than none
# By how much another direction has to be better: 7 % shorter lines, twice as much for one between those tried first.
_BETTER, _FINELY_BETTER = 0.002, 0.004
_NEAR = 1e-3  # mm: ends this close to a support lie on it; engines round to 0.01 µm
_NARROW = (
    4  # threads: rows of another direction than that of its sides would leave a narrower strip half empty
)


@dataclass(frozen=True, slots=True, eq=False)
class Bridges:
    """Bridges one by one.

    Attributes:
        areas: B entries instead of layers.
        layer: (B,) ascending, on which each lies.
        angle: (B,) radians, the direction of its lines.
        loose: on the layers of the stack, what is open to the air below, but no line is held at any end.
    """

    areas: Areas
    layer: Int
    angle: Float
    loose: Areas

    def of_stack(self) -> tuple[Areas, Float]:
        """The bridges on the layers of the stack, and (R,) the direction in each of their rings."""
        own, entry = np.arange(self.areas.n_rings), self.areas.ring_layer
        return self.areas.restacked(own, self.layer[entry], self.loose.n_layers), self.angle[entry]

    def covered(self) -> Areas:
        """All that is open to the air below, on the layers of the stack."""
        return self.of_stack()[0].merge(self.loose)

    def with_scraps(self, scraps: Pieces, near: Float) -> Bridges:
        """Larger by the scraps within `near` (L,) mm of a bridge: each by those that have most of them next to it."""
        around = offset(self.areas, near[self.layer])
        own, scrap = Boxes(*around.boxes(), self.layer).overlapping(
            Boxes(*scraps.areas.boxes(), scraps.layer)
        )
        shared = intersection(around.for_each(own), scraps.areas.for_each(scrap)).area()
        order = np.lexsort((-shared, scrap))
        order = order[shared[order] > 0]
        order = order[np.diff(scrap[order], prepend=-1) != 0]
        order = order[np.argsort(own[order], kind="stable")]
        taken = scraps.areas.for_each(scrap[order])
        rings, bridge = np.arange(taken.n_rings), own[order][taken.ring_layer]
        return replace(self, areas=union(self.areas, taken.restacked(rings, bridge, self.areas.n_layers)))


def bridges_over(
    air: Areas, grown: Areas, below: Areas, spacing: Float, reach: tuple[Float, Float]
) -> Bridges:
    """Bridges over what is open to the air below, which reach along their lines onto what carries these.

    Beside the outermost lines there is nothing to be bridged. What no line can bridge reaches to all sides.

    Args:
        air: open below.
        grown: as far as bridges may reach.
        below: what carries, below each layer.
        spacing: (L,) mm between lines.
        reach: (L,) mm that lines reach onto what carries them, and (L,) radians, the usual direction.
    """
    anchor, usual = reach
    pieces = pieces_of(grown)
    turn, held = bridge_angles(pieces, below, spacing, usual)
    loose = pieces.on_layers(grown.n_layers, np.flatnonzero(~held))
    pieces, turn = pieces.take(np.flatnonzero(held)), turn[held]
    # Half a line more on both sides of those over the air.
    own = pieces.beside(offset(air, spacing / 2))
    along = swept(own, anchor[pieces.layer, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1))
    return Bridges(intersection(along, pieces.areas), pieces.layer, turn, loose)


def over_sparse(solid: Areas, below: Areas, width: float | Float, anchor: float | Float) -> Areas:
    """What of solid areas lies over sparse infill, with what carries it at its sides.

    Args:
        solid: areas.
        below: the sparse areas of the layer below each.
        width: mm, of beads, of all layers or of each (L,).
        anchor: mm of solid infill beside it that it reaches onto, likewise.
    """
    over = intersection(solid, below)
    if not over.n_rings:
        return over
    # A strip that two beads bridge rests on the solid infill beside it.
    over = intersection(offset(offset_open(over, width), anchor), solid)
    # What would be left beside it, but is too narrow for a bead, goes with it.
    beside = offset_open(difference(solid, over), width / 2)
    return intersection(difference(solid, beside), offset(over, width))


def bridge_angles(pieces: Pieces, below: Areas, spacing: Float, usual: float | Float) -> tuple[Float, Bool]:
    """(P,) direction of the lines over each bridge, radians, and whether any line is held at an end.

    Tries directions 15° apart, then 5° to either side of the best and that of the longest side, and takes the one with
    the largest share of length in lines that end on the layer below at both ends; lines that do at one end, as over a
    balcony, count half; of nearly equals the one whose longest lines are shortest; in a narrow strip that of the side,
    if it is as good. What nothing carries gets the usual direction.

    Args:
        pieces: areas over air, grown onto their supports.
        below: what carries, below each layer.
        spacing: (L,) mm between lines.
        usual: radians, of all layers or of each (L,).
    """
    if not pieces.count:
        return np.zeros(0), np.zeros(0, np.bool_)
    support = intersection(offset(pieces.areas, _BESIDE), pieces.beside(below))
    gap = spacing[pieces.layer]
    score = partial(_score, pieces.areas, support, gap)
    best, record = np.broadcast_to(usual, spacing.shape)[pieces.layer], np.zeros(pieces.count)
    # Of nearly equals the first one is taken: those along the axes of the bed, as parts mostly are.
    whole = sorted(range(_DIRECTIONS), key=lambda turn: (turn % 6 != 0, turn % 3 != 0))
    tried = [(np.full(pieces.count, turn * np.pi / _DIRECTIONS), _BETTER) for turn in whole]
    best, record = _best(score, (best, record), tried)
    best, record = _best(score, (best, record), [(best + turn, _FINELY_BETTER) for turn in _FINER])
    needed = np.where(pieces.mean_width() < _NARROW * gap, -_BETTER, _FINELY_BETTER)
    best, record = _best(score, (best, record), [(_longest_sides(pieces.areas), needed)])
    return best, record > 0


def _longest_sides(areas: Areas) -> Float:
    """(P,) radians, the direction of the longest side of each."""
    side = areas.xy[areas.following] - areas.xy
    order = np.lexsort((np.hypot(*side.T), areas.point_layer))
    last = order[np.append(np.diff(areas.point_layer[order]) != 0, True)]
    return np.asarray(np.arctan2(side[last, 1], side[last, 0]) % np.pi)


def _best(
    score: Callable[[Float], Float], found: tuple[Float, Float], tried: Sequence[tuple[Float, float | Float]]
) -> tuple[Float, Float]:
    """(P,) the best of directions, and how good it is.

    Args:
        score: of a direction (P,).
        found: what is known already.
        tried: directions (P,), and by how much each has to be better than those before it.
    """
    best, record = found
    for angle, needed in tried:
        reached = score(angle)
        better = reached > record + needed
        best, record = np.where(better, angle, best), np.where(better, reached, record)
    return best, record


def _score(bridge: Areas, support: Areas, spacing: Float, angle: Float) -> Float:
    """(P,) how well lines of a direction are held in each piece; 0 where none is."""
    lines = hatch(bridge, angle=angle, spacing=spacing)
    carried = _carried(lines, hatch(support, angle=angle, spacing=spacing))
    length, n = lines.length(), bridge.n_layers
    total = np.bincount(lines.layer, weights=length, minlength=n)
    held = np.bincount(lines.layer, weights=length * _WORTH[carried], minlength=n)
    # What sags is long: a mean in which hardly any but the longest lines weigh. Half as long is worth as much as 2 % of
    # the share.
    less, more = (np.bincount(lines.layer, weights=length**power, minlength=n) for power in (6, 7))
    sagging = np.log2(np.maximum(more, 1e-9) / np.maximum(less, 1e-9))
    return np.where(held > 0, held / np.maximum(total, 1e-9) + _POSITIVE - _SHORTER * sagging, 0.0)


def _carried(lines: Lines, support: Lines) -> Int:
    """(S,) how many ends of each line lie on a support line of the same row: 0, 1 or 2."""
    if support.n_lines == 0 or lines.n_lines == 0:
        return np.zeros(lines.n_lines, np.int64)
    rows = np.concatenate([lines.row, support.row])
    row = rows - rows.min()
    group = np.concatenate([lines.layer, support.layer]) * (row.max() + 1) + row
    u = np.concatenate([lines.u, support.u])
    low, span = float(u.min()), float(u.max() - u.min()) + 1.0
    key = group[:, None] * span + (u - low)
    own, other = key[: lines.n_lines], key[lines.n_lines :]
    resting = np.zeros(lines.n_lines, np.int64)
    for end, inward in ((0, _NEAR), (1, -_NEAR)):
        at = own[:, end] + inward
        before = np.searchsorted(other[:, 0], at + _NEAR, side="right") - 1
        resting += (before >= 0) & (other[np.maximum(before, 0), 1] >= at - _NEAR)
    return resting
