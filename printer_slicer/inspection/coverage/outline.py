"""Measure the distance between the outline of the print and the outline of the part's section."""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.arrays import Float, Int, consecutive, frozen_array
from printer_slicer.geometry import Areas
from printer_slicer.geometry.segment_index import OutlineIndex
from printer_slicer.values import Struct, force_setattr

__all__ = ["OutlineDistances", "measure_outline_distances", "sample_outlines"]

_MAX_SPACING: Final = 0.5  # mm, largest spacing of samples along an outline
_MAX_DIFFERENCE: Final = 0.005  # mm; samples are added between neighbours with a larger difference
_REFINEMENT: Final = 8  # number of intervals into which added samples split an interval
_IGNORED_LENGTH: Final = 3.0  # mm of outline that `p95` may leave out, such as tips of narrow fins


class OutlineDistances(Struct, frozen=True, eq=False):
    """Distances between printed and intended outline of each layer, mm; nan if a layer lacks an outline.

    Attributes:
        p95: (L,) distance exceeded on a twentieth of the length of both outlines, and on at least 3 mm.
        largest: (L,) largest distance.
        place: (L, 2) mm, position of the largest distance.
    """

    p95: Float
    largest: Float
    place: Float

    def __post_init__(self) -> None:
        force_setattr(self, "p95", frozen_array(self.p95, np.float64, (-1,)))
        force_setattr(self, "largest", frozen_array(self.largest, np.float64, (len(self.p95),)))
        force_setattr(self, "place", frozen_array(self.place, np.float64, (len(self.p95), 2)))


def measure_outline_distances(sections: Areas, printed: Areas, speck: float = 0.0) -> OutlineDistances:
    """Return the distances between printed and intended outlines in each layer, measured at samples.

    Args:
        sections: sections of the part.
        printed: area covered by extrusions.
        speck: mm²; smaller islands of the sections may be missing, because no line fits.

    Samples are at most 0.5 mm apart, and at every corner. Where the distances of two neighbours differ, seven more are
    taken between them. This happens at corners, which no extrusion fills, and makes the share of their length exact.
    """
    n = sections.n_layers
    nothing = OutlineDistances(np.full(n, np.nan), np.full(n, np.nan), np.full((n, 2), np.nan))
    if not (sections.n_rings and printed.n_rings):
        return nothing
    low = np.minimum(sections.xy.min(axis=0), printed.xy.min(axis=0))
    high = np.maximum(sections.xy.max(axis=0), printed.xy.max(axis=0))
    samples = []
    area = sections.ring_area()
    counted = sections.select((area <= 0) | (area >= speck))
    for outlines, other in ((counted, printed), (printed, sections)):
        points, layer, weight, distance = _measure_distances(outlines, OutlineIndex(other, low, high))
        known = np.isfinite(distance)
        samples.append((points[known], layer[known], weight[known], distance[known]))
    points, layer, weight, distance = (np.concatenate(column) for column in zip(*samples, strict=True))
    order = np.lexsort((distance, layer))
    layer, weight, distance = layer[order], weight[order], distance[order]
    used, first = np.unique(layer, return_index=True)
    last = np.append(first[1:], len(layer)) - 1
    reached = np.cumsum(weight)
    before = reached[first] - weight[first]
    total = reached[last] - before
    quantile_index = np.searchsorted(
        reached, before + np.maximum(total - np.maximum(0.05 * total, _IGNORED_LENGTH), 0.0)
    )
    p95, largest, place = nothing.p95.copy(), nothing.largest.copy(), nothing.place.copy()
    p95[used], largest[used] = distance[np.minimum(quantile_index, last)], distance[last]
    place[used] = points[order[last]]
    return OutlineDistances(p95, largest, place)


def _measure_distances(areas: Areas, other: OutlineIndex) -> tuple[Float, Int, Float, Float]:
    """Return points along all outlines (P, 2), and the layer, represented length and distance of each, mm."""
    points, layer, weight, after = sample_outlines(areas)
    distance = other.distance(points, layer)
    # In each layer, either all distances are finite or all are infinite.
    needs_refinement = np.isfinite(distance)
    needs_refinement[needs_refinement] = (
        np.abs(distance[after[needs_refinement]] - distance[needs_refinement]) > _MAX_DIFFERENCE
    )
    refined = np.flatnonzero(needs_refinement)
    share = np.arange(1, _REFINEMENT)[None, :, None] / _REFINEMENT
    extra_points = points[refined, None] + share * (points[after[refined]] - points[refined])[:, None]
    source = np.repeat(refined, _REFINEMENT - 1)
    weight[refined] /= _REFINEMENT
    return (
        np.concatenate([points, extra_points.reshape(-1, 2)]),
        np.concatenate([layer, layer[source]]),
        np.concatenate([weight, weight[source]]),
        np.concatenate([distance, other.distance(extra_points.reshape(-1, 2), layer[source])]),
    )


def sample_outlines(areas: Areas) -> tuple[Float, Int, Float, Int]:
    """Return points along all outlines (P, 2), and the layer, represented length and next point of each."""
    way = areas.xy[areas.following] - areas.xy
    length = np.hypot(*way.T)
    count = np.maximum(np.ceil(length / _MAX_SPACING), 1).astype(np.int64)
    side = np.repeat(np.arange(len(way)), count)
    share = consecutive(np.zeros(len(way), np.int64), count) / count[side]
    points = areas.xy[side] + share[:, None] * way[side]
    after = np.arange(1, len(side) + 1)
    # The last sample of a side is followed by the first one of the next side.
    first = np.cumsum(count) - count
    after[first + count - 1] = first[areas.following]
    return points, areas.point_layer[side], (length / count)[side], after
