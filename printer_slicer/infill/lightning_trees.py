"""Trees of lightning infill: grow them below roofs, and shrink them from layer to layer."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, run_starts
from printer_slicer.geometry import Areas, Polylines
from printer_slicer.geometry.clipping import clip_with_sources
from printer_slicer.geometry.connectivity import find_chain_ends
from printer_slicer.geometry.planar import SegmentTree
from printer_slicer.geometry.vectors import nearest_on_segments

__all__ = ["AT_WALL", "Tree", "WallDistance", "attach_trees", "clip_trees", "grow_trees", "shrink_trees"]

AT_WALL = 0.004  # mm; nodes nearer to the perimeter than this are on it
_MERGE_DISTANCE = 0.02  # mm; nodes nearer than this are merged
_MAX_POINTS = 2500  # number of points that may be connected to each other; more connect to branches only


class Tree(NamedTuple):
    """The trees of one layer: nodes (n, 2) mm, and the parent (n,) of each toward the perimeter; -1 for roots."""

    xy: Float
    parent: Int

    @classmethod
    def empty(cls) -> Tree:
        """Return a layer without trees."""
        return cls(np.zeros((0, 2)), np.zeros(0, np.int64))

    @property
    def branch_nodes(self) -> Int:
        """Return the nodes that have a parent; each is the end of one branch segment."""
        return np.flatnonzero(self.parent >= 0)

    def count_children(self) -> Int:
        """Return the number of children of each node (n,)."""
        return np.bincount(self.parent[self.branch_nodes], minlength=len(self.parent))

    def branch_ends(self) -> Float:
        """Return both ends (S, 2, 2) of every branch segment."""
        return np.stack([self.xy[self.branch_nodes], self.xy[self.parent[self.branch_nodes]]], axis=1)

    def keep_nodes(self, nodes: Bool) -> Tree:
        """Return the trees of only the selected `nodes` (n,); nodes that lose their parent become roots."""
        number = np.append(np.where(nodes, np.cumsum(nodes) - 1, -1), -1)
        return Tree(self.xy[nodes], number[self.parent[nodes]])

    def with_positions(self, xy: Float, removed: Bool) -> Tree:
        """Move the nodes to `xy` (n, 2); return the trees without the `removed` nodes (n,) and very short segments."""
        short = self.parent >= 0
        short[short] = np.hypot(*(xy[short] - xy[self.parent[short]]).T) < _MERGE_DISTANCE
        goal = find_chain_ends(np.where(short, self.parent, np.arange(len(xy))))
        parent = np.where(self.parent >= 0, goal[self.parent], -1)
        return Tree(xy, parent).keep_nodes(~removed & ~short)


class WallDistance:
    """Distance to the outlines of one layer's area."""

    def __init__(self, area: Areas) -> None:
        """Index the outlines of the clean area of one layer, which must not be empty."""
        self.area = area
        self.ends = np.stack([area.xy, area.xy[area.following]], axis=1)
        self._tree = SegmentTree(self.ends)

    def nearest(self, points: Float) -> tuple[Float, Float]:
        """Return the distance (P,) of points to the outline, mm, and the nearest point (P, 2) on it."""
        segment = self.ends[self._tree.nearest(points)]
        foot, _ = nearest_on_segments(points, segment[:, 0], segment[:, 1])
        return np.hypot(*(foot - points).T), foot


