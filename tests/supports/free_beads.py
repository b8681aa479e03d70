"""Beads of supports in the air: less than half their width over beads or the part just below."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, consecutive
from printer_slicer.geometry import find_enclosing_rings, normalize, stroke_lines, union
from printer_slicer.geometry.vectors import norm
from printer_slicer.model import Areas, Sections, Toolpaths

__all__ = ["draw_beads", "find_free_beads"]

_SAMPLE = 0.1  # mm
_PART_BELOW = 0.45  # mm
_LONGEST_FREE = 2.0  # mm, at an end
_LONGEST_SAG, _LONGEST_BRIDGE = 2.5, 6.0  # mm between two places that carry, curved or straight


def draw_beads(paths: Toolpaths) -> Areas:
    """What the beads of each layer cover."""
    lines = [np.append(line, line[:1], axis=0) if closed else line for line, closed in _split(paths)]
    order = np.argsort(paths.layer, kind="stable")
    start = np.append(0, np.cumsum([len(lines[index]) for index in order]))
    half = paths.width[paths.start[:-1]][order] / 2
    xy = np.concatenate([lines[index] for index in order])
    return normalize(stroke_lines(xy, start, paths.layer[order], half, paths.plan.n_layers))


def find_free_beads(paths: Toolpaths, sections: Sections) -> list[tuple[float, float, float, float]]:
    """x, y, z and length, mm, of stretches that hang at an end or as a whole, and of those that sag between ends."""
    layers, plan = paths.plan, sections.plan
    part = _unite(
        sections.solid,
        np.searchsorted(plan.top, layers.bottom - _PART_BELOW),
        np.searchsorted(plan.top, layers.bottom + 0.02),
    )
    carriers = union(draw_beads(paths).shift_layers(1), part)
    lines = [_sample(np.append(line, line[:1], axis=0) if closed else line) for line, closed in _split(paths)]
    count = np.array([len(line) for line in lines])
    on_free = ~_covers(carriers, np.concatenate(lines), np.repeat(paths.layer, count))
    found = []
    step = paths.length() / count
    for index, free in enumerate(np.split(on_free, np.cumsum(count)[:-1])):
        layer, closed = int(paths.layer[index]), bool(paths.closed[index])
        if layer and free.any():
            found += [
                (
                    *lines[index][run].mean(axis=0).tolist(),
                    float(layers.bottom[layer]),
                    len(run) * step[index],
                )
                for run in _runs(free, closed)
                if _hangs(run, lines[index], step[index], closed=closed)
            ]
    return found


def _split(paths: Toolpaths) -> list[tuple[Float, bool]]:
    """The points of each path, and whether it returns to its first point."""
    return list(zip(np.split(paths.xy, paths.start[1:-1]), paths.closed.tolist(), strict=True))


def _unite(areas: Areas, first: Int, last: Int) -> Areas:
    """For each entry the union of the layers from `first` to `last` - 1."""
    count = np.maximum(last - first, 0)
    entry = np.repeat(np.arange(len(first)), count)
    copies = areas.copy_layers(consecutive(first, count))
    return normalize(Areas(copies.xy, copies.ring_start, entry[copies.ring_layer], len(first)))


def _sample(line: Float) -> Float:
    """Points along a line, about 0.1 mm apart."""
    at = np.append(0.0, np.cumsum(norm(np.diff(line, axis=0))))
    count = max(int(np.ceil(at[-1] / _SAMPLE)), 1)
    place = (np.arange(count) + 0.5) / count * at[-1]
    return np.column_stack([np.interp(place, at, line[:, axis]) for axis in (0, 1)])


def _covers(areas: Areas, points: Float, layer: Int) -> Bool:
    """Mask of the points that lie in the areas of their layer (n,)."""
    order = np.argsort(layer, kind="stable")
    ring = np.zeros(len(points), np.int64)
    ring[order] = find_enclosing_rings(areas, points[order], layer[order])
    return np.asarray((ring >= 0) & (areas.ring_area()[ring] > 0))


def _runs(free: Bool, closed: bool) -> list[Int]:
    """Runs of free samples; in a closed path, one may lead over its beginning."""
    order = np.arange(len(free))
    if closed and not free.all():
        order = np.roll(order, -int(np.argmin(free)))
    chosen = np.flatnonzero(free[order])
    return [order[run] for run in np.split(chosen, np.flatnonzero(np.diff(chosen) > 1) + 1) if len(run)]


def _hangs(run: Int, points: Float, step: float, *, closed: bool) -> bool:
    """Whether a run of free samples, `step` mm each, is in the air or sags."""
    length = len(run) * step
    if len(run) == len(points):
        return True
    if not closed and (run[0] == 0 or run[-1] == len(points) - 1):
        return length > _LONGEST_FREE
    chord = float(norm(points[run[-1]] - points[run[0]]))
    return length > (_LONGEST_BRIDGE if chord > 0.95 * (length - step) else _LONGEST_SAG)
