"""Find where a part is in a file by fitting the part's sections to the file's external perimeters."""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.arrays import Bool, Float, Int, bounding_boxes
from printer_slicer.geometry import Areas
from printer_slicer.geometry.segment_index import OutlineIndex
from printer_slicer.inspection.coverage.extrusions import Extrusions, Purpose, sample_points
from printer_slicer.inspection.coverage.stack import Stack
from printer_slicer.inspection.deposition.marks import NOT_PART
from printer_slicer.values import Struct

__all__ = [
    "Match",
    "find_detached_extrusions",
    "find_external_perimeters",
    "fit_sections",
    "guess_shift",
    "shift_areas",
]

_N_POINTS: Final = 10_000  # enough for a shift exact to a micrometre
_MIN_SHARE: Final = 0.05  # share of all points that must be near outlines
_SIZE_TOLERANCE: Final = 0.3  # mm by which the box of a layer may differ from that of its section
_DETACHED_DISTANCE: Final = 1.0  # mm; a path that stays farther away from a section does not belong to it


class Match(Struct, frozen=True):
    """The position of a part's sections in a file, and how well they fit there.

    Attributes:
        shift: x and y, mm, from the given position of the sections to the position that fits.
        spread: median distance of the external perimeters from their expected position, mm.
        share: share of the length of the external perimeters within half a width of their expected position.
    """

    shift: tuple[float, float]
    spread: float
    share: float


def shift_areas(areas: Areas, by: Float | tuple[float, float]) -> Areas:
    """Shift areas in x and y, and round their coordinates to the grid of the geometry."""
    xy = np.round(areas.xy + np.asarray(by), 5)
    return Areas(xy, areas.ring_start, areas.ring_layer, areas.n_layers)


def guess_shift(stack: Stack, sections: Areas) -> tuple[float, float]:
    """Return the median shift from the bounding boxes of the sections to those of the printed layers.

    If the boxes of some layers have the size of their section, only these count: skirts and brims make boxes wider.
    """
    beads, layer = stack.beads, stack.layer
    outer = find_external_perimeters(beads) & (layer >= 0)
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
    # Contoured layers may extend beyond their sections on some sides.
    level = both & ~np.isin(np.arange(stack.n_layers), layer[beads.is_contoured])
    both = level if level.any() else both
    low, high, floor, ceiling = (corner[both] for corner in (low, high, floor, ceiling))
    step = ((low + high) - (floor + ceiling)) / 2
    differs = np.abs((high - low) - (ceiling - floor)).max(axis=1)
    likely = differs < max(_SIZE_TOLERANCE, float(np.quantile(differs, 0.1)) * 1.01)
    x, y = np.median(step[likely], axis=0).tolist()
    return x, y


def fit_sections(stack: Stack, sections: Areas, rounds: int = 6) -> Match:
    """Find the shift that places external perimeters half a width inside the outlines, by least squares.

    Distances are measured along the normals of the outlines. Extrusions farther than half a width from their expected
    position are left out, such as inner perimeters in files without roles. With 0 rounds the shift stays 0.
    """
    beads, layer = stack.beads, stack.layer
    chosen = np.flatnonzero(find_external_perimeters(beads) & (layer >= 0))
    if not len(chosen) or not sections.n_rings:
        return Match((0.0, 0.0), np.inf, 0.0)
    point, bead = sample_points(beads.take(chosen), _N_POINTS)
    half, layer = beads.width[chosen][bead] / 2, layer[chosen][bead]
    outlines = OutlineIndex(sections, point.min(axis=0) - 10, point.max(axis=0) + 10)
    shift = np.zeros(2)
    for _ in range(rounds):
        normal, depth = _depths_below_outline(outlines, sections, point - shift, layer)
        errors = depth - half
        near = np.abs(errors) < half
        # If nearly all points fit already, the remaining points must not affect the shift.
        reach = max(3 * float(np.median(np.abs(errors[near]))), 0.01) if near.any() else 0.0
        near &= np.abs(errors) <= reach
        if not near.any():
            break
        step = np.linalg.lstsq(normal[near], errors[near], rcond=1e-6)[0]
        shift = shift + step
        if np.abs(step).max() < 1e-4:
            break
    depth = _depths_below_outline(outlines, sections, point - shift, layer)[1]
    errors = np.abs(depth - half)
    if not (beads.purpose[chosen] == Purpose.EXTERNAL_PERIMETER).any():
        # Only extrusions near the outlines, or outside, can be external perimeters.
        errors = errors[depth < 2 * half]
        half = half[depth < 2 * half]
    if len(errors) < _MIN_SHARE * len(point):
        return Match((float(shift[0]), float(shift[1])), np.inf, 0.0)
    return Match((float(shift[0]), float(shift[1])), float(np.median(errors)), float((errors < half).mean()))


def find_detached_extrusions(stack: Stack, sections: Areas) -> Bool:
    """Return a mask (B,) of extrusions with unknown role and a path that stays away from the section."""
    beads, layer = stack.beads, stack.layer
    result = np.zeros(beads.n_beads, np.bool_)
    indices = np.flatnonzero((beads.purpose == Purpose.UNKNOWN) & (layer >= 0))
    if not len(indices):
        return result
    unknown = beads.take(indices)
    points = np.concatenate([unknown.begin, (unknown.begin + unknown.end) / 2, unknown.end])
    outlines = OutlineIndex(sections, points.min(axis=0) - 1, points.max(axis=0) + 1)
    layers = np.tile(layer[indices], 3)
    away = (outlines.distance(points, layers) > _DETACHED_DISTANCE) & ~outlines.is_inside(points, layers)
    new = (np.abs(unknown.begin[1:] - unknown.end[:-1]).max(axis=1) > 1e-3) | (np.diff(layer[indices]) != 0)
    path = np.append(0, np.cumsum(new))
    near = np.bincount(path, weights=~away.reshape(3, -1).all(axis=0))
    result[indices] = near[path] == 0
    return result


def find_external_perimeters(beads: Extrusions) -> Bool:
    """Return a mask (B,) of external perimeters; of all extrusions of the part if roles are unknown.

    Contoured perimeters, which may lie outside of the sections, are left out if others are there.
    """
    outer = beads.purpose == Purpose.EXTERNAL_PERIMETER
    found = outer if outer.any() else ~np.isin(beads.purpose, NOT_PART)
    upright = found & ~beads.is_contoured
    return upright if beads.length[upright].sum() > _MIN_SHARE * beads.length[found].sum() else found


def _depths_below_outline(
    outlines: OutlineIndex, sections: Areas, points: Float, layer: Int
) -> tuple[Float, Float]:
    """Return the inward normal (P, 2) of the outline nearest to each point, and the point's depth, mm.

    The depth is infinite without an outline.
    """
    segment = outlines.nearest(points, layer)
    begin = sections.xy[segment]
    along = sections.xy[sections.following[segment]] - begin
    along = along / np.maximum(np.hypot(*along.T), 1e-12)[:, None]
    normal = np.stack([-along[:, 1], along[:, 0]], axis=1)
    depth = ((points - begin) * normal).sum(axis=1)
    return normal, np.where(segment >= 0, depth, np.inf)
