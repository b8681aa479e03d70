"""Default geometry engine: Clipper2 on integer coordinates.

A layer is a list of rings, each an (n, 2) array of int64. On this grid the operations are exact except
for the rounding of new points, and they never fail, whatever rings cross.
"""

from __future__ import annotations

import sys
from importlib.machinery import PathFinder
from importlib.util import find_spec, module_from_spec
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from printer_slicer.arrays import Float, Int, bounding_boxes
from printer_slicer.geometry.areas import Areas
from printer_slicer.geometry.mitering import miter_rings
from printer_slicer.geometry.polygons import (
    CLEARANCE,
    MITER_LIMIT,
    ROUND_TOLERANCE,
    STEPS_PER_MM,
    Join,
    OpenLines,
    Operation,
    gather_lines,
)
from printer_slicer.geometry.spikes import remove_spikes

__all__ = [
    "CLIPPER2_VERSION",
    "combine",
    "concatenate",
    "load",
    "load_any",
    "offset",
    "offset_open",
    "outlines_within",
    "store",
    "store_with_spikes",
    "stroke",
    "take",
]


def _import_compiled_module() -> Any:
    """Import only the compiled module of the binding.

    Importing the whole package takes ten times as long: it looks up its own version and loads a second module for
    points with heights.
    """
    package, name = find_spec("clipper2"), "clipper2._clipper2"
    spec = PathFinder.find_spec(name, package.submodule_search_locations) if package else None
    if name in sys.modules or spec is None or spec.loader is None:
        import clipper2 as whole  # noqa: PLC0415 - only if the package has another layout or is already loaded

        return whole
    module = sys.modules[name] = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


if TYPE_CHECKING:
    import clipper2
else:
    clipper2 = _import_compiled_module()

CLIPPER2_VERSION: Final[str] = clipper2.CLIPPER2_VERSION

Rings = list[NDArray[np.int64]]

CLIP_TYPES: Final = {
    "union": clipper2.ClipType.UNION,
    "difference": clipper2.ClipType.DIFFERENCE,
    "intersection": clipper2.ClipType.INTERSECTION,
}
_CROWDED: Final = 16  # rings of a layer; for fewer, splitting takes longer than it saves
_LEAST: Final = 0.5  # grid steps; smaller offsets are skipped


def load(areas: Areas) -> list[Rings]:
    """Convert the areas to the rings of each layer on the integer grid, as views of one array."""
    grid = np.rint(areas.xy * STEPS_PER_MM).astype(np.int64)
    bounds = areas.ring_start.tolist()
    rings = [grid[start:end] for start, end in pairwise(bounds)]
    bounds = areas.layer_start.tolist()
    return [rings[start:end] for start, end in pairwise(bounds)]


def load_any(areas: Areas) -> list[Rings]:
    """Convert any rings to the rings of each layer on the integer grid, merged by the positive fill rule."""
    layers = load(areas)
    return combine("union", layers, [[] for _ in layers])


def store(layers: list[Rings]) -> Areas:
    """Convert the rings of all layers to one stack in mm, and remove the spikes."""
    return remove_spikes(store_with_spikes(layers))


def store_with_spikes(layers: list[Rings]) -> Areas:
    """Convert the rings of all layers to one stack in mm."""
    xy, start, ring_layer = _concatenate_rings(layers)
    # Divide, do not multiply: n / 100 000 is the double nearest to the decimal number, n * 0.00001 is not.
    return Areas(xy / STEPS_PER_MM, start, ring_layer, len(layers))


def take(layers: list[Rings], indices: Int) -> list[Rings]:
    """Return the layers with these indices (n,), in this order."""
    return [layers[index] for index in indices.tolist()]


def concatenate(layers: list[Rings], others: list[Rings]) -> list[Rings]:
    """Return the layers followed by the others."""
    return layers + others


def _concatenate_rings(layers: list[Rings]) -> tuple[Int, Int, Int]:
    """Concatenate the rings of all layers: points (N, 2), offset (R + 1,) and layer (R,) of each ring."""
    rings = [ring for layer in layers for ring in layer]
    xy = np.concatenate(rings) if rings else np.zeros((0, 2), np.int64)
    start = np.cumsum(np.array([0, *map(len, rings)], dtype=np.int64))
    return xy, start, np.repeat(np.arange(len(layers)), [len(layer) for layer in layers])


def combine(operation: Operation, a: list[Rings], b: list[Rings]) -> list[Rings]:
    """Return the union, difference or intersection of two lists of layers, entry by entry."""
    result = _combine_by_column(operation, a, b)
    if operation == "union":
        # Clipper2 sometimes does not join shells that touch along a side (1 in 1000 layers of random rectangles),
        # and an offset would open a gap between them. A second union joined them in 20 000 of 20 000 trials.
        result = _combine_by_column("union", result, [[] for _ in result])
    return result


