"""The default geometry engine with the compiled kernel: the same results as `clipper`, in half the time.

The kernel contains Clipper2, in the version of the Python binding that `clipper` uses. Layers are `Areas` whose points
lie on the integer grid; spikes are still there.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from printer_slicer.arrays import Float, Int, consecutive, unique_inverse
from printer_slicer.geometry.areas import Areas
from printer_slicer.geometry.polygons import CLEARANCE, MITER_LIMIT, Join, OpenLines, Operation
from printer_slicer.geometry.spikes import remove_spikes
from printer_slicer.kernel import Kernel, load_kernel

__all__ = [
    "combine",
    "concatenate",
    "load",
    "load_any",
    "offset",
    "offset_open",
    "outlines_within",
    "store",
    "stroke",
    "take",
]

# In the order of the kernel.
_OPERATIONS: Final[Sequence[Operation]] = ("union", "difference", "intersection")


def load(areas: Areas) -> Areas:
    """Return the areas; the kernel rounds them to the grid."""
    return areas


def load_any(areas: Areas) -> Areas:
    """Merge any rings by the positive fill rule."""
    return combine("union", areas, Areas.empty(areas.n_layers))


def store(layers: Areas) -> Areas:
    """Remove the spikes."""
    return remove_spikes(layers)


def take(layers: Areas, indices: Int) -> Areas:
    """Return the layers with these indices (n,), in this order."""
    return layers.copy_layers(indices)


def concatenate(layers: Areas, others: Areas) -> Areas:
    """Return the layers followed by the others."""
    n_layers = layers.n_layers + others.n_layers
    return Areas.concatenate(
        [
            Areas(part.xy, part.ring_start, part.ring_layer + before, n_layers)
            for part, before in ((layers, 0), (others, layers.n_layers))
        ],
        n_layers,
    )


def combine(operation: Operation, a: Areas, b: Areas) -> Areas:
    """Return the union, difference or intersection of two stacks, layer by layer."""
    result = _combine_once(operation, a, b)
    if operation == "union":  # twice, as in `clipper`
        result = _combine_once("union", result, Areas.empty(result.n_layers))
    return result


def _combine_once(operation: Operation, a: Areas, b: Areas) -> Areas:
    """Combine the layers; union only once."""
    parts = (array for areas in (a, b) for array in (areas.xy, areas.ring_start, areas.ring_layer))
    return Areas.from_buffers(_kernel().combine_areas(_OPERATIONS.index(operation), *parts), a.n_layers)


def offset(layers: Areas, distance: Float, join: Join) -> Areas:
    """Move the outlines of each layer outward by its distance, mm."""
    if join == "round":
        return _inflate(layers, distance)
    return _combine_once("union", _miter(layers, distance, MITER_LIMIT), Areas.empty(layers.n_layers))


def offset_open(layers: Areas, distance: Float, limit: float) -> Areas:
    """Remove everything narrower than twice the distance, mm, from each layer."""
    grown = _miter(offset(layers, -distance, "miter"), distance + CLEARANCE, limit)
    return combine("intersection", layers, grown)


def _miter(layers: Areas, distance: Float, limit: float) -> Areas:
    """Move outlines outward with mitered corners; the rings may cross themselves and each other."""
    made = _kernel().miter_areas(
        layers.xy, layers.ring_start, layers.ring_layer, distance[layers.ring_layer], limit
    )
    return Areas.from_buffers(made, layers.n_layers)


def outlines_within(outlines: Areas, layers: Areas) -> OpenLines:
    """Return the parts of the rings of `outlines` that lie within the areas of their layer."""
    parts = (
        array for areas in (outlines, layers) for array in (areas.xy, areas.ring_start, areas.ring_layer)
    )
    xy, start, layer = _kernel().clip_outlines(*parts)
    size: Int = np.diff(np.frombuffer(start, np.int64)).astype(np.int64)
    return np.frombuffer(xy).reshape(-1, 2), size, np.frombuffer(layer, np.int64)


def stroke(xy: Float, start: Int, layer: Int, radius: Float, n_layers: int) -> Areas:
    """Return for each layer the area within a radius of its open polylines."""
    # Lines of one radius form a group; groups are in the order of the layers and then of their first lines.
    _, kind = unique_inverse(radius)
    groups, group = unique_inverse(layer * (int(kind.max(initial=0)) + 1) + kind)
    first = np.full(len(groups), len(layer))
    np.minimum.at(first, group, np.arange(len(layer)))
    group_order = np.lexsort((first, layer[first]))
    rank = np.zeros(len(groups), np.int64)
    rank[group_order] = np.arange(len(groups))
    order = np.argsort(rank[group], kind="stable")
    size = np.diff(start)[order]
    points = xy.take(consecutive(start[order], size), axis=0)
    made = _kernel().inflate_paths(
        points, np.append(0, np.cumsum(size)), rank[group][order], radius[order], False
    )
    drawn, group_layer = Areas.from_buffers(made, len(groups)), layer[first][group_order]
    drawn = Areas(drawn.xy, drawn.ring_start, group_layer[drawn.ring_layer], n_layers)
    return combine("union", drawn, Areas.empty(n_layers)) if (np.diff(group_layer) == 0).any() else drawn


def _inflate(layers: Areas, distance: Float) -> Areas:
    """Move the outlines of each layer outward by its distance, mm, with round joins."""
    by = distance[layers.ring_layer]
    made = _kernel().inflate_paths(layers.xy, layers.ring_start, layers.ring_layer, by, True)
    return Areas.from_buffers(made, layers.n_layers)


def _kernel() -> Kernel:
    kernel = load_kernel()
    assert kernel is not None
    return kernel
