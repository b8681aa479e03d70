"""Compute the areas that are compared: the covered area, and the shell, which must have no gaps."""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.arrays import Bool, Float, Int
from printer_slicer.geometry import (
    Areas,
    close_gaps,
    difference,
    normalize,
    offset_open,
    stroke_lines,
    union,
    window_intersection,
)
from printer_slicer.geometry.segment_index import OutlineIndex
from printer_slicer.inspection.coverage.extrusions import Extrusions, Purpose, sample_points
from printer_slicer.inspection.coverage.stack import Stack

__all__ = ["exposed_areas", "footprint", "path_numbers", "printed_body", "remove_narrow_gaps", "shell_depth"]

_MAX_JOINT_GAP: Final = 1e-3  # mm; largest gap between an extrusion and the next one in a path
_WIDTH_STEP: Final = 0.002  # mm; widths are rounded to this step
_MAX_WIDTH: Final = 10.0  # mm
_WALLS: Final = (Purpose.EXTERNAL_PERIMETER, Purpose.PERIMETER)
_N_POINTS: Final = 10_000  # points along perimeters, enough for an exact depth
_MAX_DEPTH: Final = 4.0  # mm; deeper perimeters do not make a shell thicker
_MAX_UPRIGHT_MOVE: Final = 0.01  # mm from layer to layer; a wall that moves less is upright


def path_numbers(beads: Extrusions, layer: Int) -> Int:
    """Return the path number (B,) of each extrusion; consecutive connected extrusions of a layer form a path."""
    new = np.diff(layer) != 0
    new |= (np.abs(beads.begin[1:] - beads.end[:-1]) > _MAX_JOINT_GAP).any(axis=1)
    return np.concatenate([np.zeros(min(beads.n_beads, 1), np.int64), np.cumsum(new)])


def footprint(stack: Stack, chosen: Bool) -> Areas:
    """Return the area that chosen extrusions (B,) cover in each layer, with round ends of the extrusions.

    Widths are rounded to 0.002 mm, and positions to 0.01 µm. No extrusion is wider than 10 mm, however much is fed.
    """
    kept = np.flatnonzero(chosen & (stack.layer >= 0))
    beads, layer = stack.beads.take(kept), stack.layer[kept]
    width = np.clip(beads.width, _WIDTH_STEP, _MAX_WIDTH)
    radius = np.round(width / _WIDTH_STEP) * (_WIDTH_STEP / 2)
    path = path_numbers(beads, layer)
    first = np.flatnonzero(np.append(True, (np.diff(path) != 0) | (np.diff(radius) != 0))[: len(kept)])
    size = np.diff(np.append(first, len(kept)))
    # A line consists of the start of its first extrusion and the ends of all its extrusions.
    place = np.arange(len(kept)) + np.searchsorted(first, np.arange(len(kept)), side="right")
    xy = np.zeros((len(kept) + len(first), 2))
    xy[place] = beads.end
    xy[place[first] - 1] = beads.begin[first]
    start = np.append(0, np.cumsum(size + 1))
    return stroke_lines(xy, start, layer[first], radius[first], stack.n_layers)


def shell_depth(stack: Stack, sections: Areas) -> float:
    """Return how deep a file's perimeters reach into the part, mm; twice the usual width without roles.

    It depends on the position of centre lines, not on volume: too little material does not make the shell thinner.
    """
    beads, layer = stack.beads, stack.layer
    if stack.is_spiral:
        return _spiral_wall_thickness(stack, sections)
    walls = np.flatnonzero(np.isin(beads.purpose, _WALLS) & (layer >= 0))
    if not len(walls):
        known = layer >= 0
        return 2 * float(np.average(beads.width[known], weights=beads.length[known])) if known.any() else 1.0
    place, bead = sample_points(beads.take(walls), _N_POINTS)
    bead = walls[bead]
    depth = OutlineIndex(sections, place.min(axis=0) - 1, place.max(axis=0) + 1).distance(place, layer[bead])
    near = depth < _MAX_DEPTH
    if not near.any():
        return 1.0
    outer = near & (beads.purpose[bead] == Purpose.EXTERNAL_PERIMETER)
    half = float(np.median(depth[outer] if outer.any() else beads.width[walls] / 2))
    if not (beads.purpose[walls] == Purpose.PERIMETER).any():
        return 2 * half
    # Only perimeters in corners and narrow places are deeper.
    return float(np.quantile(depth[near], 0.9)) + half


def _spiral_wall_thickness(stack: Stack, sections: Areas) -> float:
    """Return the wall thickness of a spiral vase, mm: twice the depth of its centre line at upright walls.

    Where the outline moves from turn to turn, the outline at the height of an extrusion is not that of its section. If
    this is so everywhere, the result is the width of the extrusions, or twice their depth if that is less.
    """
    beads, layer = stack.beads, stack.layer
    turns = np.flatnonzero((layer >= 0) & stack.has_rising_z[layer])
    place, bead = sample_points(beads.take(turns), _N_POINTS)
    bead = turns[bead]
    outlines = OutlineIndex(sections, place.min(axis=0) - 1, place.max(axis=0) + 1)
    own = layer[bead]
    low, high = np.maximum(own - 1, 0), np.minimum(own + 1, stack.n_layers - 1)
    under, depth, over = (outlines.distance(place, one) for one in (low, own, high))
    near = (under < _MAX_DEPTH) & (depth < _MAX_DEPTH) & (over < _MAX_DEPTH)
    width = float(np.median(beads.width[bead]))
    moves = np.abs(over - under)[near] / np.maximum(high - low, 1)[near]
    upright = moves < _MAX_UPRIGHT_MOVE
    if not upright.any():
        return width if not near.any() else min(width, 2 * float(np.median(depth[near])))
    return 2 * float(np.median(depth[near][upright]))


def exposed_areas(sections: Areas, top: Float, bottom: Float, surface_depth: float) -> Areas:
    """Return the parts of each section that have air or the bed within `surface_depth` mm above or below.

    With a depth of 0, only the next layer counts.
    """
    n = sections.n_layers
    own, reach = np.arange(n), max(surface_depth, 1e-6)
    last = np.minimum(np.searchsorted(bottom, top + reach - 1e-9), n + 1)
    last = np.where(top + reach > top[-1] + 1e-9, n + 1, np.maximum(last, own + 2))
    first = np.where(bottom - reach < -1e-9, -1, np.searchsorted(top, bottom - reach + 1e-9, side="right"))
    first = np.minimum(first, own - 1)
    return difference(sections, window_intersection(sections, first, last))


def printed_body(covered: Areas, core: Areas, sections: Areas, tolerance: float) -> Areas:
    """Return the printed body: covered areas and the areas that the shell encloses, without voids.

    A void is an uncovered piece of the section that is everywhere deeper than `tolerance` mm below the outline.
    """
    body = union(covered, core)
    missing = difference(sections, body)
    if not missing.n_rings:
        return body
    low, high = missing.xy.min(axis=0), missing.xy.max(axis=0)
    ring = missing.point_ring
    shallow = OutlineIndex(sections, low, high).distance(missing.xy, missing.ring_layer[ring]) <= tolerance
    reaches_out = np.bincount(ring, weights=shallow, minlength=missing.n_rings) > 0
    return union(body, normalize(missing.select(~reaches_out)))


def remove_narrow_gaps(sections: Areas, min_gap: float) -> Areas:
    """Remove gaps and fins narrower than `min_gap`, mm, from sections, because no nozzle prints them."""
    closed = close_gaps(sections, min_gap / 2)
    return offset_open(closed, min_gap / 2)