def shrink_trees(tree: Tree, reach: float) -> Tree:
    """Return the trees on the layer below: tips are up to `reach` mm shorter, bends straighter.

    Every point of the given trees is within `reach` of the result, except tips shorter than that.
    """
    has, children = tree.parent >= 0, tree.count_children()
    toward = np.where(has[:, None], tree.xy[tree.parent], tree.xy) - tree.xy
    long = np.hypot(*toward.T)
    tip = has & (children == 0)
    gone = (tip & (long <= reach)) | (~has & (children == 0))
    xy = tree.xy.copy()
    going = tip & ~gone
    xy[going] += toward[going] * (reach / long[going])[:, None]
    still = np.zeros(len(has), np.bool_)
    still[tree.parent[gone & has]] = True  # the parents of removed tips do not move
    middle = np.stack(
        [np.bincount(tree.parent[has], tree.xy[has, axis], minlength=len(has)) for axis in (0, 1)], axis=1
    )
    bent = np.flatnonzero(has & (children > 0) & ~still)
    goal = (middle[bent] / children[bent, None] + tree.xy[tree.parent[bent]]) / 2
    step = goal - tree.xy[bent]
    far = np.maximum(np.hypot(*step.T), 1e-12)
    xy[bent] += step * np.minimum(reach / 2 / far, 1.0)[:, None]
    return tree.with_positions(xy, gone)


def clip_trees(tree: Tree, area: Areas) -> Tree:
    """Clip trees to the area of a layer; branches that leave the area get a root on the outline."""
    branch = tree.branch_nodes
    lines = Polylines.of(
        tree.branch_ends().reshape(-1, 2), np.full(len(branch), 2), np.zeros(len(branch), np.int64)
    )
    parts, line = clip_with_sources(area, lines)
    begin, end = branch[line], tree.parent[branch[line]]
    xy, n = [tree.xy], len(tree.xy)
    for side, own, point in ((0, begin, parts.start[:-1]), (1, end, parts.start[1:] - 1)):
        cut = np.flatnonzero(parts.edge[:, side] >= 0)
        own[cut] = n + np.arange(len(cut))
        xy.append(parts.xy[point[cut]])
        n += len(cut)
    parent, used = np.full(n, -1), np.zeros(n, np.bool_)
    parent[begin] = end
    used[begin] = used[end] = True
    return Tree(np.concatenate(xy), parent).keep_nodes(used)


def attach_trees(tree: Tree, wall: WallDistance, reach: float) -> Tree:
    """Connect all roots to the perimeter.

    A root within `reach` of the perimeter moves there. A root farther away gets a new branch, to the perimeter or to
    the nearest other tree whose root is nearer to the perimeter.
    """
    root = np.flatnonzero(tree.parent < 0)
    gap, foot = wall.nearest(tree.xy[root]) if len(root) else (np.zeros(0), np.zeros((0, 2)))
    off = gap > AT_WALL
    xy, parent = tree.xy.copy(), tree.parent.copy()
    xy[root[off & (gap <= reach)]] = foot[off & (gap <= reach)]
    far = np.flatnonzero(off & (gap > reach))
    tree = Tree(xy, parent)
    if not len(far):
        return tree
    branch = tree.branch_nodes
    key = np.where(gap > reach, gap, 0.0)
    owner = find_chain_ends(np.where(parent >= 0, parent, np.arange(len(parent))))  # the root of each
    key_of = np.zeros(len(parent))
    key_of[root] = key
    on_tree, share = np.full(len(far), -1), np.zeros(len(far))
    ends = tree.branch_ends()
    for i, one in enumerate(far.tolist()):
        places, along = nearest_on_segments(xy[root[one]], ends[:, 0], ends[:, 1])
        distance = np.hypot(*(places - xy[root[one]]).T)
        distance[key_of[owner[branch]] >= key[one]] = np.inf
        nearest = int(np.argmin(distance)) if len(branch) else -1
        if nearest >= 0 and distance[nearest] < gap[one]:
            on_tree[i], share[i], foot[one] = branch[nearest], along[nearest], places[nearest]
    return _connect_nodes(tree, root[far], on_tree, share, foot[far])


