"""Find bridges: their areas, the direction in which both ends are supported, and their anchors."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from printer_slicer import bead
from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.geometry import (
    Areas,
    ConnectedAreas,
    Lines,
    difference,
    hatch,
    intersection,
    offset,
    offset_open,
    split_connected,
    sweep_areas,
    union,
)
from printer_slicer.geometry.boxes import Boxes
from printer_slicer.profile import Profile
from printer_slicer.values import Struct, replace

__all__ = [
    "Bridges",
    "bridge_line_gap",
    "count_supported_ends",
    "find_bridge_angles",
    "find_bridges",
    "find_internal_bridges",
    "strand_diameter",
]

_DIRECTIONS = 12  # 15° apart
_FINER = (-np.pi / 36, np.pi / 36)  # 5° to either side of the best direction are tried too
_WORTH = np.array([0.0, 0.5, 1.0])  # value of a line with 0, 1 or 2 supported ends
_BESIDE = 0.05  # mm; areas this close to a bridge support it too, such as perimeters around a hollow inside
_SHORTER = 0.02  # fraction of supported lines that is worth as much as lines of half the length
_POSITIVE = 0.5  # added to the score, so that supported lines never count less than unsupported ones
# Minimum improvement for another direction: 7 % shorter lines, twice as much for directions tried later.
_BETTER, _FINELY_BETTER = 0.002, 0.004
_NEAR = 1e-3  # mm; ends this close to a support count as supported; engines round to 0.01 µm
# Extrusion widths. A narrower strip is filled along its sides: lines across it would leave it half empty.
_NARROW = 4
_STRAND_GAP = 0.05  # mm between bridge lines; touching round strands would push each other aside


class Bridges(Struct, frozen=True, eq=False):
    """A list of bridges.

    Attributes:
        areas: B entries, one per bridge.
        layer: (B,) ascending, layer of each bridge.
        angle: (B,) radians, direction of its lines.
        loose: stack of unsupported areas in which no line is supported at any end.
    """

    areas: Areas
    layer: Int
    angle: Float
    loose: Areas

    def place_on_layers(self) -> tuple[Areas, Float]:
        """Return the bridges as areas on their layers, and for each ring (R,) the direction of its bridge, radians."""
        own, entry = np.arange(self.areas.n_rings), self.areas.ring_layer
        return self.areas.restacked(own, self.layer[entry], self.loose.n_layers), self.angle[entry]

    def unite_areas(self) -> Areas:
        """Return the union of bridges and loose areas, on the layers of the stack."""
        return self.place_on_layers()[0].merge(self.loose)

    def add_scraps(self, scraps: ConnectedAreas, near: Float) -> Bridges:
        """Add each scrap within `near` (L,) mm of bridges to the bridge that overlaps the scrap most."""
        around = offset(self.areas, near[self.layer])
        own, scrap = Boxes(*around.boxes(), self.layer).find_overlapping(
            Boxes(*scraps.areas.boxes(), scraps.layer)
        )
        shared = intersection(around.copy_layers(own), scraps.areas.copy_layers(scrap)).area()
        order = np.lexsort((-shared, scrap))
        order = order[shared[order] > 0]
        order = order[np.diff(scrap[order], prepend=-1) != 0]
        order = order[np.argsort(own[order], kind="stable")]
        taken = scraps.areas.copy_layers(scrap[order])
        rings, bridge = np.arange(taken.n_rings), own[order][taken.ring_layer]
        return replace(self, areas=union(self.areas, taken.restacked(rings, bridge, self.areas.n_layers)))


def strand_diameter(profile: Profile) -> float:
    """Return the diameter of the lines of thick bridges, mm."""
    return profile.printer.nozzle_diameter * float(np.sqrt(profile.quality.bridge_flow_ratio))


def bridge_line_gap(profile: Profile, height: Float) -> Float:
    """Return the usual distance (n,) between the lines of bridges on layers of some heights (n,), mm."""
    if profile.quality.thick_bridges:
        return np.full(len(height), strand_diameter(profile) + _STRAND_GAP)
    return bead.spacing(profile.extrusion_width, height)


def find_bridges(
    unsupported: Areas, limits: Areas, below: Areas, spacing: Float, reach: tuple[Float, Float]
) -> Bridges:
    """Find bridges over unsupported areas, extended along their lines onto the supports.

    Bridges do not grow sideways beyond their outermost lines. Areas that no line can bridge grow to all sides.

    Args:
        unsupported: unsupported areas.
        limits: areas that the bridges must not leave: the unsupported areas, grown onto their supports.
        below: supports below each layer.
        spacing: (L,) mm between lines.
        reach: (L,) mm, length of anchors on the supports, and (L,) radians, usual direction.
    """
    anchor, usual = reach
    pieces = split_connected(limits)
    turn, held = find_bridge_angles(pieces, below, spacing, usual)
    loose = pieces.on_layers(limits.n_layers, np.flatnonzero(~held))
    pieces, turn = pieces.take(np.flatnonzero(held)), turn[held]
    # Add half a line on both sides.
    own = pieces.select_nearby_rings(offset(unsupported, spacing / 2))
    along = sweep_areas(own, anchor[pieces.layer, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1))
    return Bridges(intersection(along, pieces.areas), pieces.layer, turn, loose)


def find_internal_bridges(solid: Areas, below: Areas, width: float | Float, anchor: float | Float) -> Areas:
    """Find the parts of solid areas that lie over internal infill, extended by anchors at the sides.

    Args:
        solid: areas.
        below: internal infill areas of the layer below each.
        width: mm, extrusion width, one or (L,).
        anchor: mm of overlap with the solid infill beside it, one or (L,).
    """
    over = intersection(solid, below)
    if not over.n_rings:
        return over
    # Strips that are two extrusions wide are supported by the solid infill beside them.
    over = intersection(offset(offset_open(over, width), anchor), solid)
    # Remainders too narrow for an extrusion are added.
    beside = offset_open(difference(solid, over), width / 2)
    return intersection(difference(solid, beside), offset(over, width))


def find_bridge_angles(
    pieces: ConnectedAreas, below: Areas, spacing: Float, usual: float | Float
) -> tuple[Float, Bool]:
    """Return the direction (P,) of each bridge's lines, radians, and a mask (P,) of bridges with a supported line.

    Directions 15° apart are tried, then 5° to either side of the best one, then the direction of the longest side. The
    direction with the largest fraction of its length in lines supported at both ends wins; lines supported at one end,
    as on a balcony, count half. Among nearly equal directions, the one whose longest lines are shortest wins, but in a
    narrow strip the direction of the longest side. Bridges without supports get the usual direction.

    Args:
        pieces: unsupported areas, grown onto their supports.
        below: supports below each layer.
        spacing: (L,) mm between lines.
        usual: radians, one or (L,).
    """
    if not pieces.count:
        return np.zeros(0), np.zeros(0, np.bool_)
    support = intersection(offset(pieces.areas, _BESIDE), pieces.select_nearby_rings(below))
    gap = spacing[pieces.layer]
    score = partial(_score_directions, pieces.areas, support, gap)
    best, record = np.broadcast_to(usual, spacing.shape)[pieces.layer], np.zeros(pieces.count)
    # The first of nearly equal directions wins, so directions along the axes of the bed come first.
    whole = sorted(range(_DIRECTIONS), key=lambda turn: (turn % 6 != 0, turn % 3 != 0))
    tried = [(np.full(pieces.count, turn * np.pi / _DIRECTIONS), _BETTER) for turn in whole]
    best, record = _choose_better_directions(score, (best, record), tried)
    best, record = _choose_better_directions(
        score, (best, record), [(best + turn, _FINELY_BETTER) for turn in _FINER]
    )
    needed = np.where(pieces.mean_width() < _NARROW * gap, -_BETTER, _FINELY_BETTER)
    best, record = _choose_better_directions(
        score, (best, record), [(_find_longest_side_directions(pieces.areas), needed)]
    )
    return best, record > 0


def _find_longest_side_directions(areas: Areas) -> Float:
    """Return the direction (P,) of the longest side of each piece, radians."""
    side = areas.xy[areas.following] - areas.xy
    order = np.lexsort((np.hypot(*side.T), areas.point_layer))
    last = order[np.append(np.diff(areas.point_layer[order]) != 0, True)]
    return np.asarray(np.arctan2(side[last, 1], side[last, 0]) % np.pi)


def _choose_better_directions(
    score: Callable[[Float], Float], found: tuple[Float, Float], tried: Sequence[tuple[Float, float | Float]]
) -> tuple[Float, Float]:
    """Try more directions; return the best direction (P,) of each piece so far, and its score (P,).

    Args:
        score: function from directions (P,) to scores (P,).
        found: best directions and scores so far.
        tried: directions (P,) to try, and the least improvement for each.
    """
    best, record = found
    for angle, needed in tried:
        reached = score(angle)
        better = reached > record + needed
        best, record = np.where(better, angle, best), np.where(better, reached, record)
    return best, record


def _score_directions(bridge: Areas, support: Areas, spacing: Float, angle: Float) -> Float:
    """Return a score (P,) for how well lines of one direction are supported in each piece; 0 if none is supported."""
    lines = hatch(bridge, angle=angle, spacing=spacing)
    carried = count_supported_ends(lines, hatch(support, angle=angle, spacing=spacing))
    length, n = lines.length(), bridge.n_layers
    total = np.bincount(lines.layer, weights=length, minlength=n)
    held = np.bincount(lines.layer, weights=length * _WORTH[carried], minlength=n)
    # Long lines sag most, so this mean is dominated by the longest lines. Halving their length counts as much as 2 % of
    # the share.
    less, more = (np.bincount(lines.layer, weights=length**power, minlength=n) for power in (6, 7))
    sagging = np.log2(np.maximum(more, 1e-9) / np.maximum(less, 1e-9))
    return np.where(held > 0, held / np.maximum(total, 1e-9) + _POSITIVE - _SHORTER * sagging, 0.0)


def count_supported_ends(lines: Lines, support: Lines) -> Int:
    """Return the number of ends (S,) of each line that lie on a support line of the same row: 0, 1 or 2."""
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
