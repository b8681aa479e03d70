"""Find supports that are hard to remove, and supports that may fall over because they are slim."""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.arrays import Float, Int, distinct
from printer_slicer.geometry import Areas, find_enclosing_rings, normalize, split_connected
from printer_slicer.geometry.connectivity import label_components
from printer_slicer.model import Sections, Supports
from printer_slicer.values import Struct

__all__ = ["Grip", "SlimPiece", "find_grips", "find_slim_pieces"]

_MAX_SLIMNESS: Final = 15.0  # height by the square root of the area on the bed
_MIN_HEIGHT: Final = 3.0  # mm; lower pieces hardly fall over
_ROUNDING: Final = 1e-6  # mm


class Grip(Struct, frozen=True):
    """A closed ring of supports around the part, which must be broken to remove it.

    Attributes:
        x, y: a point of the part inside the ring, mm.
        low, high: heights between which the ring is closed, mm.
    """

    x: float
    y: float
    low: float
    high: float


class SlimPiece(Struct, frozen=True):
    """A piece of supports that is high for its foot on the bed.

    Attributes:
        x, y: middle of the foot, mm.
        height: mm.
        foot: area on the bed, mm².
    """

    x: float
    y: float
    height: float
    foot: float

    @property
    def slimness(self) -> float:
        """Height by the square root of the area on the bed."""
        return float(self.height / np.sqrt(self.foot))


def find_grips(supports: Supports, sections: Sections) -> tuple[Grip, ...]:
    """Find closed rings of supports that have a piece of the part inside in two or more layers, from the lowest.

    Args:
        supports: areas by support layer.
        sections: the part.
    """
    layers, base = supports.plan.layers, supports.base
    holes = base.select(base.ring_area() < 0)
    used = np.flatnonzero(holes.used)
    middle = (layers.bottom + layers.top)[used] / 2
    part = np.searchsorted(sections.plan.top, middle - _ROUNDING)
    used, part = used[part < sections.plan.n_layers], part[part < sections.plan.n_layers]
    solid = sections.solid.copy_layers(part)
    outer = np.flatnonzero(solid.ring_area() > 0)
    points, layer = solid.xy[solid.ring_start[:-1][outer]], used[solid.ring_layer[outer]]
    ring = find_enclosing_rings(holes, points, layer)
    inside = np.flatnonzero(ring >= 0)
    if not len(inside):
        return ()
    group = _group_rings(holes, ring[inside])
    found = []
    for number in range(int(group.max()) + 1):
        own = inside[group == number]
        steps = distinct(layer[own])
        if len(steps) > 1:
            x, y = points[own[0]].tolist()
            found.append(Grip(x, y, float(layers.bottom[steps[0]]), float(layers.top[steps[-1]])))
    return tuple(sorted(found, key=lambda grip: (grip.low, grip.x, grip.y)))


def _group_rings(holes: Areas, rings: Int) -> Int:
    """Return the group (n,) of each of some holes: those that lie over each other in neighbouring layers."""
    low, high = _ring_boxes(holes)
    layer, links = holes.ring_layer, []
    chosen = distinct(rings)
    for step in (0, 1):
        for one in chosen.tolist():
            near = chosen[(layer[chosen] == layer[one] + step)]
            touches = (low[near] <= high[one]).all(axis=1) & (high[near] >= low[one]).all(axis=1)
            links.append(np.stack([np.full(int(touches.sum()), one), near[touches]]))
    label = label_components(np.concatenate(links, axis=1), holes.n_rings)
    return np.unique(label[rings], return_inverse=True)[1].reshape(-1)


def _ring_boxes(areas: Areas) -> tuple[Float, Float]:
    """Return the lowest and the highest corner (R, 2) of each ring."""
    start = areas.ring_start[:-1]
    return np.minimum.reduceat(areas.xy, start), np.maximum.reduceat(areas.xy, start)


def find_slim_pieces(supports: Supports) -> tuple[SlimPiece, ...]:
    """Find pieces of supports on the bed that are higher than 3 mm and than 15 times the square root of their foot."""
    feet = split_connected(normalize(supports.area.of_layers(np.arange(1))))
    if not feet.count:
        return ()
    if len(supports.branches):
        points, top = _find_branch_tops(supports.branches)
    else:
        areas = supports.area
        points, top = areas.xy[areas.ring_start[:-1]], supports.plan.layers.top[areas.ring_layer]
    foot = feet.areas.on_layers(np.zeros(feet.count, np.int64), 1)
    ring = find_enclosing_rings(foot, points, np.zeros(len(points), np.int64))
    owner = np.append(feet.areas.ring_layer, -1)[ring]
    height = np.zeros(feet.count)
    np.maximum.at(height, owner[owner >= 0], top[owner >= 0])
    area, (low, high) = (
        np.maximum(feet.areas.area(), 0.0),
        feet.areas.boxes(),
    )  # rests of outlines may turn inward
    slim = np.flatnonzero((height > _MIN_HEIGHT) & (height > _MAX_SLIMNESS * np.sqrt(area)) & (area > 0))
    middle = (low + high) / 2
    return tuple(
        SlimPiece(float(middle[i, 0]), float(middle[i, 1]), float(height[i]), float(area[i])) for i in slim
    )


def _find_branch_tops(branches: Float) -> tuple[Float, Float]:
    """Return the ends of trees on the bed (n, 2), mm, and the height (n,) of the highest branch of each tree."""
    ends = np.round(np.concatenate([branches[:, :3], branches[:, 4:7]]), 6)
    _, node = np.unique(ends, axis=0, return_inverse=True)
    node = node.reshape(-1)
    n = len(branches)
    tree = label_components(np.stack([node[:n], node[n:]]), int(node.max()) + 1)[node[:n]]
    top = np.zeros(int(tree.max()) + 1)
    np.maximum.at(top, tree, branches[:, 4])
    on_bed = np.flatnonzero(branches[:, 0] <= _ROUNDING)
    return branches[on_bed, 1:3], top[tree[on_bed]]
