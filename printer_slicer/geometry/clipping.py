"""Outlines cut where they leave an area."""

from __future__ import annotations

import numpy as np

from printer_slicer.geometry.areas import Areas, Bool, Float, Int

__all__ = ["clip_outlines"]

_PAIRS_AT_ONCE = 1 << 20  # of edges; bounds the memory


def clip_outlines(outlines: Areas, within: Areas) -> tuple[Float, Int, Int, Bool]:
    """The stretches of the rings of `outlines` that lie in the areas of `within`, layer by layer.

    A ring that is never left stays closed; of the others each stretch is a polyline. Stretches along an outline of
    `within` may be taken or not: rounding decides.

    Args:
        outlines: any rings.
        within: clean areas.

    Returns:
        Points (N, 2), and of each path the number of points (M,), the ring (M,) it is from, ascending, and whether it
        is closed (M,).

    Raises:
        ValueError: the stacks have different numbers of layers.
    """
    if outlines.n_layers != within.n_layers:
        raise ValueError(f"stacks of {outlines.n_layers} and {within.n_layers} layers")
    pieces = [_clipped(outlines, index, within) for index in range(outlines.n_rings)]
    paths = [(xy, index, closed) for index, some in enumerate(pieces) for xy, closed in some]
    return (
        np.concatenate([np.zeros((0, 2)), *(xy for xy, _, _ in paths)]),
        np.array([len(xy) for xy, _, _ in paths], np.int64),
        np.array([index for _, index, _ in paths], np.int64),
        np.array([closed for _, _, closed in paths], np.bool_),
    )


def _clipped(outlines: Areas, index: int, within: Areas) -> list[tuple[Float, bool]]:
    """The stretches of one ring, each with whether it is the whole ring."""
    ring, layer = outlines.ring(index), int(outlines.ring_layer[index])
    first, last = within.ring_start[within.layer_start[layer : layer + 2]]
    if first == last:
        return []
    a, b = within.xy[first:last], within.xy.take(within.following[first:last], axis=0)
    nodes = _with_crossings(ring, a, b)
    after = np.roll(nodes, -1, axis=0)
    inside = _inside((nodes + after) / 2, a, b)
    if inside.all():
        return [(ring, True)]
    # Turned so that the last piece is outside, no stretch runs over the end.
    turn = int(np.flatnonzero(~inside)[-1]) + 1
    nodes, inside = np.roll(nodes, -turn, axis=0), np.roll(inside, -turn)
    edge = np.diff(inside.astype(np.int8), prepend=0, append=0)
    begin, end = np.flatnonzero(edge > 0), np.flatnonzero(edge < 0)
    return [(nodes[i : j + 1], False) for i, j in zip(begin.tolist(), end.tolist(), strict=True)]


def _with_crossings(ring: Float, a: Float, b: Float) -> Float:
    """The points of a ring and, between them, those where it crosses the edges from `a` to `b` (E, 2)."""
    way, edge = np.roll(ring, -1, axis=0) - ring, b - a
    side: list[Int] = []
    share: list[Float] = []
    at_once = max(_PAIRS_AT_ONCE // len(a), 1)
    for start in range(0, len(ring), at_once):
        begin, along = ring[start : start + at_once, None], way[start : start + at_once, None]
        gap, turn = a - begin, _cross(along, edge)
        with np.errstate(divide="ignore", invalid="ignore"):
            u, v = _cross(gap, edge) / turn, _cross(gap, along) / turn
        meets = (u > 0) & (u < 1) & (v >= 0) & (v <= 1)
        side.append(np.nonzero(meets)[0] + start)
        share.append(u[meets])
    sides, shares = (
        np.concatenate([np.arange(len(ring)), *side]),
        np.concatenate([np.zeros(len(ring)), *share]),
    )
    order = np.lexsort((shares, sides))
    sides, shares = sides[order], shares[order]
    new = np.append(True, (np.diff(sides) != 0) | (np.diff(shares) > 0))
    sides, shares = sides[new], shares[new]
    return np.asarray(ring[sides] + shares[:, None] * way[sides])


def _inside(points: Float, a: Float, b: Float) -> Bool:
    """(P,) whether a ray to the right crosses the edges an odd number of times."""
    result = np.zeros(len(points), np.bool_)
    at_once = max(_PAIRS_AT_ONCE // len(a), 1)
    for start in range(0, len(points), at_once):
        x, y = points[start : start + at_once, :1], points[start : start + at_once, 1:]
        spans = (a[:, 1] <= y) != (b[:, 1] <= y)
        with np.errstate(divide="ignore", invalid="ignore"):
            right = a[:, 0] + (y - a[:, 1]) / (b[:, 1] - a[:, 1]) * (b[:, 0] - a[:, 0]) > x
        result[start : start + at_once] = (spans & right).sum(axis=1) % 2 == 1
    return result


def _cross(a: Float, b: Float) -> Float:
    """Cross products of vectors (..., 2)."""
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])
