"""Measure the distance between the rings of a stack, and find where a ring meets itself.

Edge `i` of a stack runs from point `i` to the point after it around its ring.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.geometry import Areas
from printer_slicer.geometry.facet_topology import expand_counts
from printer_slicer.geometry.planar import SegmentTree
from printer_slicer.geometry.segment_index import distance_to_segments
from printer_slicer.geometry.vectors import cross

__all__ = ["find_ring_contacts", "measure_clearance"]

_SAME: Final = 1e-9  # mm; edges closer than this touch
_RUN: Final = 16  # edges per run
_AT_ONCE: Final = 2048  # runs per query; in dense contours each may have hundreds of others in reach


def measure_clearance(areas: Areas, reach: float) -> Float:
    """Return the distance (N,) from each edge to the nearest other ring of its layer, mm, at most `reach`."""
    result = np.full(len(areas.xy), reach)
    for here, there in _find_near_edges(areas, reach, same_ring=False):
        gap = _measure_edge_distance(areas, here, there)
        np.minimum.at(result, here, gap)
        np.minimum.at(result, there, gap)
    return result


def find_ring_contacts(areas: Areas) -> tuple[Int, Int]:
    """Return pairs of edges of the same ring that cross or touch, except neighbours at their common point."""
    found = [(np.zeros(0, np.int64), np.zeros(0, np.int64))]
    for here, there in _find_near_edges(areas, _SAME, same_ring=True):
        meet = _mark_meeting_edges(areas, here, there)
        found.append((here[meet], there[meet]))
    firsts, seconds = zip(*found, strict=True)
    return np.concatenate(firsts), np.concatenate(seconds)


def _mark_meeting_edges(areas: Areas, first: Int, second: Int) -> Bool:
    """Return a mask (P,) of pairs of edges of one ring that meet, except neighbours at their common point."""
    following = areas.following
    closes = following[second] == first  # the last edge of a ring and its first
    first, second = np.where(closes, second, first), np.where(closes, first, second)
    neighbours = following[first] == second
    gap = np.zeros(len(first))
    gap[~neighbours] = _measure_edge_distance(areas, first[~neighbours], second[~neighbours])
    # Two edges from one point touch elsewhere only if the far end of one lies on the other.
    begin, corner = areas.xy[first[neighbours]], areas.xy[second[neighbours]]
    end = areas.xy[following[second[neighbours]]]
    folded = np.minimum(distance_to_segments(begin, corner, end), distance_to_segments(end, begin, corner))
    gap[neighbours] = folded
    return np.asarray(gap <= _SAME)


def _find_near_edges(areas: Areas, reach: float, *, same_ring: bool) -> Iterator[tuple[Int, Int]]:
    """Yield batches of pairs of edges on one layer whose boxes are at most `reach` mm apart, lower index first.

    Consecutive edges are close together, so runs of edges are looked up first, and then the edges in nearby runs are
    compared.

    Args:
        areas: the contours.
        reach: mm.
        same_ring: whether the edges of a pair belong to the same ring or to different ones.
    """
    if not areas.n_rings:
        return
    sizes = np.diff(areas.ring_start)
    ring, number = expand_counts(-(-sizes // _RUN))
    first = areas.ring_start[ring] + number * _RUN
    last = np.append(first[1:], len(areas.xy))
    begin, end = areas.xy, areas.xy[areas.following]
    # Use twice the reach, because the corners of the boxes are rounded far from the origin.
    low, high = np.minimum(begin, end) - reach, np.maximum(begin, end) + reach
    box_low, box_high = np.minimum.reduceat(low, first), np.maximum.reduceat(high, first)
    # Use one tree for all layers: each layer has its own cell on a square lattice, out of reach of the others.
    span = float((box_high.max(axis=0) - box_low.min(axis=0)).max())
    side = int(np.ceil(np.sqrt(areas.n_layers)))
    cell = np.column_stack(np.divmod(areas.ring_layer[ring], side)) * (span + 1.0)
    box_low, box_high = box_low + cell, box_high + cell
    tree = SegmentTree(np.stack([box_low, box_high], axis=1))
    # Store runs as rows; the padding of short runs meets nothing.
    edge = first[:, None] + np.arange(_RUN)
    there = edge < last[:, None]
    edge = np.minimum(edge, len(areas.xy) - 1)
    lows = [np.where(there, column[edge], np.inf) for column in low.T]
    highs = [np.where(there, column[edge], -np.inf) for column in high.T]
    for at in range(0, len(first), _AT_ONCE):
        one, other = tree.query_boxes(box_low[at : at + _AT_ONCE], box_high[at : at + _AT_ONCE])
        one += at
        wanted = np.flatnonzero((one <= other) & ((ring[one] == ring[other]) == same_ring))
        for begin_at in range(0, len(wanted), _AT_ONCE):
            some = wanted[begin_at : begin_at + _AT_ONCE]
            run, here, beside = _find_touching_boxes(lows, highs, one[some], other[some])
            lower, higher = first[one[some][run]] + here, first[other[some][run]] + beside
            once = lower < higher
            yield lower[once], higher[once]


def _find_touching_boxes(
    lows: Sequence[Float], highs: Sequence[Float], one: Int, other: Int
) -> tuple[Int, Int, Int]:
    """Find the pairs of touching boxes in pairs (P,) of rows; return the pair of rows, and the column of each box.

    Args:
        lows: (R, n) lower bounds of the boxes, along x and along y.
        highs: (R, n) upper bounds.
        one: (P,) first row of each pair.
        other: (P,) second row of each pair.
    """
    meet = np.ones((len(one), lows[0].shape[1], lows[0].shape[1]), np.bool_)
    for low, high in zip(lows, highs, strict=True):
        meet &= low[one][:, :, None] <= high[other][:, None, :]
        meet &= high[one][:, :, None] >= low[other][:, None, :]
    pair, here, beside = np.nonzero(meet)
    return pair, here, beside


def _measure_edge_distance(areas: Areas, first: Int, second: Int) -> Float:
    """Return the distance (P,) between the edges of each pair, mm; 0 where they cross."""
    following = areas.following
    a, b = areas.xy[first], areas.xy[following[first]]
    c, d = areas.xy[second], areas.xy[following[second]]
    ends = [distance_to_segments(*way) for way in ((a, c, d), (b, c, d), (c, a, b), (d, a, b))]
    crossing = (_compute_side_of_line(a, b, c) * _compute_side_of_line(a, b, d) < 0) & (
        _compute_side_of_line(c, d, a) * _compute_side_of_line(c, d, b) < 0
    )
    return np.where(crossing, 0.0, np.minimum.reduce(ends))


def _compute_side_of_line(a: Float, b: Float, point: Float) -> Float:
    """Return the side (P,) of the line from a to b on which each point lies: positive for left, negative for right."""
    return cross(b - a, point - a)
