"""Outlines cut where they leave an area."""

from __future__ import annotations

import numpy as np

from printer_slicer.geometry.areas import Areas, Bool, Float, Int

__all__ = ["clip_outlines"]

_HAIR = 1e-6  # mm; a tenth of the grid of the outlines


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
    if not (outlines.n_rings and within.n_rings):
        nothing = np.zeros(0, np.int64)
        return np.zeros((0, 2)), nothing, nothing, np.zeros(0, np.bool_)
    nodes, edge, inside = _pieces(outlines, within)
    last = np.searchsorted(edge, outlines.ring_start[1:])
    first = np.append(0, last[:-1])
    paths: list[tuple[Float, int, bool]] = []
    for index, (begin, end) in enumerate(zip(first.tolist(), last.tolist(), strict=True)):
        if inside[begin:end].all():
            paths.append((outlines.ring(index), index, True))
        elif inside[begin:end].any():
            paths += [(xy, index, False) for xy in _stretches(nodes[begin:end], inside[begin:end])]
    return (
        np.concatenate([np.zeros((0, 2)), *(xy for xy, _, _ in paths)]),
        np.array([len(xy) for xy, _, _ in paths], np.int64),
        np.array([index for _, index, _ in paths], np.int64),
        np.array([closed for _, _, closed in paths], np.bool_),
    )


def _stretches(nodes: Float, inside: Bool) -> list[Float]:
    """The runs of pieces inside, of a ring that is outside somewhere; each piece goes on to the next node."""
    # Turned so that the last piece is outside, no stretch runs over the end.
    turn = int(np.flatnonzero(~inside)[-1]) + 1
    nodes, inside = np.roll(nodes, -turn, axis=0), np.roll(inside, -turn)
    change = np.diff(inside.astype(np.int8), prepend=0, append=0)
    begin, end = np.flatnonzero(change > 0), np.flatnonzero(change < 0)
    return [nodes[i : j + 1] for i, j in zip(begin.tolist(), end.tolist(), strict=True)]


def _pieces(outlines: Areas, within: Areas) -> tuple[Float, Int, Bool]:
    """The rings cut at every crossing: where each piece begins (n, 2), on which side it lies, whether it is inside."""
    from printer_slicer.geometry.nearest import Outlines  # noqa: PLC0415 - few prints cut outlines

    begin, way = outlines.xy, outlines.xy[outlines.following] - outlines.xy
    layer = np.repeat(outlines.ring_layer, np.diff(outlines.ring_start))
    edge, share = _crossings(begin, way, layer, within)
    edge = np.concatenate([np.arange(len(begin)), edge])
    share = np.concatenate([np.zeros(len(begin)), share])
    order = np.lexsort((share, edge))
    edge, share = edge[order], share[order]
    # Where two outlines meet in a corner, rounding finds crossings a hair apart: one is enough.
    apart = np.diff(share) * np.hypot(*way.T)[edge[1:]] > _HAIR
    new = np.append(True, (np.diff(edge) != 0) | apart)
    edge, share = edge[new], share[new]
    until = np.append(np.where(np.diff(edge) == 0, share[1:], 1.0), 1.0)
    middle = begin[edge] + ((share + until) / 2)[:, None] * way[edge]
    inside = Outlines(within, middle.min(axis=0), middle.max(axis=0)).inside(middle, layer[edge])
    return begin[edge] + share[:, None] * way[edge], edge, inside


def _crossings(begin: Float, way: Float, layer: Int, within: Areas) -> tuple[Int, Float]:
    """Which sides, from `begin` by `way` (E, 2) on their layers (E,), cross an outline, and at what share of them."""
    from printer_slicer.geometry.planar import SegmentTree  # noqa: PLC0415 - few prints cut outlines

    a, b = within.xy, within.xy[within.following]
    both = np.concatenate([begin, begin + way, a])
    # Each layer has a stretch of x of its own.
    apart = np.array([np.ptp(both[:, 0]) + 1.0, 0.0])
    own, other = (
        layer[:, None] * apart,
        np.repeat(within.ring_layer, np.diff(within.ring_start))[:, None] * apart,
    )
    tree = SegmentTree(np.stack([a + other, b + other], axis=1))
    edge, segment = tree.meeting(begin + own, begin + way + own)
    gap, along, across = a[segment] - begin[edge], way[edge], b[segment] - a[segment]
    turn = _cross(along, across)
    with np.errstate(divide="ignore", invalid="ignore"):
        u, v = _cross(gap, across) / turn, _cross(gap, along) / turn
    near = _HAIR / np.maximum(np.hypot(*along.T), _HAIR)
    meets = (u > near) & (u < 1 - near) & (v >= 0) & (v <= 1)
    return edge[meets], u[meets]


def _cross(a: Float, b: Float) -> Float:
    """Cross products of vectors (n, 2)."""
    return np.asarray(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