def _connect_nodes(tree: Tree, node: Int, branch: Int, share: Float, foot: Float) -> Tree:
    """Connect nodes (m,) to points on branches, or on the perimeter where `branch` is -1.

    Args:
        tree: the trees.
        node: the nodes; none has a parent yet.
        branch: the node at the lower end of the branch segment.
        share: position along the segment, 0 to 1.
        foot: (m, 2) the same position, mm.
    """
    parent = tree.parent.copy()
    up = parent[branch]
    to_child, to_parent = (
        (branch >= 0) & (np.hypot(*(foot - tree.xy[end]).T) < _MERGE_DISTANCE) for end in (branch, up)
    )
    parent[node[to_parent]], parent[node[to_child]] = up[to_parent], branch[to_child]
    new = np.flatnonzero(~(to_child | to_parent))
    # Merge positions on one segment that are nearly the same.
    order = new[np.lexsort((share[new], branch[new]))]
    xy = foot[order]
    same = np.append(False, (np.diff(branch[order]) == 0) & (branch[order][1:] >= 0))[: len(order)]
    same[1:] &= np.hypot(*np.diff(xy, axis=0).T) < _MERGE_DISTANCE
    number = len(parent) + np.cumsum(~same) - 1
    parent[node[order]] = number
    order, xy, number = order[~same], xy[~same], number[~same]
    goes_on = np.append(np.diff(branch[order]) == 0, False)[: len(order)] & (branch[order] >= 0)
    above = np.where(goes_on, np.append(number[1:], -1), np.where(branch[order] >= 0, up[order], -1))
    first = (branch[order] >= 0) & run_starts(branch[order])
    parent[branch[order][first]] = number[first]
    return Tree(np.concatenate([tree.xy, xy]), np.concatenate([parent, above]))


def grow_trees(tree: Tree, wall: WallDistance, points: Float, level: Int, radius: float) -> Tree:
    """Grow branches to all points that are farther than `radius` from the trees and from the perimeter.

    Points of the highest level come first, so that points of lower levels find branches near them. Each point connects
    to the nearest of: the perimeter, the trees, and points of its own level that are nearer to either. The straight
    connection never leaves the area, because the perimeter would be nearer.

    Args:
        tree: the trees.
        wall: distance to the outlines of the layer.
        points: (P, 2) points to support.
        level: (P,) higher levels are connected first.
        radius: mm.
    """
    for one in np.unique(level)[::-1].tolist():
        unsupported = points[level == one]
        branch = tree.branch_nodes
        segments = np.concatenate([tree.branch_ends(), wall.ends])
        which = SegmentTree(segments).nearest(unsupported)
        foot, share = nearest_on_segments(unsupported, segments[which, 0], segments[which, 1])
        gap = np.hypot(*(foot - unsupported).T)
        free = gap > radius
        if not free.any():
            continue
        unsupported, gap, foot, share, which = (
            unsupported[free],
            gap[free],
            foot[free],
            share[free],
            which[free],
        )
        node = len(tree.xy) + np.arange(len(unsupported))
        nearer = _find_nearer_points(unsupported, gap)
        parent = np.where(nearer >= 0, node[nearer], -1)
        tree = Tree(np.concatenate([tree.xy, unsupported]), np.concatenate([tree.parent, parent]))
        alone = np.flatnonzero(nearer < 0)
        on = np.append(branch, -1)[np.minimum(which[alone], len(branch))]
        tree = _connect_nodes(tree, node[alone], on, share[alone], foot[alone])
    return tree


def _find_nearer_points(points: Float, gap: Float) -> Int:
    """Return for each point (P,) its nearest neighbour that is closer to a branch or perimeter; -1 if there is none.

    A neighbour farther away than the branch or perimeter at `gap` (P,) mm does not count.
    """
    n = len(points)
    if n < 2 or n > _MAX_POINTS:
        return np.full(n, -1)
    rank = np.zeros(n, np.int64)
    rank[np.lexsort((np.arange(n), gap))] = np.arange(n)
    between = points[:, None] - points[None]
    distance = np.hypot(between[..., 0], between[..., 1])
    distance[rank[None, :] >= rank[:, None]] = np.inf
    nearest = np.argmin(distance, axis=1)
    return np.where(distance[np.arange(n), nearest] < gap, nearest, -1)
