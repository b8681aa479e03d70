"""Ragged arrays for the areas and the straight lines of a whole stack of layers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from printer_slicer.arrays import (
    Bool,
    Float,
    Int,
    bounding_boxes,
    consecutive,
    frozen_array,
    next_in_ring,
    polyline_lengths,
    previous_in_ring,
)
from printer_slicer.deprecation import renamed_method
from printer_slicer.kernel import load_kernel
from printer_slicer.repr_svg import SvgRepr
from printer_slicer.values import Struct, force_setattr

__all__ = ["Areas", "Lines"]


class Areas(SvgRepr, Struct, frozen=True, eq=False):
    """Areas of all layers as closed rings: solids run counter-clockwise, holes clockwise.

    Attributes:
        xy: (N, 2) mm, the points of all rings one after the other; a ring does not repeat its first point.
        ring_start: (R + 1,) offsets; ring `i` is `xy[ring_start[i]:ring_start[i + 1]]`.
        ring_layer: (R,) ascending layer index of each ring.
        n_layers: number of layers of the stack, including empty ones.
    """

    xy: Float
    ring_start: Int
    ring_layer: Int
    n_layers: int

    def __post_init__(self) -> None:
        force_setattr(self, "xy", frozen_array(self.xy, np.float64, (-1, 2)))
        force_setattr(self, "ring_start", frozen_array(self.ring_start, np.int64, (-1,)))
        force_setattr(self, "ring_layer", frozen_array(self.ring_layer, np.int64, (-1,)))
        if len(self.ring_start) != len(self.ring_layer) + 1:
            raise ValueError("ring_start must have one entry more than ring_layer")
        if len(self.ring_layer) and not 0 <= self.ring_layer[0] <= self.ring_layer[-1] < self.n_layers:
            raise ValueError(f"ring_layer has layers outside the stack of {self.n_layers} layers")

    def __repr__(self) -> str:
        return f"<Areas: {self.n_layers} layers, {self.n_rings} rings, {len(self.xy)} points>"

    @classmethod
    def empty(cls, n_layers: int) -> Areas:
        """Return a stack without any ring."""
        return cls(np.zeros((0, 2)), np.zeros(1, np.int64), np.zeros(0, np.int64), n_layers)

    @classmethod
    def from_rings(cls, rings: list[list[Float]]) -> Areas:
        """Build a stack from one list of (n, 2) rings per layer; drop rings with fewer than three points."""
        kept = [(layer, ring) for layer, many in enumerate(rings) for ring in many if len(ring) >= 3]
        sizes = np.array([0, *(len(ring) for _, ring in kept)], dtype=np.int64)
        xy = np.concatenate([ring for _, ring in kept]) if kept else np.zeros((0, 2))
        return cls(xy, np.cumsum(sizes), np.array([layer for layer, _ in kept], dtype=np.int64), len(rings))

    @classmethod
    def from_boxes(cls, low: Float, high: Float, layer: Int, n_layers: int) -> Areas:
        """Build a stack of rectangles with lower and upper corners (n, 2), mm, on layers (n,), ascending."""
        right = np.column_stack([high[:, 0], low[:, 1]])
        left = np.column_stack([low[:, 0], high[:, 1]])
        xy = np.stack([low, right, high, left], axis=1).reshape(-1, 2)
        return cls(xy, 4 * np.arange(len(low) + 1), layer, n_layers)

    @classmethod
    def from_buffers(cls, made: tuple[bytes, bytes, bytes], n_layers: int) -> Areas:
        """Return a stack of rings that the compiled kernel made: points, offsets and layers."""
        xy, start, layer = made
        return cls(
            np.frombuffer(xy).reshape(-1, 2),
            np.frombuffer(start, np.int64),
            np.frombuffer(layer, np.int64),
            n_layers,
        )

    @property
    def n_rings(self) -> int:
        """Number of rings in the whole stack."""
        return len(self.ring_layer)

    @property
    def layer_start(self) -> Int:
        """Offsets (n_layers + 1,): the rings of layer `k` are `layer_start[k]:layer_start[k + 1]`."""
        return np.searchsorted(self.ring_layer, np.arange(self.n_layers + 1)).astype(np.int64)

    @property
    def used(self) -> Bool:
        """Mask (n_layers,) of the layers that have any ring."""
        used = np.zeros(self.n_layers, np.bool_)
        used[self.ring_layer] = True
        return used

    @property
    def following(self) -> Int:
        """Index (N,) of the next point around the ring."""
        return next_in_ring(self.ring_start)

    @property
    def previous(self) -> Int:
        """Index (N,) of the previous point around the ring."""
        return previous_in_ring(self.ring_start)

    @property
    def point_layer(self) -> Int:
        """Layer index (N,) of each point, ascending."""
        return np.repeat(self.ring_layer, np.diff(self.ring_start))

    @property
    def point_ring(self) -> Int:
        """Ring index (N,) of each point, ascending."""
        return np.repeat(np.arange(self.n_rings), np.diff(self.ring_start))

    def ring(self, index: int) -> Float:
        """Return the points (n, 2) of the ring with this index, mm."""
        return self.xy[self.ring_start[index] : self.ring_start[index + 1]]

    def rings(self, layer: int) -> Iterator[Float]:
        """Return the rings of the layer with this index, from 0, each (n, 2)."""
        first, last = np.searchsorted(self.ring_layer, [layer, layer + 1])
        return (self.ring(i) for i in range(first, last))

    def ring_area(self) -> Float:
        """Return the signed area (R,) of each ring, mm²: positive for solids, negative for holes."""
        if self.n_rings == 0:
            return np.zeros(0)
        kernel = load_kernel()
        if kernel:
            return np.frombuffer(kernel.ring_areas(self.xy, self.ring_start))
        start, sizes = self.ring_start[:-1], np.diff(self.ring_start)
        # Coordinates relative to the first point of each ring: far from the origin the shoelace sum loses digits.
        x, y = (column - np.repeat(column[start], sizes) for column in np.ascontiguousarray(self.xy.T))
        following = self.following
        return np.add.reduceat(x * y[following] - y * x[following], start) / 2

    def area(self) -> Float:
        """Return the area (n_layers,) of each layer, mm²."""
        weights = self.ring_area()
        return np.bincount(self.ring_layer, weights, minlength=self.n_layers).astype(np.float64)

    def ring_length(self) -> Float:
        """Return the length (R,) of each ring, mm."""
        return polyline_lengths(self.xy, self.ring_start)

    def length(self) -> Float:
        """Return the total length (n_layers,) of the rings of each layer, mm."""
        weights = self.ring_length()
        return np.bincount(self.ring_layer, weights, minlength=self.n_layers).astype(np.float64)

    def boxes(self) -> tuple[Float, Float]:
        """Return the bounding box of each layer: lowest and highest corner, both (n_layers, 2), mm.

        The box of an empty layer goes from +inf to -inf.
        """
        return bounding_boxes(self.xy, self.ring_start, self.ring_layer, self.n_layers)

    def select(self, keep: Bool) -> Areas:
        """Return only the rings for which `keep` (R,) is true."""
        return self.take(np.flatnonzero(keep))

    def take(self, rings: Int) -> Areas:
        """Return the rings with the given indices; their layers must ascend."""
        return self.restacked(rings, self.ring_layer[rings], self.n_layers)

    def restacked(self, rings: Int, layer: Int, n_layers: int) -> Areas:
        """Return a stack of the rings with these indices (r,), in any order, on new layers `layer` (r,), ascending."""
        if not len(rings):
            return Areas.empty(n_layers)
        begin, end = self.ring_start[rings], self.ring_start[rings + 1]
        if (begin[1:] == end[:-1]).all():  # adjacent in memory: a slice will do
            low, high = int(begin[0]), int(end[-1])
            return Areas(self.xy[low:high], np.append(begin, high) - low, layer, n_layers)
        sizes = end - begin
        start = np.concatenate([[0], np.cumsum(sizes)])
        return Areas(self.xy.take(consecutive(begin, sizes), axis=0), start, layer, n_layers)

    def of_points(self, keep: Bool) -> Areas:
        """Keep the points where `keep` (N,) is true; drop rings that keep fewer than three."""
        count = self._count_points(keep)
        if ((count > 0) & (count < 3)).any():
            keep = self.mask_whole_rings(keep)
        kept = count >= 3
        start = np.append(0, np.cumsum(count[kept]))
        return Areas(self.xy.compress(keep, axis=0), start, self.ring_layer[kept], self.n_layers)

    def mask_whole_rings(self, keep: Bool) -> Bool:
        """Return the mask `keep` (N,), cleared for rings that would keep fewer than three points."""
        return keep & np.repeat(self._count_points(keep) >= 3, np.diff(self.ring_start))

    def _count_points(self, chosen: Bool) -> Int:
        """Return the number of chosen points (N,) of each ring (R,)."""
        return np.diff(np.append(0, np.cumsum(chosen))[self.ring_start])

    def of_layers(self, layers: Bool | Int) -> Areas:
        """Return only the rings of some layers, given as a mask (n_layers,) or as layer indices."""
        wanted = np.zeros(self.n_layers, np.bool_)
        wanted[layers] = True
        keep = wanted[self.ring_layer]
        return self if keep.all() else self.select(keep)

    def find_changed_layers(self, before: Areas) -> Bool:
        """Return a mask (n_layers,) of the layers whose rings are not exactly those of another stack."""
        first, other_first = (one.ring_start[one.layer_start] for one in (self, before))
        result = np.diff(first) != np.diff(other_first)
        result |= np.diff(self.layer_start) != np.diff(before.layer_start)
        rings = [np.flatnonzero(~result[one.ring_layer]) for one in (self, before)]
        sizes = [np.diff(one.ring_start)[some] for one, some in zip((self, before), rings, strict=True)]
        result[self.ring_layer[rings[0][sizes[0] != sizes[1]]]] = True
        same = np.flatnonzero(~result)
        count = np.diff(first)[same]
        one, other = (
            self.xy[consecutive(first[same], count)],
            before.xy[consecutive(other_first[same], count)],
        )
        result[np.repeat(same, count)[(one != other).any(axis=1)]] = True
        return np.asarray(result)

    def on_layers(self, layer: Int, n_layers: int) -> Areas:
        """Return the areas in a stack of `n_layers` layers; layer k moves to index `layer[k]` (L,), ascending."""
        return Areas(self.xy, self.ring_start, layer[self.ring_layer], n_layers)

    def copy_layers(self, layers: Int) -> Areas:
        """Return a stack of copies of the layers with these indices (E,), in this order."""
        bounds = self.layer_start
        count = np.diff(bounds)[layers]
        entry = np.repeat(np.arange(len(layers)), count)
        return self.restacked(consecutive(bounds[layers], count), entry, len(layers))

    def find_first_equal_layers(self, *of_layer: Float) -> Int:
        """Return for each layer (L,) the first layer that has the same rings, and the same values in arrays (L,)."""
        values, bounds, points = (
            np.stack([*of_layer, np.zeros(self.n_layers)], axis=1),
            self.layer_start,
            self.xy,
        )
        size, seen, result = np.diff(self.ring_start), dict[tuple[bytes, ...], int](), []
        for layer, (begin, end) in enumerate(zip(bounds[:-1].tolist(), bounds[1:].tolist(), strict=True)):
            rings = points[self.ring_start[begin] : self.ring_start[end]]
            key = rings.tobytes(), size[begin:end].tobytes(), values[layer].tobytes()
            result.append(seen.setdefault(key, layer))
        return np.array(result, np.int64)

    def shift_layers(self, by: int) -> Areas:
        """Shift areas up: each layer gets the area of the layer `by` indices below it (above it, if negative)."""
        layer = self.ring_layer + by
        rings = np.flatnonzero((layer >= 0) & (layer < self.n_layers))
        return self.restacked(rings, layer[rings], self.n_layers)

    @classmethod
    def concatenate(cls, parts: Sequence[Areas], n_layers: int) -> Areas:
        """Concatenate stacks of `n_layers` layers, each of which ends on a lower layer than the next one starts on."""
        if not parts:
            return cls.empty(n_layers)
        sizes = np.concatenate([np.diff(part.ring_start) for part in parts])
        return cls(
            np.concatenate([part.xy for part in parts]),
            np.concatenate([[0], np.cumsum(sizes)]),
            np.concatenate([part.ring_layer for part in parts]),
            n_layers,
        )

    following_on = classmethod(renamed_method("Areas.following_on", "Areas.concatenate"))
    for_each = renamed_method("Areas.for_each", "Areas.copy_layers")
    in_whole_rings = renamed_method("Areas.in_whole_rings", "Areas.mask_whole_rings")
    raised = renamed_method("Areas.raised", "Areas.shift_layers")

    @classmethod
    def merged(cls, parts: Sequence[Areas]) -> Areas:
        """Return the rings of several stacks together; within a layer in the order of `parts`."""
        whole = parts[0]
        for part in parts[1:]:
            whole = whole.merge(part)
        return whole

    def merge(self, other: Areas) -> Areas:
        """Return the rings of both stacks together, without a union where they overlap.

        Raises:
            ValueError: the stacks have different numbers of layers.
        """
        if self.n_layers != other.n_layers:
            raise ValueError(
                f"the stacks have different numbers of layers: {self.n_layers} and {other.n_layers}"
            )
        if not (self.n_rings and other.n_rings):
            return self if self.n_rings else other
        layer = np.concatenate([self.ring_layer, other.ring_layer])
        order = np.argsort(layer, kind="stable")
        first = np.concatenate([self.ring_start[:-1], other.ring_start[:-1] + len(self.xy)])[order]
        sizes = np.concatenate([np.diff(self.ring_start), np.diff(other.ring_start)])[order]
        points = np.concatenate([self.xy, other.xy]).take(consecutive(first, sizes), axis=0)
        return Areas(points, np.concatenate([[0], np.cumsum(sizes)]), layer[order], self.n_layers)


class Lines(Struct, frozen=True, eq=False):
    """Straight lines of all layers, as returned by `hatch`.

    Attributes:
        ends: (S, 2, 2) mm, both ends of each line.
        layer: (S,) layer index, ascending.
        row: (S,) row of the hatch, ascending within a layer.
        u: (S, 2) mm, positions of both ends along the row, the smaller one first; ascending within a row.
        edge: (S, 2) edge of the areas on which each end lies, given by the index of the point where the edge starts.
    """

    ends: Float
    layer: Int
    row: Int
    u: Float
    edge: Int

    def __post_init__(self) -> None:
        force_setattr(self, "ends", frozen_array(self.ends, np.float64, (-1, 2, 2)))
        n_lines = len(self.ends)
        force_setattr(self, "layer", frozen_array(self.layer, np.int64, (n_lines,)))
        force_setattr(self, "row", frozen_array(self.row, np.int64, (n_lines,)))
        force_setattr(self, "u", frozen_array(self.u, np.float64, (n_lines, 2)))
        force_setattr(self, "edge", frozen_array(self.edge, np.int64, (n_lines, 2)))

    @property
    def n_lines(self) -> int:
        """Number of lines in the whole stack."""
        return len(self.layer)

    def length(self) -> Float:
        """Return the length (S,) of each line, mm."""
        return self.u[:, 1] - self.u[:, 0]

    def take(self, chosen: Int) -> Lines:
        """Return the lines with the given indices, ascending."""
        return Lines(
            self.ends[chosen], self.layer[chosen], self.row[chosen], self.u[chosen], self.edge[chosen]
        )
