"""Lightning infill: trees that support only roofs and internal floors; the rest of the part stays hollow.

Layers are processed from the top down. Below areas with nothing above, trees grow from the perimeters until every
point is near a branch. On each layer below, tips are shorter and bends straighter, within the allowed overhang. So
every branch stands on a branch, a perimeter or a solid area.

Source: Tricard, Claux & Lefebvre, Ribbed support vaults for 3D printing of hollowed objects, 2019, for the idea that
the support of a roof may shrink from layer to layer; trees instead of ribs as in Cura's infill of this name.
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
from printer_slicer.geometry.connectivity import count_chain_steps, find_chain_ends
from printer_slicer.infill.infill_task import InfillTask, Pattern
from printer_slicer.infill.lightning_trees import (
    AT_WALL,
    Tree,
    WallDistance,
    attach_trees,
    clip_trees,
    grow_trees,
    shrink_trees,
)

__all__ = ["lightning_lines", "lightning_pattern"]

# Spacings around an internal bridge that are supported, so that the bridge lines find an anchor.
_BRIDGE_MARGIN = 0.5
_SUPPORT_RADIUS = 0.5  # spacings; points nearer to a branch or perimeter are supported
_N_LEVELS = 6  # levels of points; each level has twice the distance of the one below
_ROOT_EXTENSION = 0.02  # mm by which roots are extended to reach the outline


def lightning_lines(task: InfillTask) -> tuple[Polylines, Float]:
    """Return the branches of the trees; directly below a large roof they have the density of the profile."""
    return lightning_pattern(task)(task)


def lightning_pattern(task: InfillTask) -> Pattern:
    """Grow the trees for the regions of this task, and return the pattern that clips them to areas."""
    return partial(
        _clip_branches,
        _list_branches(_grow_layer_trees(task, offset(task.regions.internal_infill, -task.inset))),
    )


def _clip_branches(branches: Polylines, task: InfillTask) -> tuple[Polylines, Float]:
    """Clip the branches to the areas of a task."""
    # Entries of several combined layers have the trees of the layer that prints them.
    first, last = (np.searchsorted(branches.layer, task.layer, side=side) for side in ("left", "right"))
    counts = np.where(task.area.used, last - first, 0)
    chosen = consecutive(first, counts)
    points = consecutive(branches.start[chosen], branches.size[chosen])
    laid = Polylines.of(branches.xy[points], branches.size[chosen], np.repeat(np.arange(len(counts)), counts))
    return clip_lines(task.area, laid), np.ones(len(task.z))


def _grow_layer_trees(task: InfillTask, area: Areas) -> list[Tree]:
    """Grow the trees of each layer, from the top down."""
    n, plan = area.n_layers, task.regions.plan
    points, layer, level = _find_roof_points(task, area)
    point_start = np.searchsorted(layer, np.arange(n + 1))
    around = offset(area, AT_WALL / 2)
    layers, around_layers = area.layer_start, around.layer_start
    trees, tree = [Tree.empty()] * n, Tree.empty()
    for k in range(n - 1, -1, -1):
        below = _extract_layer(area, layers, k)
        if not below.n_rings:
            tree = Tree.empty()
            continue
        wall = WallDistance(below)
        if len(tree.xy):
            reach = task.slope * float(plan.height[k + 1])
            tree = clip_trees(shrink_trees(tree, reach), _extract_layer(around, around_layers, k))
            tree = attach_trees(tree, wall, reach)
        here = slice(point_start[k], point_start[k + 1])
        tree = grow_trees(tree, wall, points[here], level[here], _SUPPORT_RADIUS * task.spacing)
        trees[k] = tree
    return trees


def _find_roof_points(task: InfillTask, area: Areas) -> tuple[Float, Int, Int]:
    """Return points (P, 2) of a square lattice where the layer above has anything but internal infill.

    Points are sorted by layer; the second and third result are the layer and the level of each. Higher levels are
    supported first.
    """
    step = task.spacing / 2
    above = difference(area, area.shift_layers(-1))
    ends = offset(task.regions.internal_bridge.shift_layers(-1), _BRIDGE_MARGIN * task.spacing)
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
    for halved in range(_N_LEVELS):
        even = (both % 2 == 0).all(axis=1) & (halvings == halved)
        halvings[even] += 1
        both[even] //= 2
    odd = both % 2
    # Within a level: points with odd columns, with odd rows, and with both.
    return points, rows.layer[owner], 4 * halvings + 3 - (odd[:, 0] + 2 * odd[:, 1])


def _extract_layer(areas: Areas, layer_start: Int, layer: int) -> Areas:
    """Return the area of one layer as a stack of one layer."""
    first, last = int(layer_start[layer]), int(layer_start[layer + 1])
    begin, end = int(areas.ring_start[first]), int(areas.ring_start[last])
    rings = areas.ring_start[first : last + 1] - begin
    return Areas(areas.xy[begin:end], rings, np.zeros(last - first, np.int64), 1)


def _list_branches(trees: list[Tree]) -> Polylines:
    """Return the trees as lines, each from a tip to the perimeter or to a longer branch."""
    before = np.cumsum([0, *(len(tree.xy) for tree in trees)])
    xy = np.concatenate([tree.xy for tree in trees])
    parent = np.concatenate(
        [np.where(t.parent >= 0, t.parent + at, -1) for t, at in zip(trees, before[:-1], strict=True)]
    )
    layer = np.repeat(np.arange(len(trees)), np.diff(before))
    if not len(xy):
        return Polylines.of(xy, np.zeros(0, np.int64), layer)
    depth, longest_child = _find_longest_children(xy, parent)
    tip = find_chain_ends(np.where(longest_child >= 0, longest_child, np.arange(len(longest_child))))
    order = np.lexsort((-depth, tip))
    head = run_starts(tip[order])
    last = order[np.append(head[1:], True)]
    joint = np.where(parent[last] >= 0, parent[last], last)
    size = np.diff(np.append(np.flatnonzero(head), len(order)))
    beyond = _find_line_ends(xy, parent, last, order, head)
    index = np.insert(order, np.cumsum(size), joint)
    made = xy[index]
    made[np.cumsum(size + 1) - 1] = beyond
    lines = Polylines.of(made, size + 1, layer[last])
    return lines.take(np.flatnonzero(lines.length() > 2 * _ROOT_EXTENSION))


def _find_longest_children(xy: Float, parent: Int) -> tuple[Int, Int]:
    """Return the depth of each node, and its child on the longest branch; -1 for tips."""
    n = len(xy)
    has = parent >= 0
    _, depth = count_chain_steps(np.where(has, parent, np.arange(n)))
    own = np.where(has, np.hypot(*(xy - xy[parent]).T), 0.0)
    far, longest_child = np.zeros(n), np.full(n, -1)
    by_depth = np.argsort(depth, kind="stable")
    starts = np.searchsorted(depth[by_depth], np.arange(int(depth.max()) + 2))
    for d in range(int(depth.max()), 0, -1):
        nodes = by_depth[starts[d] : starts[d + 1]]
        reach = far[nodes] + own[nodes]
        np.maximum.at(far, parent[nodes], reach)
        longest = nodes[reach == far[parent[nodes]]]
        longest_child[parent[longest]] = longest
    return depth, longest_child


def _find_line_ends(xy: Float, parent: Int, last: Int, order: Int, head: Bool) -> Float:
    """Return the end (M, 2) of each line, mm: on the branch that the line joins, or slightly beyond the perimeter."""
    root = parent[last] < 0
    place = np.flatnonzero(np.append(head[1:], True))
    before = order[np.maximum(place - 1, 0)]
    way = xy[last] - xy[before]
    way /= np.maximum(np.hypot(*way.T), 1e-9)[:, None]
    return np.where(root[:, None], xy[last] + _ROOT_EXTENSION * way, xy[np.maximum(parent[last], 0)])
