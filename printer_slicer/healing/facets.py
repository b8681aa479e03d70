"""Facets with numbered corners and edges, and their connectivity."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.geometry.connectivity import label_components, weld_keys
from printer_slicer.geometry.facet_topology import corner_keys
from printer_slicer.values import Struct

__all__ = ["Facets"]


class Facets(Struct, frozen=True, eq=False):
    """A surface as numbered corners and numbered edges.

    Attributes:
        points: (V, 3) mm.
        corners: (F, 3) number of the point at each corner; the three differ.
        edges: (F, 3) number of the edge from each corner to the next.
        turns: (F, 3) direction of the facet along each edge: 1 from the lower point number to the higher, else -1.
        count: (E,) number of facets at each edge.
        net: (E,) sum of their turns: 0 where each facet has a neighbour that faces the same way.
        key: (E,) a number made of the point numbers of both ends.
    """

    points: Float
    corners: Int
    edges: Int
    turns: Int
    count: Int
    net: Int
    key: Int

    @classmethod
    def from_indices(cls, points: Float, corners: Int) -> Facets:
        """Create facets from points (V, 3) and corner numbers (F, 3); drop facets with two equal corners."""
        a, b, c = corners.T
        corners = corners[(a != b) & (b != c) & (c != a)]
        after = corners[:, [1, 2, 0]]
        low, high = np.minimum(corners, after), np.maximum(corners, after)
        key = low * np.int64(len(points)) + high
        number, firsts = weld_keys(key.ravel().view(np.uint64))
        edges, n_edges = number.reshape(-1, 3).astype(np.int64), len(firsts)
        turns = np.where(corners < after, 1, -1)
        count = np.bincount(edges.ravel(), minlength=n_edges)
        net = np.bincount(edges.ravel(), turns.ravel(), minlength=n_edges).astype(np.int64)
        return cls(points, corners, edges, turns, count, net, key.ravel()[firsts])

    @classmethod
    def from_triangles(cls, triangles: Float) -> Facets:
        """Create facets from triangles (F, 3, 3); corners with equal coordinates become one."""
        flat = triangles.reshape(-1, 3)
        number, firsts = weld_keys(corner_keys(flat))
        if not np.array_equal(flat[firsts][number], flat):  # two positions with the same key: very rare
            _, first, inverse = np.unique(flat, axis=0, return_index=True, return_inverse=True)
            firsts, number = first.astype(np.int32), inverse.astype(np.int32)
        return cls.from_indices(flat[firsts], number.reshape(-1, 3).astype(np.int64))

    @property
    def triangles(self) -> Float:
        """Triangles (F, 3, 3), mm."""
        return np.asarray(self.points[self.corners])

    @property
    def centroids(self) -> Float:
        """Centroid (F, 3) of each facet, mm."""
        return np.asarray(self.triangles.mean(axis=1))

    @property
    def normals(self) -> Float:
        """Normal (F, 3) of each facet; the length of the normal is twice the area, mm²."""
        a, b, c = self.triangles.transpose(1, 0, 2)
        return np.cross(b - a, c - a)

    def select(self, keep: Bool) -> Facets:
        """Return the facets for which `keep` (F,) is true."""
        return Facets.from_indices(self.points, self.corners[keep])

    def flip(self, turn: Bool) -> Facets:
        """Flip the facets for which `turn` (F,) is true; return all facets."""
        return Facets.from_indices(self.points, np.where(turn[:, None], self.corners[:, ::-1], self.corners))

    def pair_neighbours(self) -> tuple[Int, Bool]:
        """Return pairs of facets (2, P) that alone share an edge, and whether they face the same way (P,)."""
        half = np.flatnonzero(self.count[self.edges.ravel()] == 2)
        order = half[np.argsort(self.edges.ravel()[half], kind="stable")]
        first, second = order[::2], order[1::2]
        turns = self.turns.ravel()
        return np.stack([first // 3, second // 3]), np.asarray(turns[first] != turns[second])

    def label_patches(self) -> Int:
        """Return the patch of each facet (F,), from 0; a patch is connected by edges with exactly two facets."""
        return label_components(self.pair_neighbours()[0], len(self.corners))
