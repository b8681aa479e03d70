"""The first segment of each branch: from its tip to a level below the slab that holds the overhang.

The slabs around the tip hold the overhang itself, so the raster says nothing about them. Here the sections are
compared with the segment itself.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.geometry import depths
from printer_slicer.geometry.vectors import norm
from printer_slicer.model import Sections
from printer_slicer.supports.reach_fields import CellMoves, ReachFields
from printer_slicer.supports.tree_settings import TreeSettings
from printer_slicer.values import Struct

__all__ = ["FirstSegments", "choose_first_segments", "grow_radius"]

_TIP_LENGTH = 2.0  # mm over which a tip grows to a branch
_MAX_CHOICES = 24  # places that are compared for each tip, the cheapest ones
_SAMPLES = (np.arange(12) + 1) / 12  # from the tip down
_BEND_PRICE = 10.0  # mm of branch for each mm by which the part is too near, mean of the samples
_NEAREST_RATIO = 1.1  # of the gap beside the part; nearer to it, too little of the branch would remain


class FirstSegments(Struct, frozen=True, eq=False):
    """Lower ends of the first segments of branches.

    Attributes:
        level: (T,) level of the lower end; -1: no branch reaches the tip.
        cell: (T,) cell on that level.
        place: (T, 2) place in it, mm; on the bed it need not be the middle of the cell.
        radius: (T,) radius there, mm.
        to_bed: (T,) whether the branch goes on to the bed; else it may stand on the part.
    """

    level: Int
    cell: Int
    place: Float
    radius: Float
    to_bed: Bool

    @classmethod
    def joined(cls, parts: Sequence[FirstSegments]) -> FirstSegments:
        """Return the starts of several values, one after the other."""
        return cls(
            *(np.concatenate([getattr(part, name) for part in parts]) for name in cls.__struct_fields__)
        )

    @property
    def found(self) -> Bool:
        """Mask (T,) of tips that a branch reaches."""
        return self.level >= 0


def grow_radius(radius: Float, height: Float | float, settings: TreeSettings) -> Float:
    """Return the radius (n,) that branches of this radius (n,) should have `height` mm farther down."""
    quick = (settings.branch_radius - settings.tip_radius) / _TIP_LENGTH
    left = np.maximum(settings.branch_radius - radius, 0.0)
    soon = np.minimum(left, quick * height)
    slow = settings.growth * np.maximum(height - soon / max(quick, 1e-9), 0.0)
    return np.minimum(radius + soon + slow, np.maximum(settings.largest_radius, radius))


def choose_first_segments(
    tips: Float, fields: ReachFields, sections: Sections, settings: TreeSettings
) -> FirstSegments:
    """Choose the lower end of the first segment of each branch.

    Args:
        tips: (T, 3) mm, the upper ends.
        fields: where branches can go.
        sections: the part.
        settings: of trees.
    """
    n = len(tips)
    level, place = np.full(n, -1), np.zeros((n, 2))
    slab = fields.find_levels(tips[:, 2])
    for lower in (1, 0, 2):
        left = np.flatnonzero((level < 0) & (slab >= min(lower, 1)) | (level < 0) & (lower == 1))
        at = np.maximum(slab[left] - lower, 0)
        best, cost = _find_best_ends(tips[left], at, fields, sections, settings)
        found = np.isfinite(cost)
        level[left[found]], place[left[found]] = at[found], best[found]
    cell = fields.grid.find_cells(place)
    aside = norm(tips[:, :2] - place)
    height = tips[:, 2] - level * fields.slab
    any_price, bed_price = (
        ways.price.reshape(fields.n_levels, -1)[level, cell] for ways in (fields.to_any, fields.to_bed)
    )
    to_bed = bed_price <= any_price
    most = np.where(
        to_bed,
        *(ways.radius.reshape(fields.n_levels, -1)[level, cell] for ways in (fields.to_bed, fields.to_any)),
    )
    thin = np.full(n, settings.tip_radius)
    radius = np.minimum(grow_radius(thin, height, settings), thin + settings.slope * height - aside)
    return FirstSegments(level, cell, place, np.maximum(np.minimum(radius, most), thin), to_bed)


def _find_best_ends(
    tips: Float, level: Int, fields: ReachFields, sections: Sections, settings: TreeSettings
) -> tuple[Float, Float]:
    """Return the best place (T, 2) on the level (T,) for the end of each piece, mm, and its cost (T,); inf: none."""
    if not len(tips):
        return np.zeros((0, 2)), np.zeros(0)
    grid, height = fields.grid, (tips[:, 2] - level * fields.slab)[:, None]
    moves = CellMoves.within(float(height.max() * settings.slope) + grid.cell, fields.slab, grid.cell)
    cell, inside = grid.find_moved_cells(grid.find_cells(tips[:, :2]), moves.step)
    way = grid.find_middles(cell) - tips[:, None, :2]
    aside, most = norm(way), settings.slope * height
    # Only on the bed need a branch not stand in the middle of a cell.
    on_bed = (level == 0)[:, None]
    way *= np.where(on_bed & (aside > most), most / np.maximum(aside, 1e-9), 1.0)[..., None]
    price = fields.to_any.price.reshape(fields.n_levels, -1)[level[:, None], cell]
    possible = inside & (on_bed | (aside <= most))
    cost = np.where(possible, price + np.hypot(np.minimum(aside, most), height), np.inf)
    order = np.argsort(cost, axis=1, kind="stable")[:, :_MAX_CHOICES]
    own = np.arange(len(tips))[:, None]
    place, cost = tips[:, None, :2] + way[own, order], cost[own, order]
    which, choice = np.nonzero(np.isfinite(cost))
    ends = np.column_stack([place[which, choice], level[which] * fields.slab])
    cost[which, choice] += _compute_segment_costs(tips[which], ends, fields, sections, settings)
    best = np.argmin(cost, axis=1)
    return place[own[:, 0], best], cost[own[:, 0], best]


def _compute_segment_costs(
    tips: Float, ends: Float, fields: ReachFields, sections: Sections, settings: TreeSettings
) -> Float:
    """Return the price (n,) of pieces from tips to ends (n, 3) for coming too near to the part; inf: they touch it."""
    points = (tips[:, None] + _SAMPLES[:, None] * (ends - tips)[:, None]).reshape(-1, 3)
    reach = settings.xy_gap + settings.tip_radius
    layer = np.minimum(np.searchsorted(sections.plan.top, points[:, 2] + 1e-6), sections.plan.n_layers - 1)
    distance = -depths(sections.solid, points[:, :2], layer, reach)
    far = np.isnan(distance)
    inside = fields.solid.reshape(fields.n_levels, -1)[
        fields.find_levels(points[:, 2]), fields.grid.find_cells(points[:, :2])
    ]
    distance[far] = reach
    # The raster also marks cells under the overhang in its own slab. Only points far from outlines count as inside.
    lost = far & inside & _is_solid_there(sections, points, layer, far & inside)
    touches = lost | (distance < _NEAREST_RATIO * settings.xy_gap)
    short = np.where(touches, np.inf, np.clip(reach - distance, 0.0, None))
    return np.asarray(_BEND_PRICE * short.reshape(len(tips), len(_SAMPLES)).mean(axis=1))


def _is_solid_there(sections: Sections, points: Float, layer: Int, which: Bool) -> Bool:
    """Return a mask (n,) of the points `which` (n,) that lie in the section of their layer (n,)."""
    from printer_slicer.geometry import contain_points  # noqa: PLC0415

    result = np.zeros(len(points), np.bool_)
    some = np.flatnonzero(which)
    if len(some):
        result[some] = contain_points(sections.solid, points[some, :2], layer[some])
    return result
