"""Open and closed polylines of all layers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, consecutive, frozen_array, polyline_lengths
from printer_slicer.geometry.areas import Areas, Lines
from printer_slicer.values import Struct, force_setattr

__all__ = ["Polylines"]

_SAME = 1e-6  # mm


class Polylines(Struct, frozen=True, eq=False):
    """Lines of all layers: line `i` is `xy[start[i]:start[i + 1]]`.

    Attributes:
        xy: (N, 2) mm.
        start: (M + 1,) offset of each line.
        layer: (M,) layer of each line, ascending.
        edge: (M, 2) edge of the surrounding areas on which each line starts and ends, given by the index of the point
            where the edge starts; -1 for an end that lies on none.
        closed: (M,) whether a line returns to its first point; the point is not repeated.
    """

    xy: Float
    start: Int
    layer: Int
    edge: Int
    closed: Bool

    def __post_init__(self) -> None:
        n_lines = len(self.layer)
        for name, dtype, shape in (
            ("xy", np.float64, (-1, 2)),
            ("start", np.int64, (n_lines + 1,)),
            ("layer", np.int64, (n_lines,)),
            ("edge", np.int64, (n_lines, 2)),
            ("closed", np.bool_, (n_lines,)),
        ):
            force_setattr(self, name, frozen_array(getattr(self, name), dtype, shape))

    def __repr__(self) -> str:
        return f"<Polylines: {self.n_lines} lines, {len(self.xy)} points, {self.length().sum():.4g} mm>"

    @classmethod
    def of(cls, xy: Float, size: Int, layer: Int, edge: Int | None = None) -> Polylines:
        """Build open lines with `size` (M,) points each, one after the other, by ascending layer."""
        ends = np.full((len(size), 2), -1) if edge is None else edge
        return cls(xy, np.append(0, np.cumsum(size)), layer, ends, np.zeros(len(size), np.bool_))

    @classmethod
    def from_lines(cls, lines: Sequence[Sequence[Float]]) -> Polylines:
        """Build open lines from one list of (n, 2) lines per layer; drop lines with fewer than two points."""
        kept = [
            (layer, np.asarray(line, np.float64))
            for layer, many in enumerate(lines)
            for line in many
            if len(line) > 1
        ]
        size = np.array([len(line) for _, line in kept], np.int64)
        xy = np.concatenate([line for _, line in kept]) if kept else np.zeros((0, 2))
        return cls.of(xy, size, np.array([layer for layer, _ in kept], np.int64))

    @classmethod
    def hatched(cls, lines: Lines) -> Polylines:
        """Build lines of two points each from a hatch."""
        return cls.of(lines.ends.reshape(-1, 2), np.full(lines.n_lines, 2), lines.layer, lines.edge)

    @classmethod
    def around(cls, areas: Areas) -> Polylines:
        """Return the outlines of areas as closed lines."""
        n_rings = areas.n_rings
        ends, closed = np.full((n_rings, 2), -1), np.ones(n_rings, np.bool_)
        return cls(areas.xy, areas.ring_start, areas.ring_layer, ends, closed)

    @classmethod
    def joined(cls, parts: Sequence[Polylines]) -> Polylines:
        """Join the lines of several values, by layer; within a layer in the order of `parts`."""
        layer = np.concatenate([part.layer for part in parts])
        size = np.concatenate([part.size for part in parts])
        whole = cls(
            np.concatenate([part.xy for part in parts]),
            np.append(0, np.cumsum(size)),
            layer,
            np.concatenate([part.edge for part in parts]),
            np.concatenate([part.closed for part in parts]),
        )
        return whole if len(parts) == 1 else whole.take(np.argsort(layer, kind="stable"))

    @property
    def n_lines(self) -> int:
        """Number of lines in the whole stack."""
        return len(self.layer)

    @property
    def size(self) -> Int:
        """Number of points (M,) of each line."""
        return np.diff(self.start)

    def take(self, lines: Int) -> Polylines:
        """Return the lines with the given indices (m,); their layers must ascend."""
        size = self.size[lines]
        points = consecutive(self.start[lines], size)
        start = np.append(0, np.cumsum(size))
        return Polylines(self.xy[points], start, self.layer[lines], self.edge[lines], self.closed[lines])

    def length(self) -> Float:
        """Return the length (M,) of each line, mm."""
        return polyline_lengths(self.xy, self.start, self.closed)

    def without_repeats(self) -> tuple[Polylines, Int]:
        """Remove repeated points from open lines, and lines with fewer than two points.

        Returns:
            The lines, and the indices of the points that remain.
        """
        keep = np.hypot(*np.diff(self.xy, axis=0, prepend=np.nan).T) > _SAME
        keep[self.start[:-1]] = True
        owner = np.repeat(np.arange(self.n_lines), self.size)
        count = np.bincount(owner[keep], minlength=self.n_lines)
        kept = np.flatnonzero(keep & (count >= 2)[owner])
        return Polylines.of(self.xy[kept], count[count >= 2], self.layer[count >= 2]), kept
