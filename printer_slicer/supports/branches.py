"""Draw branches of trees as areas of support layers."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, consecutive, distinct
from printer_slicer.geometry import (
    Areas,
    depths,
    find_enclosing_rings,
    fits_circle,
    normalize,
    offset,
    split_connected,
    union,
)
from printer_slicer.geometry.boxes import Boxes
from printer_slicer.geometry.vectors import norm
from printer_slicer.model import LayerPlan
from printer_slicer.supports.tree_settings import TreeSettings

__all__ = ["draw_branches", "draw_discs", "find_closed_discs", "find_second_loops", "round_notches"]

_FEW_CORNERS, _MANY_CORNERS = 16, 32
_FOOT_RATIO = 6.0  # heights of a branch; low ones need no wide foot
_MAX_BRIDGE = 0.6  # mm of a loop that may be unsupported, measured between points of the outline
_SHARP = np.deg2rad(30.0)  # at sharper corners the nozzle stops
_THICK = 1.5  # mm; circles of a larger radius get many corners


def draw_branches(pieces: Float, height: Float, layers: LayerPlan, settings: TreeSettings) -> Areas:
    """Return the union of all branches in each support layer.

    A branch is a disc in each layer, interpolated between both ends of its piece at half the height of the layer. Near
    the bed it becomes wider, by as much per layer as a loop may protrude from the one below.

    Args:
        pieces: (B, 8) z, x, y and radius of the lower end, then of the upper end of each piece, mm.
        height: (B,) distance from the lower end of each piece up to the highest tip of its branch, mm.
        layers: of the supports.
        settings: of trees.
    """
    middle = (layers.bottom + layers.top) / 2
    first, last = np.searchsorted(middle, pieces[:, 0]), np.searchsorted(middle, pieces[:, 4])
    count = last - first
    piece, layer = np.repeat(np.arange(len(pieces)), count), consecutive(first, count)
    low, high = pieces[piece, :4], pieces[piece, 4:]
    share = (middle[layer] - low[:, 0]) / np.maximum(high[:, 0] - low[:, 0], 1e-9)
    disc = low + share[:, None] * (high - low)
    order = np.argsort(layer, kind="stable")
    disc, layer = disc[order], layer[order]
    foot = np.minimum(settings.foot, height[piece[order]] / _FOOT_RATIO)
    # The lowest layer is as wide as the foot; above it, a branch that also leans must not protrude twice as far.
    widening = np.maximum(foot - disc[:, 0], 0.0) * settings.slope / 2
    radius = disc[:, 3] + np.where(layer == 0, foot, widening)
    return normalize(draw_discs(disc[:, 1:3], radius, layer, layers.n_layers))


def round_notches(base: Areas, radius: float) -> Areas:
    """Return branches with notches between joined discs filled, so that no concave corner is sharper than `radius`, mm.

    At a sharp corner the nozzle stops.
    """
    side = base.xy[base.following] - base.xy
    turn = np.zeros(len(side))
    after = side[base.following]
    turn[base.following] = np.arctan2(
        side[:, 0] * after[:, 1] - side[:, 1] * after[:, 0], (side * after).sum(axis=1)
    )
    notched = np.bincount(base.point_ring, turn < -_SHARP, minlength=base.n_rings) > 0
    pieces = split_connected(base)
    which = np.zeros(pieces.count, np.bool_)
    which[pieces.of_ring[notched & (pieces.of_ring >= 0)]] = True
    sharp, others = (pieces.on_layers(base.n_layers, np.flatnonzero(some)) for some in (which, ~which))
    return union(offset(offset(sharp, radius), -radius, join="round"), others)


def draw_discs(middle: Float, radius: Float, layer: Int, n_layers: int) -> Areas:
    """Return regular polygons around `middle` (n, 2) on layers (n,), ascending; their sides touch the circle."""
    corners = np.where(radius > _THICK, _MANY_CORNERS, _FEW_CORNERS)
    owner = np.repeat(np.arange(len(radius)), corners)
    angle = 2 * np.pi * (consecutive(np.zeros_like(corners), corners) + 0.5) / corners[owner]
    reach = radius[owner] / np.cos(np.pi / corners[owner])
    xy = middle[owner] + reach[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    return Areas(xy, np.append(0, np.cumsum(corners)), layer, n_layers)


def find_closed_discs(hollow: Areas, width: float) -> Areas:
    """Return the pieces of hollow branches that must be closed layers, because a loop above has no loop below.

    That happens where two branches part: the sides that they turn to each other begin over the inside of the branch
    below. A loop is carried where its middle is at most half its width beside that of a loop below. Short stretches are
    bridges.

    Args:
        hollow: branches that are printed as loops.
        width: of the loops, mm.
    """
    middle = offset(hollow, -width / 2)
    layer = middle.point_layer
    above = np.flatnonzero(~_mark_continued_rings(middle, width / 2)[middle.point_ring])
    hanging = np.zeros(len(layer), np.bool_)
    hanging[above] = np.isnan(depths(middle, middle.xy[above], layer[above] - 1, width / 2))
    following = middle.following
    side = norm(middle.xy[following] - middle.xy) * (hanging & hanging[following])
    length = np.bincount(middle.point_ring, side, minlength=middle.n_rings)
    over = np.flatnonzero(hanging & (length > _MAX_BRIDGE)[middle.point_ring])
    pieces = split_connected(hollow)
    ring = find_enclosing_rings(hollow, middle.xy[over], layer[over] - 1)
    return pieces.on_layers(hollow.n_layers, distinct(pieces.of_ring[ring[ring >= 0]]))


def find_second_loops(hollow: Areas, inset: Float, width: float) -> Areas:
    """Return the second loops of thick branches, which begin on the bed.

    Where branches join, their union is thicker than the branch below it. A loop there would begin with nothing below.

    Args:
        hollow: branches that are printed as loops.
        inset: (S,) distance of second loops from the outline, by layer, mm.
        width: of the loops, mm.
    """
    pieces = split_connected(hollow)
    is_thick = fits_circle(pieces.areas, _THICK)
    loops = offset(pieces.on_layers(hollow.n_layers, np.flatnonzero(is_thick)), -inset)
    begins = loops.ring_layer == 0
    ring, below = _find_continued_rings(loops, width / 2)
    order = np.argsort(loops.ring_layer[ring], kind="stable")
    ring, below = ring[order], below[order]
    cuts = np.flatnonzero(np.diff(loops.ring_layer[ring])) + 1
    for some in np.split(np.arange(len(ring)), cuts):
        begins[ring[some[begins[below[some]]]]] = True
    return loops.select(begins)


def _find_continued_rings(rings: Areas, most: float) -> tuple[Int, Int]:
    """Return pairs of a ring and one below it whose boxes differ by at most `most` mm at each side.

    Most rings continue a tube. This takes much less time than to compare all their points.
    """
    boxes = Boxes.of_rings(rings)
    one, below = boxes.find_overlapping(Boxes(boxes.low, boxes.high, boxes.layer + 1))
    change = np.maximum(
        np.abs(boxes.low[one] - boxes.low[below]), np.abs(boxes.high[one] - boxes.high[below])
    )
    same = change.max(axis=1) <= most
    return one[same], below[same]


def _mark_continued_rings(rings: Areas, most: float) -> Bool:
    """Return a mask (R,) of rings that continue one below, see `_find_continued_rings`, or lie in the lowest layer."""
    result = rings.ring_layer == 0
    result[_find_continued_rings(rings, most)[0]] = True
    return np.asarray(result)
