"""Trees that hold up only what needs holding: roofs, and floors inside; everything else stays hollow.

From the top down: under what has air above its sparse infill, trees grow from the walls until no place is far from
a branch; on each layer below, their tips are shorter and their bends straighter, as far as a line may lean out over
the one below. So every branch stands on a branch, on a wall or on something solid, and none is there for nothing.

Source: Tricard, Claux & Lefebvre, Ribbed support vaults for 3D printing of hollowed objects, 2019, for the idea that
what holds a roof may shrink from layer to layer; trees instead of ribs as in the slicer Cura's infill of this name.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, consecutive, run_starts
from printer_slicer.geometry import (
    Areas,
    Polylines,
    clip_lines,
    difference,
    hatch,
    intersection,
    offset,
    union,
)
from printer_slicer.geometry.joints import chain_ends, chain_steps
from printer_slicer.infill.task import Pattern, Task
from printer_slicer.infill.trees import AT_WALL, Tree, Wall, grown, retracted, rooted, within

__all__ = ["lightning_lines", "planted"]

_AROUND = 0.5  # spacings: so far around an internal bridge its threads find something to end on
_HELD = 0.5  # spacings: who is nearer to a branch or wall is held
_LEVELS = 6  # of points: each level has twice the distance of the one below
_BEYOND = 0.02  # mm by which roots are prolonged, so that they surely meet the outline


def lightning_lines(task: Task) -> tuple[Polylines, Float]:
    """Branches of the trees; the density is that right below a large roof."""
    return planted(task)(task)


def planted(task: Task) -> Pattern:
    """The same with trees that have grown for good, in the regions of this task: they are not grown again."""
    return partial(_standing, _branches(_trees(task, offset(task.regions.sparse, -task.inset))))


def _standing(branches: Polylines, task: Task) -> tuple[Polylines, Float]:
    """The branches in the areas of a task."""
    # Entries that are filled by beads of several layers have the trees of the layer on which they are printed.
    first, last = (np.searchsorted(branches.layer, task.layer, side=side) for side in ("left", "right"))
    counts = np.where(task.area.used, last - first, 0)
    chosen = consecutive(first, counts)
    points = consecutive(branches.start[chosen], branches.size[chosen])
    laid = Polylines.of(branches.xy[points], branches.size[chosen], np.repeat(np.arange(len(counts)), counts))
    return clip_lines(task.area, laid), np.ones(len(task.z))


def _trees(task: Task, area: Areas) -> list[Tree]:
    """The trees of each layer."""
    n, plan = area.n_layers, task.regions.plan
    points, layer, level = _roof_points(task, area)
    point_start = np.searchsorted(layer, np.arange(n + 1))
    around = offset(area, AT_WALL / 2)
    layers, around_layers = area.layer_start, around.layer_start
    trees, tree = [Tree.none()] * n, Tree.none()
    for k in range(n - 1, -1, -1):
        below = _one_layer(area, layers, k)
        if not below.n_rings:
            tree = Tree.none()
            continue
        wall = Wall(below)
        if len(tree.xy):
            reach = task.slope * float(plan.height[k + 1])
            tree = within(retracted(tree, reach), _one_layer(around, around_layers, k))
            tree = rooted(tree, wall, reach)
        here = slice(point_start[k], point_start[k + 1])
        tree = grown(tree, wall, points[here], level[here], _HELD * task.spacing)
        trees[k] = tree
    return trees


def _roof_points(task: Task, area: Areas) -> tuple[Float, Int, Int]:
    """Points (P, 2) of a square lattice under everything that is not sparse on the layer above.

    By ascending layer, with the layer and the level of each. Levels are those of both coordinates together, in the
    order in which they are to be held.
    """
    step = task.spacing / 2
    above = difference(area, area.raised(-1))
    ends = offset(task.regions.internal_bridge.raised(-1), _AROUND * task.spacing)
    rows = hatch(union(above, intersection(ends, area)), angle=task.angle, spacing=step)
    first = np.ceil(rows.u[:, 0] / step).astype(np.int64)
    count = np.maximum(np.floor(rows.u[:, 1] / step).astype(np.int64) - first + 1, 0)
    column, owner = consecutive(first, count), np.repeat(np.arange(rows.n_lines), count)
    row = rows.row[owner]
    cos, sin = np.cos(task.angle), np.sin(task.angle)
    u, v = column * step, row * step
    points = np.stack([u * cos - v * sin, u * sin + v * cos], axis=1)
    both = np.column_stack([column, row])
    halvings = np.zeros(len(points), np.int64)
    for halved in range(_LEVELS):
        even = (both % 2 == 0).all(axis=1) & (halvings == halved)
        halvings[even] += 1
        both[even] //= 2
    odd = both % 2
    # Of one level those odd along, those odd across and those odd in both, one after the other.
    return points, rows.layer[owner], 4 * halvings + 3 - (odd[:, 0] + 2 * odd[:, 1])


def _one_layer(areas: Areas, layer_start: Int, layer: int) -> Areas:
    """The area of one layer as a stack of one."""
    first, last = int(layer_start[layer]), int(layer_start[layer + 1])
    begin, end = int(areas.ring_start[first]), int(areas.ring_start[last])
    rings = areas.ring_start[first : last + 1] - begin
    return Areas(areas.xy[begin:end], rings, np.zeros(last - first, np.int64), 1)


def _branches(trees: list[Tree]) -> Polylines:
    """All trees as lines: from each tip along the longest way to the wall, or to where a longer one passes."""
    before = np.cumsum([0, *(len(tree.xy) for tree in trees)])
    xy = np.concatenate([tree.xy for tree in trees])
    parent = np.concatenate(
        [np.where(t.parent >= 0, t.parent + at, -1) for t, at in zip(trees, before[:-1], strict=True)]
    )
    layer = np.repeat(np.arange(len(trees)), np.diff(before))
    if not len(xy):
        return Polylines.of(xy, np.zeros(0, np.int64), layer)
    depth, heir = _heirs(xy, parent)
    tip = chain_ends(np.where(heir >= 0, heir, np.arange(len(heir))))
    order = np.lexsort((-depth, tip))
    head = run_starts(tip[order])
    last = order[np.append(head[1:], True)]
    joint = np.where(parent[last] >= 0, parent[last], last)
    size = np.diff(np.append(np.flatnonzero(head), len(order)))
    beyond = _prolonged(xy, parent, last, order, head)
    index = np.insert(order, np.cumsum(size), joint)
    made = xy[index]
    made[np.cumsum(size + 1) - 1] = beyond
    lines = Polylines.of(made, size + 1, layer[last])
    return lines.take(np.flatnonzero(lines.length() > 2 * _BEYOND))


def _heirs(xy: Float, parent: Int) -> tuple[Int, Int]:
    """For each node its depth, and the child from which the longest branch comes; -1 for tips."""
    n = len(xy)
    has = parent >= 0
    _, depth = chain_steps(np.where(has, parent, np.arange(n)))
    own = np.where(has, np.hypot(*(xy - xy[parent]).T), 0.0)
    far, heir = np.zeros(n), np.full(n, -1)
    by_depth = np.argsort(depth, kind="stable")
    starts = np.searchsorted(depth[by_depth], np.arange(int(depth.max()) + 2))
    for d in range(int(depth.max()), 0, -1):
        nodes = by_depth[starts[d] : starts[d + 1]]
        reach = far[nodes] + own[nodes]
        np.maximum.at(far, parent[nodes], reach)
        longest = nodes[reach == far[parent[nodes]]]
        heir[parent[longest]] = longest
    return depth, heir


def _prolonged(xy: Float, parent: Int, last: Int, order: Int, head: Bool) -> Float:
    """(M, 2) where each line ends: at the branch it joins, or a little beyond the wall."""
    root = parent[last] < 0
    place = np.flatnonzero(np.append(head[1:], True))
    before = order[np.maximum(place - 1, 0)]
    way = xy[last] - xy[before]
    way /= np.maximum(np.hypot(*way.T), 1e-9)[:, None]
    return np.where(root[:, None], xy[last] + _BEYOND * way, xy[np.maximum(parent[last], 0)])
