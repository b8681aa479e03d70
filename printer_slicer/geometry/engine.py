"""Polygon operations on the areas of a whole stack, and the choice of the engine that does them.

All functions except `normalize` and `simplify` expect clean areas, and all except `simplify` return them: simple
rings that may touch but not cross, solids counter-clockwise, holes clockwise. Results are rounded to 0.01 µm.
The engine is chosen when it is first needed.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cache
from typing import Final

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, consecutive, distinct, per_layer
from printer_slicer.errors import UsageError
from printer_slicer.geometry.areas import Areas
from printer_slicer.geometry.boxes import Boxes
from printer_slicer.geometry.outline_simplification import simplify_outlines
from printer_slicer.geometry.polygons import MITER_LIMIT, Join, Operation, Polygons
from printer_slicer.geometry.windows import intersect_windows
from printer_slicer.kernel import load_kernel

__all__ = [
    "close_gaps",
    "difference",
    "fits_circle",
    "intersection",
    "load_engine",
    "normalize",
    "offset",
    "offset_open",
    "outlines_within",
    "simplify",
    "stroke_lines",
    "union",
    "using_engine",
    "window_intersection",
    "window_intersections",
]

_ROUNDING: Final = 0.99  # of the area of a circle: allows for rounded points
_CROWD: Final = 16  # rings per layer on average; with fewer, all rings go to the engine
VARIABLE: Final = "PRINTER_SLICER_GEOMETRY"


def _load_clipper() -> Polygons:
    if load_kernel():
        from printer_slicer.geometry import compiled_clipper  # noqa: PLC0415 - each run loads one engine

        return compiled_clipper
    from printer_slicer.geometry import clipper  # noqa: PLC0415

    return clipper


def _load_planar() -> Polygons:
    from printer_slicer.geometry import planar  # noqa: PLC0415 - each run loads one engine

    return planar


ENGINES: Final[Mapping[str, Callable[[], Polygons]]] = {"clipper": _load_clipper, "planar": _load_planar}

_override: ContextVar[str | None] = ContextVar("engine", default=None)


def load_engine(name: str) -> Polygons:
    """Import and return the engine of this name.

    Raises:
        UsageError: there is no engine of this name.
    """
    if name not in ENGINES:
        raise UsageError(
            f"unknown geometry engine {name!r} in {VARIABLE}",
            remedy=f"Use one of: {', '.join(ENGINES)}",
        )
    return ENGINES[name]()


@contextmanager
def using_engine(name: str) -> Iterator[None]:
    """Use the engine of this name inside the `with` block, in this thread.

    Raises:
        UsageError: there is no engine of this name.
    """
    load_engine(name)
    token = _override.set(name)
    try:
        yield
    finally:
        _override.reset(token)


@cache
def _default_name() -> str:
    return os.environ.get(VARIABLE) or "clipper"


def _current_engine() -> Polygons:
    return load_engine(_override.get() or _default_name())


def normalize(areas: Areas) -> Areas:
    """Return clean areas that cover everything with a positive winding number.

    Overlapping or self-crossing shells merge; a ring that runs clockwise on its own covers nothing.
    """
    engine = _current_engine()
    return engine.store(engine.load_any(areas))


def union(a: Areas, b: Areas) -> Areas:
    """Return the union of `a` and `b`, layer by layer.

    Raises:
        ValueError: the stacks have different numbers of layers.
    """
    worked, meets = _combine_near("union", a, b)
    return worked.merge(a.of_layers(~meets)).merge(b.of_layers(~meets))


def difference(a: Areas, b: Areas) -> Areas:
    """Return `a` without `b`, layer by layer.

    Raises:
        ValueError: the stacks have different numbers of layers.
    """
    worked, meets = _combine_near("difference", a, b)
    return worked.merge(a.of_layers(~meets))


def intersection(a: Areas, b: Areas) -> Areas:
    """Return the intersection of `a` and `b`, layer by layer.

    Raises:
        ValueError: the stacks have different numbers of layers.
    """
    return _combine_near("intersection", a, b)[0]


def offset(areas: Areas, distance: float | Float, *, join: Join = "miter") -> Areas:
    """Grow the areas by `distance` on all sides, or shrink them if it is negative.

    Args:
        areas: clean areas.
        distance: mm, one for all layers or one per layer.
        join: how the gap at a corner is closed. "miter" extends both sides to a point if the point is at most
            twice the distance from the corner (corners of 60° and more); sharper corners are cut off square at
            the distance. "round" follows a circle to 0.005 mm.

    Raises:
        ValueError: `distance` has another length or is not finite.
    """
    engine, by, some = (
        _current_engine(),
        _check_distances(distance, areas.n_layers),
        distinct(areas.ring_layer),
    )
    layers = engine.load(_pick_layers(areas, some))
    return _restore_layers(engine.store(engine.offset(layers, by[some], join)), some, areas.n_layers)


def close_gaps(areas: Areas, distance: float) -> Areas:
    """Fill gaps and notches narrower than twice `distance`, mm: grow the areas, then shrink them again."""
    return offset(offset(areas, distance), -distance)


def offset_open(areas: Areas, distance: float | Float, limit: float = MITER_LIMIT) -> Areas:
    """Remove everything narrower than twice `distance`: shrink the areas, then grow them again.

    The result lies within the original: anything that the mitered joins add beyond it is cut off. Remaining corners
    of 60° and more keep their points; sharper ones are cut off square.

    Args:
        areas: clean areas.
        distance: mm, not negative; one for all layers or one per layer.
        limit: corners with a point farther away than this many distances are cut off.

    Raises:
        ValueError: `distance` has another length, is negative or not finite.
    """
    by = _check_distances(distance, areas.n_layers)
    if (by < 0).any():
        raise ValueError("the distance by which areas are shrunk and grown again must be 0 or more")
    # No circle of this radius fits into a ring with less area than the circle. A hole without its ring covers nothing.
    size = areas.ring_area()
    areas = areas.select((size <= 0) | (size > _ROUNDING * np.pi * by[areas.ring_layer] ** 2))
    engine, some = _current_engine(), distinct(areas.ring_layer)
    layers = engine.load(_pick_layers(areas, some))
    return _restore_layers(engine.store(engine.offset_open(layers, by[some], limit)), some, areas.n_layers)


def fits_circle(areas: Areas, radius: float) -> Bool:
    """Return a mask (n_layers,) of layers into which a circle fits.

    Args:
        areas: clean areas.
        radius: of the circle, mm, greater than 0.
    """
    low, high = areas.boxes()
    some = np.flatnonzero((high - low >= 2 * _ROUNDING * radius).all(axis=1))
    result = np.zeros(areas.n_layers, np.bool_)
    result[some] = offset(areas.copy_layers(some), -radius).used
    return result


def stroke_lines(xy: Float, start: Int, layer: Int, radius: Float, n_layers: int) -> Areas:
    """Return the area within a radius of polylines, layer by layer, as if drawn with a round pen.

    Round ends and corners follow the circle to 0.005 mm, from within. Radii are rounded to 0.001 mm, so that lines of
    nearly one width are drawn together.

    Args:
        xy: (N, 2) mm; polyline i is `xy[start[i]:start[i + 1]]`, of two points or more, and stays open.
        start: (M + 1,) offset of each polyline.
        layer: (M,) layer of each polyline, in any order.
        radius: (M,) mm, greater than 0: half the width of each line.
        n_layers: number of layers of the stack.

    Raises:
        ValueError: a radius is not greater than 0, or a layer is outside the stack.
    """
    if len(layer) and not (layer.min() >= 0 and layer.max() < n_layers):
        raise ValueError(f"a line is on a layer outside the stack of {n_layers} layers")
    steps = np.round(radius, 3)
    if not (np.isfinite(steps).all() and (steps > 0).all()):
        raise ValueError("the radius of each line must be greater than 0")
    engine = _current_engine()
    return engine.store(engine.stroke(xy, start, layer, steps, n_layers))


def outlines_within(outlines: Areas, areas: Areas) -> tuple[Float, Int, Int]:
    """Return the parts of outlines that lie within areas of the same layer, as open lines.

    The engine does this layer by layer. It suits many outlines with only short parts near the areas, such as narrow
    strips. `clip_outlines` also returns the ring of each part and whether it is the whole ring.

    Args:
        outlines: any rings.
        areas: clean areas.

    Returns:
        xy (N, 2) mm, number of points (M,) and layer (M,) of each line, by ascending layer. A ring that lies entirely
        within returns to its first point.

    Raises:
        ValueError: the stacks have different numbers of layers.
    """
    if outlines.n_layers != areas.n_layers:
        raise ValueError(
            f"the stacks have different numbers of layers: {outlines.n_layers} and {areas.n_layers}"
        )
    engine = _current_engine()
    return engine.outlines_within(outlines.of_layers(areas.used), engine.load(areas))


def simplify(areas: Areas, tolerance: float) -> Areas:
    """Remove points from rings, so that no outline moves by more than `tolerance` (Douglas-Peucker).

    Tolerance 0 removes only repeated points and those on the straight line between their neighbours. Rings
    that collapse or change direction are dropped. Rings may touch or cross afterwards: `normalize` cleans them. Each
    ring starts at its leftmost point (the lowest of several), which is always a corner, so the start of a ring
    keeps no extra point.

    Args:
        areas: any closed rings.
        tolerance: mm, not negative.

    Raises:
        ValueError: a negative tolerance.

    Source: Douglas & Peucker, Algorithms for the reduction of the number of points required to represent a
    digitized line or its caricature, 1973.
    """
    if not tolerance >= 0:
        raise ValueError(f"tolerance must be 0 or more, got {tolerance}")
    return simplify_outlines(areas, tolerance)


def window_intersection(areas: Areas, first: Int, last: Int) -> Areas:
    """Return for each layer k the intersection of the layers `first[k]` to `last[k] - 1`.

    The result of a window that reaches outside the stack is empty.

    Args:
        areas: clean areas.
        first: (n_layers,) first layer of each window.
        last: (n_layers,) one after its last layer.

    Raises:
        ValueError: the arrays have other shapes, or a window is empty.
    """
    return window_intersections(areas, [(first, last)])[0]


def window_intersections(areas: Areas, windows: Sequence[tuple[Int, Int]]) -> list[Areas]:
    """Return `window_intersection` for several windows (first, last) of each layer, with shared intermediate results.

    Raises:
        ValueError: as `window_intersection`.
    """
    n = areas.n_layers
    for first, last in windows:
        if first.shape != (n,) or last.shape != (n,):
            raise ValueError(f"expected one window per layer ({n}), got {first.shape} and {last.shape}")
        if (last <= first).any():
            layer = int(np.flatnonzero(last <= first)[0])
            raise ValueError(f"the window of layer {layer} is empty: {first[layer]} to {last[layer]}")
    inside = [np.flatnonzero((first >= 0) & (last <= n)) for first, last in windows]
    wide = [some[last[some] > first[some] + 1] for some, (first, last) in zip(inside, windows, strict=True)]
    made = iter(_intersect_wide_windows(areas, wide, windows))
    result = []
    for some, several, (first, _) in zip(inside, wide, windows, strict=True):
        single = np.full(n, -1)
        single[some] = first[some]
        single[several] = -1
        result.append(
            _copy_layers(areas, single).merge(next(made)) if len(several) else _copy_layers(areas, single)
        )
    return result


def _intersect_wide_windows(areas: Areas, wide: list[Int], windows: Sequence[tuple[Int, Int]]) -> list[Areas]:
    """Return the intersections over windows of two or more layers, for each entry of `windows` that has any."""
    ends = [(first[some], last[some]) for some, (first, last) in zip(wide, windows, strict=True) if len(some)]
    if not ends:
        return []
    engine, n_layers = _current_engine(), areas.n_layers
    first, last = (np.concatenate(column) for column in zip(*ends, strict=True))
    pool, size = engine.load(areas), n_layers

    def intersect(a: list[int], b: list[int]) -> list[int]:
        """Intersect layers of the pool; return the indices of the results, which are added to it."""
        nonlocal pool, size
        one, other = (engine.take(pool, np.array(indices, np.int64)) for indices in (a, b))
        pool, size = engine.concatenate(pool, engine.combine("intersection", one, other)), size + len(a)
        return list(range(size - len(a), size))

    made = np.array(intersect_windows(range(n_layers), first, last, intersect), np.int64)
    result, done = [], 0
    for some in wide:
        if len(some):
            own = engine.store(engine.take(pool, made[done : done + len(some)]))
            result.append(_restore_layers(own, some, n_layers))
            done += len(some)
    return result


def _copy_layers(areas: Areas, source: Int) -> Areas:
    """Return a stack in which each layer has the rings of the layer `source` (n_layers,), or nothing for -1."""
    filled = np.flatnonzero(source >= 0)
    bounds, source = areas.layer_start, source[filled]
    count = bounds[source + 1] - bounds[source]
    rings = consecutive(bounds[source], count)
    sizes = np.diff(areas.ring_start)[rings]
    points = areas.xy.take(consecutive(areas.ring_start[rings], sizes), axis=0)
    return Areas(points, np.append(0, np.cumsum(sizes)), np.repeat(filled, count), areas.n_layers)


def _check_distances(distance: float | Float, n_layers: int) -> Float:
    by = per_layer(distance, n_layers)
    if not np.isfinite(by).all():
        raise ValueError("offset distances must be finite")
    return by


def _combine_near(operation: Operation, a: Areas, b: Areas) -> tuple[Areas, Bool]:
    """Combine the layers where the bounding boxes of `a` and `b` overlap; return the result and a mask (n_layers,)."""
    if a.n_layers != b.n_layers:
        raise ValueError(f"the stacks have different numbers of layers: {a.n_layers} and {b.n_layers}")
    (low_a, high_a), (low_b, high_b) = a.boxes(), b.boxes()
    meets = np.all((low_a <= high_b) & (low_b <= high_a), axis=1)
    if not meets.any():
        return Areas.empty(a.n_layers), meets
    engine, some = _current_engine(), np.flatnonzero(meets)
    (a, apart_a), (b, apart_b) = _split_near(_pick_layers(a, some), _pick_layers(b, some))
    result = engine.store(engine.combine(operation, engine.load(a), engine.load(b)))
    if operation != "intersection":
        result = result.merge(apart_a)
    if operation == "union":
        result = result.merge(apart_b)
    return _restore_layers(result, some, len(meets)), meets


def _split_near(a: Areas, b: Areas) -> tuple[tuple[Areas, Areas], tuple[Areas, Areas]]:
    """Split each stack into the rings whose boxes overlap a box of the other stack, and the remaining rings.

    If there are only a few rings, all of them count as near.
    """
    if a.n_rings + b.n_rings < _CROWD * a.n_layers:
        nothing = Areas.empty(a.n_layers)
        return (a, nothing), (b, nothing)
    own, others = Boxes.of_rings(a).find_overlapping(Boxes.of_rings(b))
    near_a, near_b = np.zeros(a.n_rings, np.bool_), np.zeros(b.n_rings, np.bool_)
    near_a[own] = near_b[others] = True
    return (a.select(near_a), a.select(~near_a)), (b.select(near_b), b.select(~near_b))


def _pick_layers(areas: Areas, indices: Int) -> Areas:
    """Return the layers with these indices (n,), ascending, as a separate stack, so that empty layers cost no time."""
    return areas if len(indices) == areas.n_layers else areas.copy_layers(indices)


def _restore_layers(areas: Areas, indices: Int, n_layers: int) -> Areas:
    """Put picked layers back at their indices in a stack of `n_layers`."""
    if len(indices) == n_layers:
        return areas
    return Areas(areas.xy, areas.ring_start, indices[areas.ring_layer], n_layers)
