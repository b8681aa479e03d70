"""Choose which branches approach each other, and merge those that meet."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, concatenate_pairs, consecutive, run_starts
from printer_slicer.geometry.boxes import Boxes
from printer_slicer.geometry.vectors import norm
from printer_slicer.supports.reach_fields import ReachFields
from printer_slicer.supports.tree_settings import TreeSettings
from printer_slicer.values import Struct, replace

__all__ = ["LiveBranches", "choose_goals", "encloses_part", "join_branches", "match_nearest"]

_PARTNERS = 3  # nearest branches that are considered
_FARTHER = 1.5  # times the distance of the nearest branch, at which a partner may be
_SAMPLES = 9  # along and down the triangle between two branches
_ROUNDING = 1e-5  # mm


class LiveBranches(Struct, frozen=True, eq=False):
    """Branches that arrive at a level, all (n,) unless said otherwise.

    Attributes:
        node: the node above.
        cell: where they arrive.
        radius: there, mm.
        to_bed: whether the branch may stand on the bed only.
        reach: how far the node above may be away sideways, mm; 0: the cell is fixed.
        head: (n, 3) a tip of the branch, mm.
        drift: (n, 2) from the middle of the cell to where the branch was to go, mm; the next move makes up for it.
    """

    node: Int
    cell: Int
    radius: Float
    to_bed: Bool
    reach: Float
    head: Float
    drift: Float

    def take(self, which: Int | Bool) -> LiveBranches:
        """Return some of the branches."""
        return LiveBranches(*(getattr(self, name)[which] for name in self.__struct_fields__))


def choose_goals(live: LiveBranches, level: int, fields: ReachFields, settings: TreeSettings) -> Float:
    """Return the place (n, 2) to which each branch should go next, mm; nan: no branch to merge with.

    The partner is the nearest other branch to the same kind of end that can be met before the end, each going half the
    way at the slow slope, without closing a ring around the part.
    """
    here = fields.grid.find_middles(live.cell)
    result = np.full_like(here, np.nan)
    height = _estimate_height(live, level, fields, settings)
    own, other = _find_nearest(here, live.to_bed, 2 * settings.slow_slope * float(height.max()))
    gap = norm(here[other] - here[own])
    meets = gap / 2 < np.minimum(height[own], height[other]) * settings.slow_slope
    own, other, gap = own[meets], other[meets], gap[meets]
    rank = consecutive(
        np.zeros(int(run_starts(own).sum()), np.int64),
        np.diff(np.append(np.flatnonzero(run_starts(own)), len(own))),
    )
    some = rank < _PARTNERS
    own, other, gap = own[some], other[some], gap[some]
    z = level * fields.slab - gap / 2 / settings.slow_slope
    meeting = np.column_stack([(here[own] + here[other]) / 2, z])
    free = ~encloses_part(live.head[own], live.head[other], meeting, fields)
    own, other, gap = own[free], other[free], gap[free]
    first = run_starts(own)
    mate = match_nearest(own, other, gap, len(here))
    # Branches that are left over follow the pair of their nearest one.
    meeting = np.where((mate >= 0)[:, None], (here + here[mate]) / 2, here)
    goal = meeting.copy()
    left = first & (mate[own] < 0)
    goal[own[left]] = meeting[other[left]]
    led = np.flatnonzero((mate >= 0) | np.isin(np.arange(len(here)), own))
    way = goal[led] - here[led]
    length = norm(way)
    step = np.minimum(length, settings.slow_slope * fields.slab) / np.maximum(length, 1e-9)
    result[led] = here[led] + step[:, None] * way
    return result


def match_nearest(one: Int, other: Int, gap: Float, n: int) -> Int:
    """Return the partner (n,) of each branch, the nearest pairs first; -1 for those left over.

    A partner is at most 1.5 times as far away as the nearest other branch.

    Args:
        one: (P,) branches that may meet others.
        other: (P,) the branch that each may meet.
        gap: (P,) between them, mm.
        n: number of branches.
    """
    mate, nearest = np.full(n, -1), np.full(n, np.inf)
    for side in (one, other):
        np.minimum.at(nearest, side, gap)
    close = gap <= _FARTHER * np.minimum(nearest[one], nearest[other])
    one, other, gap = one[close], other[close], gap[close]
    order = np.lexsort((np.maximum(one, other), np.minimum(one, other), np.round(gap, 6)))
    one, other = one[order], other[order]
    while len(one):
        rank = np.arange(len(one))
        first = np.full(n, len(one))
        np.minimum.at(first, one, rank)
        np.minimum.at(first, other, rank)
        kept = (first[one] == rank) & (first[other] == rank)
        mate[one[kept]], mate[other[kept]] = other[kept], one[kept]
        rest = (mate[one] < 0) & (mate[other] < 0)
        one, other = one[rest], other[rest]
    return mate


def _estimate_height(live: LiveBranches, level: int, fields: ReachFields, settings: TreeSettings) -> Float:
    """Estimate the height (n,) of each branch above its lower end, mm."""
    z = level * fields.slab
    left = fields.to_any.price[level].ravel()[live.cell].astype(np.float64) - settings.scar_price
    return np.where(live.to_bed, z, np.clip(left, 0.0, z))


def _find_nearest(points: Float, group: Bool, most: float) -> tuple[Int, Int]:
    """Return pairs of a point and one of the nearest others of its group, ordered by point and distance.

    The search begins close by and goes on, for points without any, in boxes of twice the size, up to `most` mm.
    """
    n = len(points)
    all_boxes = Boxes(points, points, group.astype(np.int64))
    found, lacking = list[tuple[Int, Int]](), np.arange(n)
    extent = float(np.prod(np.maximum(np.ptp(points, axis=0), 1.0)))
    reach = 2.0 * float(np.sqrt(extent / n))
    while len(lacking):
        boxes = Boxes(points[lacking], points[lacking], group[lacking].astype(np.int64)).expand(reach)
        own, other = boxes.find_overlapping(all_boxes)
        own = lacking[own]
        differs = own != other
        found.append((own[differs], other[differs]))
        if reach >= most:
            break
        seen = np.zeros(n, np.bool_)
        seen[found[-1][0]] = True
        lacking, reach = lacking[~seen[lacking]], 2 * reach
    own, other = concatenate_pairs(found)
    order = np.lexsort((other, norm(points[other] - points[own]), own))
    return own[order], other[order]


def encloses_part(one: Float, other: Float, meeting: Float, fields: ReachFields) -> Bool:
    """Return a mask (n,) of pairs of branches that would close a ring around the part if they met.

    The triangle between the tips of both (n, 3) and the place where they meet (n, 3) is sampled from the edge between
    the tips downwards. Part that begins at that edge hangs from above; part that begins below it would be enclosed.
    """
    result = np.zeros(len(one), np.bool_)
    if not len(one):
        return result
    share = np.arange(_SAMPLES) / (_SAMPLES - 1)
    edge = one[:, None] + share[:, None] * (other - one)[:, None]
    web = edge[:, :, None] + share[:, None] * (meeting[:, None, None] - edge[:, :, None])
    flat = web.reshape(-1, 3)
    cell = fields.grid.find_cells(flat[:, :2])
    solid = fields.solid.reshape(fields.n_levels, -1)[fields.find_levels(flat[:, 2]), cell].reshape(
        web.shape[:-1]
    )
    # Near the tips, the raster cannot tell what is beside the overhang from what is under it.
    low = web[..., 2] < (np.minimum(one[:, 2], other[:, 2]) - fields.slab)[:, None, None]
    was_free = np.maximum.accumulate(~solid & low, axis=2)
    return np.asarray((solid[..., 1:] & was_free[..., :-1]).any(axis=(1, 2)))


def join_branches(
    live: LiveBranches, above: Float, level: int, fields: ReachFields, settings: TreeSettings
) -> tuple[Int, LiveBranches]:
    """Join branches that are closer than half the thicker radius, or in neighbouring cells.

    Args:
        live: branches arriving at a level.
        above: (n, 2) where each comes from, mm.
        level: of them.
        fields: where branches can go.
        settings: of trees.

    Returns:
        The joined branch (n,) of each, and the joined branches; their nodes are those of one of each.
    """
    group, joined = np.arange(len(live.node)), live
    while True:
        pairs = _find_pairs(joined, fields)
        one, other, cell = _keep_possible(pairs, (joined, group), (live, above), level, fields)
        if not len(one):
            return group, joined
        number = np.arange(len(joined.node))
        number[other] = one
        thick, thin = (
            np.maximum(joined.radius[one], joined.radius[other]),
            np.minimum(joined.radius[one], joined.radius[other]),
        )
        radius, cells, head = joined.radius.copy(), joined.cell.copy(), joined.head.copy()
        most = _room(joined.take(one), cell, level, fields)
        radius[one] = np.maximum(
            np.minimum(np.hypot(thick, thin / 2), np.minimum(most, settings.largest_radius)), thick
        )
        cells[one] = cell
        head[one] = np.where(
            (joined.radius[one] >= joined.radius[other])[:, None], joined.head[one], joined.head[other]
        )
        kept = np.flatnonzero(number == np.arange(len(number)))
        place = np.full(len(number), -1)
        place[kept] = np.arange(len(kept))
        group = place[number[group]]
        joined = replace(joined, radius=radius, cell=cells, head=head).take(kept)


def _room(live: LiveBranches, cell: Int, level: int, fields: ReachFields) -> Float:
    """Return the radius (n,) of the thickest branch at a cell (n,) on its way to the same kind of end, mm."""
    bed, part = (ways.radius[level].ravel()[cell] for ways in (fields.to_bed, fields.to_any))
    return np.asarray(np.where(live.to_bed, bed, part), np.float64)


def _find_pairs(live: LiveBranches, fields: ReachFields) -> tuple[Int, Int]:
    """Return pairs (P,), (P,) of branches that are close enough to become one; the nearest first."""
    here, cell = fields.grid.find_middles(live.cell), fields.grid.cell
    reach = np.maximum(live.radius / 2, 1.5 * cell) + _ROUNDING
    one, other = Boxes(here, here, live.to_bed.astype(np.int64)).expand(reach / 2 + cell).find_neighbours()
    gap = norm(here[one] - here[other])
    near = gap <= np.maximum(reach[one], reach[other])
    one, other = np.minimum(one, other)[near], np.maximum(one, other)[near]
    order = np.lexsort((other, one, np.round(gap[near], 6)))
    return one[order], other[order]


def _keep_possible(
    pairs: tuple[Int, Int],
    groups: tuple[LiveBranches, Int],
    members: tuple[LiveBranches, Float],
    level: int,
    fields: ReachFields,
) -> tuple[Int, Int, Int]:
    """Return the pairs (P,), (P,) that can become one now, and the cell (P,) of each; no branch is in two pairs.

    All branches that were joined before must be able to reach the cell from the level above.
    """
    (one, other), (joined, group), (live, above) = pairs, groups, members
    room = [_room(joined.take(which), joined.cell[which], level, fields) for which in (one, other)]
    cell = np.where(room[0] >= room[1], joined.cell[one], joined.cell[other])
    fits = np.maximum(*room) >= np.maximum(joined.radius[one], joined.radius[other]) - _ROUNDING
    clear = (
        fields.clear[level].ravel()[cell] >= np.maximum(joined.radius[one], joined.radius[other]) - _ROUNDING
    )
    still = joined.cell[one] == joined.cell[other]
    fits &= clear | still
    order = np.argsort(group, kind="stable")
    count = np.bincount(group, minlength=len(joined.node))
    first = np.cumsum(count) - count
    for which in (one, other):
        pair = np.repeat(np.arange(len(which)), count[which])
        member = order[consecutive(first[which], count[which])]
        away = norm(fields.grid.find_middles(cell[pair]) - above[member])
        reached = (away <= live.reach[member]) | (cell[pair] == live.cell[member])
        fits[pair[~reached]] = False
    meeting = np.column_stack([fields.grid.find_middles(cell), np.full(len(cell), level * fields.slab)])
    fits[fits] = ~encloses_part(joined.head[one[fits]], joined.head[other[fits]], meeting[fits], fields)
    one, other, cell = one[fits], other[fits], cell[fits]
    return _take_once(one, other, cell, len(joined.node))


def _take_once(one: Int, other: Int, cell: Int, n: int) -> tuple[Int, Int, Int]:
    """Return the pairs, which are sorted, that are the first one of both their branches."""
    rank = np.arange(len(one))
    first = np.full(n, len(one))
    np.minimum.at(first, one, rank)
    np.minimum.at(first, other, rank)
    kept = (first[one] == rank) & (first[other] == rank)
    return one[kept], other[kept], cell[kept]
