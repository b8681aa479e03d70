"""Measure the distance between the printed outline and the outline of the section."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from printer_slicer.arrays import Float, Int, consecutive, frozen_array
from printer_slicer.geometry import Areas
from printer_slicer.geometry.segment_index import OutlineIndex

__all__ = ["OutlineError", "outline_error", "sample_outlines"]

_APART: Final = 0.5  # mm between samples along an outline, at most
_ROUGH: Final = 0.005  # mm by which the distances of neighbouring samples may differ without a closer look
_FINER: Final = 8  # as many samples there
_SHORT: Final = 3.0  # mm of both outlines that are ignored: tips of fins narrower than any line


@dataclass(frozen=True, slots=True, eq=False)
class OutlineError:
    """Distances between two outlines of each layer, both ways, mm; nan where a layer lacks one of them.

    Attributes:
        p95: (L,) exceeded on a twentieth of the length of both, and on 3 mm of it.
        largest: (L,) the largest.
        place: (L, 2) where that is.
    """

    p95: Float
    largest: Float
    place: Float

    def __post_init__(self) -> None:
        object.__setattr__(self, "p95", frozen_array(self.p95, np.float64, (-1,)))
        object.__setattr__(self, "largest", frozen_array(self.largest, np.float64, (len(self.p95),)))
        object.__setattr__(self, "place", frozen_array(self.place, np.float64, (len(self.p95), 2)))


def outline_error(sections: Areas, printed: Areas, speck: float = 0.0) -> OutlineError:
    """Return the distances of samples on each outline from the other, layer by layer.

    Args:
        sections: sections of the part.
        printed: area covered by extrusions.
        speck: mm²; smaller islands of the sections may be missing, because no line fits.

    Samples are 0.5 mm apart at most, and at every corner. Where the distances of two neighbours differ, as they do at
    corners, which no bead fills, seven more lie between them: corners are short, and it is a share of the length that
    is told.
    """
    n = sections.n_layers
    nothing = OutlineError(np.full(n, np.nan), np.full(n, np.nan), np.full((n, 2), np.nan))
    if not (sections.n_rings and printed.n_rings):
        return nothing
    low = np.minimum(sections.xy.min(axis=0), printed.xy.min(axis=0))
    high = np.maximum(sections.xy.max(axis=0), printed.xy.max(axis=0))
    parts = []
    area = sections.ring_area()
    counted = sections.select((area <= 0) | (area >= speck))
    for own, other in ((counted, printed), (printed, sections)):
        points, layer, weight, distance = _measured(own, OutlineIndex(other, low, high))
        known = np.isfinite(distance)
        parts.append((points[known], layer[known], weight[known], distance[known]))
    points, layer, weight, distance = (np.concatenate(column) for column in zip(*parts, strict=True))
    order = np.lexsort((distance, layer))
    layer, weight, distance = layer[order], weight[order], distance[order]
    used, first = np.unique(layer, return_index=True)
    last = np.append(first[1:], len(layer)) - 1
    reached = np.cumsum(weight)
    before = reached[first] - weight[first]
    total = reached[last] - before
    wanted = np.searchsorted(reached, before + np.maximum(total - np.maximum(0.05 * total, _SHORT), 0.0))
    p95, largest, place = nothing.p95.copy(), nothing.largest.copy(), nothing.place.copy()
    p95[used], largest[used] = distance[np.minimum(wanted, last)], distance[last]
    place[used] = points[order[last]]
    return OutlineError(p95, largest, place)


def _measured(own: Areas, other: OutlineIndex) -> tuple[Float, Int, Float, Float]:
    """Return points along all outlines (P, 2), their layers, the length each represents, and its distance, mm."""
    points, layer, weight, after = sample_outlines(own)
    distance = other.distance(points, layer)
    # A layer has the other outline everywhere or nowhere.
    rough = np.isfinite(distance)
    rough[rough] = np.abs(distance[after[rough]] - distance[rough]) > _ROUGH
    chosen = np.flatnonzero(rough)
    share = np.arange(1, _FINER)[None, :, None] / _FINER
    more = points[chosen, None] + share * (points[after[chosen]] - points[chosen])[:, None]
    near = np.repeat(chosen, _FINER - 1)
    weight[chosen] /= _FINER
    return (
        np.concatenate([points, more.reshape(-1, 2)]),
        np.concatenate([layer, layer[near]]),
        np.concatenate([weight, weight[near]]),
        np.concatenate([distance, other.distance(more.reshape(-1, 2), layer[near])]),
    )


def sample_outlines(areas: Areas) -> tuple[Float, Int, Float, Int]:
    """Return points along all outlines (P, 2), their layers, the length of each, mm, and the index of the next."""
    way = areas.xy[areas.following] - areas.xy
    length = np.hypot(*way.T)
    count = np.maximum(np.ceil(length / _APART), 1).astype(np.int64)
    side = np.repeat(np.arange(len(way)), count)
    share = consecutive(np.zeros(len(way), np.int64), count) / count[side]
    points = areas.xy[side] + share[:, None] * way[side]
    after = np.arange(1, len(side) + 1)
    # After the last sample of a side comes the first one of the side that follows.
    first = np.cumsum(count) - count
    after[first + count - 1] = first[areas.following]
    return points, areas.point_layer[side], (length / count)[side], after