def _combine_by_column(operation: Operation, a: list[Rings], b: list[Rings]) -> list[Rings]:
    """Combine two lists of layers entry by entry; split crowded layers into columns first."""
    clipper = clipper2.Clipper64()
    clipper.preserve_collinear = False
    kind, result = CLIP_TYPES[operation], []

    def combine_rings(subjects: Rings, clips: Rings) -> Rings:
        """Combine the rings of one layer, or of one column of a crowded layer."""
        if (subjects or (clips and operation == "union")) and (clips or operation != "intersection"):
            clipper.clear()
            clipper.add_subject(subjects)
            clipper.add_clip(clips)
            found: Rings = clipper.execute(kind, clipper2.FillRule.POSITIVE)[0]
            return found
        return []

    crowded = _split_columns(a, b)
    for layer, (subjects, clips) in enumerate(zip(a, b, strict=True)):
        if layer in crowded:
            result.append([ring for pair in crowded[layer] for ring in combine_rings(*pair)])
        else:
            result.append(combine_rings(subjects, clips))
    return result


def _split_columns(a: list[Rings], b: list[Rings]) -> dict[int, list[tuple[Rings, Rings]]]:
    """Split the rings of crowded layers into columns, separated by gaps in x; return only layers with several columns.

    The sweep line runs from front to back, so its cost grows with the number of edges side by side.
    """
    count = np.array([(len(one), len(other)) for one, other in zip(a, b, strict=True)]).reshape(-1, 2)
    crowded_layers = np.flatnonzero(count.sum(axis=1) >= _CROWDED)
    if not len(crowded_layers):
        return {}
    rings = [ring for layer in crowded_layers.tolist() for ring in (*a[layer], *b[layer])]
    size, is_clip = count[crowded_layers].ravel(), np.tile([False, True], len(crowded_layers))
    is_clip, home = np.repeat(is_clip, size), np.repeat(crowded_layers, count[crowded_layers].sum(axis=1))
    low, high = _find_x_ranges(rings)
    # Shift the layers apart in x, so that all of them are split at once.
    beside = home * (int(high.max()) - int(low.min()) + 1)
    low, high = low + beside, high + beside
    order = np.argsort(low, kind="stable")
    begins = np.append(True, low[order][1:] > np.maximum.accumulate(high[order])[:-1])
    column = np.cumsum(begins) - 1
    order = order[np.lexsort((is_clip[order], column))]
    sorted_rings = list(map(rings.__getitem__, order.tolist()))
    starts = np.flatnonzero(begins)
    subjects = starts + np.bincount(column, ~is_clip[order], len(starts)).astype(np.int64)
    columns: dict[int, list[tuple[Rings, Rings]]] = {layer: [] for layer in crowded_layers.tolist()}
    bounds = zip(starts.tolist(), subjects.tolist(), [*starts[1:].tolist(), len(order)], strict=True)
    for layer, (first, middle, last) in zip(home[order[starts]].tolist(), bounds, strict=True):
        columns[layer].append((sorted_rings[first:middle], sorted_rings[middle:last]))
    return {layer: pairs for layer, pairs in columns.items() if len(pairs) > 1}


def _find_x_ranges(rings: Rings) -> tuple[Int, Int]:
    """Return the lowest and the highest x of each ring."""
    begin = np.cumsum([0, *map(len, rings)])[:-1]
    x = np.concatenate(rings)[:, 0]
    return np.minimum.reduceat(x, begin), np.maximum.reduceat(x, begin)


def outlines_within(outlines: Areas, layers: list[Rings]) -> OpenLines:
    """Return the parts of the rings of `outlines` that lie within the areas of their layer."""
    clipper, result = clipper2.Clipper64(), []
    for lines, clips in zip(_select_near_lines(outlines, layers), layers, strict=True):
        if lines and clips:
            clipper.clear()
            clipper.add_open_subject(lines)
            clipper.add_clip(clips)
            within = clipper.execute(clipper2.ClipType.INTERSECTION, clipper2.FillRule.POSITIVE)[1]
            result.append([line / STEPS_PER_MM for line in _rejoin_lines(within)])
        else:
            result.append([])
    return gather_lines(result)


