"""Find the position of a part in a file by fitting its sections to the external perimeters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, bounding_boxes
from printer_slicer.geometry import Areas
from printer_slicer.geometry.segment_index import OutlineIndex
from printer_slicer.inspection.coverage.extrusions import Extrusions, Purpose, spread_out
from printer_slicer.inspection.coverage.stack import Stack
from printer_slicer.inspection.deposition.marks import NOT_PART

__all__ = ["Match", "find_detached", "fit_sections", "guess_shift", "shift_areas"]

_POINTS: Final = 10_000  # enough to know a shift to a micrometre
_FEWEST: Final = 0.05  # of all points that must lie near outlines
_SAME_SIZE: Final = 0.3  # mm by which a layer's box may differ from its section's
_FAR: Final = 1.0  # mm beside the section: what stays farther away is no part of it


@dataclass(frozen=True, slots=True)
class Match:
    """The position of sections in a file, and how well they fit.

    Attributes:
        shift: x and y, mm, from where the sections were to where they fit.
        spread: median distance of the external perimeters from their expected position, mm.
        share: share of the length of the external perimeters within half a width of their expected position.
    """

    shift: tuple[float, float]
    spread: float
    share: float


def shift_areas(areas: Areas, by: Float | tuple[float, float]) -> Areas:
    """Shift areas; coordinates stay on the grid of the geometry."""
    xy = np.round(areas.xy + np.asarray(by), 5)
    return Areas(xy, areas.ring_start, areas.ring_layer, areas.n_layers)


def guess_shift(stack: Stack, sections: Areas) -> tuple[float, float]:
    """Return the shift between the bounding boxes of the sections and of the layers: the median over all layers.

    If there are layers whose box has the size of their section, only they count: skirts and brims make boxes wider.
    """
    beads, layer = stack.beads, stack.layer
    outer = _outer(beads) & (layer >= 0)
    half = beads.width[outer, None] / 2
    corners = np.stack(
        [
            np.minimum(beads.begin, beads.end)[outer] - half,
            np.maximum(beads.begin, beads.end)[outer] + half,
        ],
        axis=1,
    )
    order = np.argsort(layer[outer], kind="stable")
    start = np.arange(0, 2 * len(order) + 1, 2)
    low, high = bounding_boxes(corners[order].reshape(-1, 2), start, layer[outer][order], stack.n_layers)
    floor, ceiling = sections.boxes()
    both = np.isfinite(low[:, 0]) & np.isfinite(floor[:, 0])
    if not both.any():
        return 0.0, 0.0
    low, high, floor, ceiling = (corner[both] for corner in (low, high, floor, ceiling))
    step = ((low + high) - (floor + ceiling)) / 2
    differs = np.abs((high - low) - (ceiling - floor)).max(axis=1)
    likely = differs < max(_SAME_SIZE, float(np.quantile(differs, 0.1)) * 1.01)
    x, y = np.median(step[likely], axis=0).tolist()
    return x, y


def fit_sections(stack: Stack, sections: Areas, rounds: int = 6) -> Match:
    """Return the shift that places the outlines half a width outside the external perimeters, by least squares.

    Distances are taken along the normals of the outlines; beads farther than half a width from where they belong are
    left out, as inner perimeters are in files that do not tell them apart. Without rounds the shift stays 0.
    """
    beads, layer = stack.beads, stack.layer
    chosen = np.flatnonzero(_outer(beads) & (layer >= 0))
    if not len(chosen) or not sections.n_rings:
        return Match((0.0, 0.0), np.inf, 0.0)
    point, bead = spread_out(beads.take(chosen), _POINTS)
    half, layer = beads.width[chosen][bead] / 2, layer[chosen][bead]
    outlines = OutlineIndex(sections, point.min(axis=0) - 10, point.max(axis=0) + 10)
    shift = np.zeros(2)
    for _ in range(rounds):
        normal, depth = _depth(outlines, sections, point - shift, layer)
        off = depth - half
        near = np.abs(off) < half
        # Where nearly all lie close already, those that do not must not pull.
        reach = max(3 * float(np.median(np.abs(off[near]))), 0.01) if near.any() else 0.0
        near &= np.abs(off) <= reach
        if not near.any():
            break
        step = np.linalg.lstsq(normal[near], off[near], rcond=1e-6)[0]
        shift = shift + step
        if np.abs(step).max() < 1e-4:
            break
    depth = _depth(outlines, sections, point - shift, layer)[1]
    off = np.abs(depth - half)
    if not (beads.purpose[chosen] == Purpose.EXTERNAL_PERIMETER).any():
        # Only those that lie near the outlines, or outside, may be outer perimeters.
        off = off[depth < 2 * half]
        half = half[depth < 2 * half]
    if len(off) < _FEWEST * len(point):
        return Match((float(shift[0]), float(shift[1])), np.inf, 0.0)
    return Match((float(shift[0]), float(shift[1])), float(np.median(off)), float((off < half).mean()))


def find_detached(stack: Stack, sections: Areas) -> Bool:
    """Return a mask (B,) of extrusions of unknown role in paths away from the section of their layer."""
    beads, layer = stack.beads, stack.layer
    result = np.zeros(beads.n_beads, np.bool_)
    doubtful = np.flatnonzero((beads.purpose == Purpose.UNKNOWN) & (layer >= 0))
    if not len(doubtful):
        return result
    some = beads.take(doubtful)
    places = np.concatenate([some.begin, (some.begin + some.end) / 2, some.end])
    outlines = OutlineIndex(sections, places.min(axis=0) - 1, places.max(axis=0) + 1)
    layers = np.tile(layer[doubtful], 3)
    away = (outlines.distance(places, layers) > _FAR) & ~outlines.is_inside(places, layers)
    new = (np.abs(some.begin[1:] - some.end[:-1]).max(axis=1) > 1e-3) | (np.diff(layer[doubtful]) != 0)
    path = np.append(0, np.cumsum(new))
    near = np.bincount(path, weights=~away.reshape(3, -1).all(axis=0))
    result[doubtful] = near[path] == 0
    return result


def _outer(beads: Extrusions) -> Bool:
    """Return a mask (B,) of the external perimeters, or of all extrusions of the part if roles are unknown."""
    outer = beads.purpose == Purpose.EXTERNAL_PERIMETER
    return outer if outer.any() else ~np.isin(beads.purpose, NOT_PART)


def _depth(outlines: OutlineIndex, sections: Areas, points: Float, layer: Int) -> tuple[Float, Float]:
    """Return inward normals (P, 2) of the nearest outlines, and the depth of each point, mm; inf without outline."""
    segment = outlines.nearest(points, layer)
    begin = sections.xy[segment]
    along = sections.xy[sections.following[segment]] - begin
    along = along / np.maximum(np.hypot(*along.T), 1e-12)[:, None]
    normal = np.stack([-along[:, 1], along[:, 0]], axis=1)
    depth = ((points - begin) * normal).sum(axis=1)
    return normal, np.where(segment >= 0, depth, np.inf)
