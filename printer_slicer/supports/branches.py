"""Draw branches of trees as areas of all support layers."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Float, Int, consecutive
from printer_slicer.geometry import Areas, difference, intersection, normalize, offset, split_connected, union
from printer_slicer.model import LayerPlan
from printer_slicer.supports.tree_settings import TreeSettings

__all__ = ["draw_branches", "find_closed_discs"]

_FEW_CORNERS, _MANY_CORNERS = 16, 32
_FOOT_RATIO = 6.0  # heights of a branch; low ones need no wide foot
_LONGEST_BRIDGE = 0.9  # mm of a loop that may hang between two places on the loop below
_HAIR = 0.05  # mm; half the width of the strip that stands for the middle of a loop
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
    return normalize(_draw_discs(disc[:, 1:3], radius, layer, layers.n_layers))


def _draw_discs(middle: Float, radius: Float, layer: Int, n_layers: int) -> Areas:
    """Return regular polygons around `middle` (n, 2) on layers (n,), ascending; their sides touch the circle."""
    corners = np.where(radius > _THICK, _MANY_CORNERS, _FEW_CORNERS)
    owner = np.repeat(np.arange(len(radius)), corners)
    angle = 2 * np.pi * (consecutive(np.zeros_like(corners), corners) + 0.5) / corners[owner]
    reach = radius[owner] / np.cos(np.pi / corners[owner])
    xy = middle[owner] + reach[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    return Areas(xy, np.append(0, np.cumsum(corners)), layer, n_layers)


def find_closed_discs(hollow: Areas, others: Areas, width: float) -> Areas:
    """Return the pieces of hollow branches that must be closed layers, because a loop above has no loop below.

    That happens where two branches part: the sides that they turn to each other begin over the inside of the branch
    below. A loop is carried where its middle lies over plastic, thus by half its width; short stretches are bridges.

    Args:
        hollow: branches that are printed as loops.
        others: what else is printed.
        width: of the loops, mm.
    """
    middle = offset(hollow, -width / 2)
    strips = difference(offset(middle, _HAIR), offset(middle, -_HAIR)).of_layers(
        np.arange(1, hollow.n_layers)
    )
    loops = difference(hollow, offset(hollow, -width))
    hanging = split_connected(difference(strips, union(loops, others).shift_layers(1)))
    long = np.flatnonzero(hanging.areas.area() > 2 * _HAIR * _LONGEST_BRIDGE)
    above = hanging.on_layers(hollow.n_layers, long).shift_layers(-1)
    pieces = split_connected(hollow)
    under = intersection(pieces.areas, pieces.select_nearby_rings(above)).area() > 0
    return pieces.on_layers(hollow.n_layers, np.flatnonzero(under))