def _select_near_lines(outlines: Areas, layers: list[Rings]) -> list[Rings]:
    """Return for each layer the rings of `outlines` as open lines, without the sides outside the layer's box."""
    result: list[Rings] = [[] for _ in layers]
    if not outlines.n_rings:
        return result
    grid = np.rint(outlines.xy * STEPS_PER_MM).astype(np.int64)
    xy, start, ring_layer = _concatenate_rings(layers)
    low, high = bounding_boxes(xy, start, ring_layer, len(layers))
    layer, ring, following = outlines.point_layer, outlines.point_ring, outlines.following
    near = np.ones(len(grid), np.bool_)
    for axis in (0, 1):
        begin = np.ascontiguousarray(grid[:, axis])
        end = begin.take(following)
        near &= (np.minimum(begin, end) <= high[layer, axis]) & (np.maximum(begin, end) >= low[layer, axis])
    # Consecutive sides form one line.
    kept = np.flatnonzero(near)
    first = np.flatnonzero(np.append(True, (np.diff(kept) != 1) | (np.diff(ring[kept]) != 0))[: len(kept)])
    starts, last = kept[first], kept[np.append(first[1:], len(kept)) - 1] if len(kept) else kept
    closing = following[last] < last
    for start, end, closes, home in zip(
        starts.tolist(),
        last.tolist(),
        closing.tolist(),
        outlines.ring_start[ring[last]].tolist(),
        strict=True,
    ):
        line = grid[start : end + 1 if closes else end + 2]
        result[layer[start]].append(np.concatenate([line, grid[home : home + 1]]) if closes else line)
    return result


def _rejoin_lines(lines: Rings) -> Rings:
    """Join lines that were cut at the first point of their ring."""
    begins = {(int(line[0, 0]), int(line[0, 1])): i for i, line in enumerate(lines)}
    whole = list(lines)
    for i, line in enumerate(lines):
        after = begins.get((int(line[-1, 0]), int(line[-1, 1])), i)
        if after != i and len(whole[i]) and len(whole[after]):
            whole[after] = np.concatenate([whole[i][:-1], whole[after]])
            whole[i] = line[:0]
    return [line for line in whole if len(line)]


def offset(layers: list[Rings], distance: Float, join: Join) -> list[Rings]:
    """Move the outlines of each layer outward by its distance, mm."""
    if join == "miter":
        return _combine_by_column("union", _miter_layers(layers, distance, MITER_LIMIT), [[] for _ in layers])
    inflater = clipper2.ClipperOffset(MITER_LIMIT, ROUND_TOLERANCE * STEPS_PER_MM)
    result = []
    for rings, by in zip(layers, (distance * STEPS_PER_MM).tolist(), strict=True):
        inflater.clear()
        if rings:
            inflater.add_paths(rings, clipper2.JoinType.ROUND, clipper2.EndType.POLYGON)
        result.append(inflater.execute(by) if rings else [])
    return result


def offset_open(layers: list[Rings], distance: Float, limit: float) -> list[Rings]:
    """Remove everything narrower than twice the distance, mm, from each layer."""
    # The grown outlines may cross themselves and each other; the intersection treats them as overlapping areas.
    grown = _miter_layers(offset(layers, -distance, "miter"), distance + CLEARANCE, limit)
    return combine("intersection", layers, grown)


def _miter_layers(layers: list[Rings], distance: Float, limit: float) -> list[Rings]:
    """Move outlines outward with mitered corners; parts that should vanish remain as reversed rings."""
    moving = np.abs(distance) * STEPS_PER_MM >= _LEAST
    rings = [ring for rings, moves in zip(layers, moving, strict=True) if moves for ring in rings]
    if not rings:
        return layers
    count = np.where(moving, [len(rings) for rings in layers], 0)
    start = np.cumsum([0, *map(len, rings)])
    xy, start = miter_rings(np.concatenate(rings), start, np.repeat(distance * STEPS_PER_MM, count), limit)
    ends = zip(start.tolist(), start[1:].tolist(), strict=False)
    moved = [xy[begin:end] for begin, end in ends]
    last = np.cumsum(count)
    return [
        moved[end - n : end] if moves else rings
        for rings, moves, n, end in zip(layers, moving.tolist(), count.tolist(), last.tolist(), strict=True)
    ]


def stroke(xy: Float, start: Int, layer: Int, radius: Float, n_layers: int) -> list[Rings]:
    """Return for each layer the area within a radius of its open polylines."""
    grid = np.rint(xy * STEPS_PER_MM).astype(np.int64)
    pens: dict[tuple[int, float], Rings] = {}
    for (begin, end), one, by in zip(pairwise(start.tolist()), layer.tolist(), radius.tolist(), strict=True):
        pens.setdefault((one, by), []).append(grid[begin:end])
    inflater = clipper2.ClipperOffset(MITER_LIMIT, ROUND_TOLERANCE * STEPS_PER_MM)
    result: list[Rings] = [[] for _ in range(n_layers)]
    several = [False] * n_layers
    for (one, by), lines in pens.items():
        inflater.clear()
        inflater.add_paths(lines, clipper2.JoinType.ROUND, clipper2.EndType.ROUND)
        several[one] = bool(result[one])
        result[one] = result[one] + inflater.execute(by * STEPS_PER_MM)
    return combine("union", result, [[] for _ in result]) if any(several) else result
