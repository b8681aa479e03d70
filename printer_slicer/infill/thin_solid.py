"""Fill narrow solid strips beside the perimeters with lines along the strip, instead of many short lines across."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from printer_slicer import bead
from printer_slicer.arrays import Bool, Float, Int, polyline_lengths
from printer_slicer.geometry import (
    Areas,
    ConnectedAreas,
    difference,
    offset,
    offset_open,
    outlines_within,
    stroke_lines,
)
from printer_slicer.model import LayerPlan, Regions, Toolpaths
from printer_slicer.profile import Profile
from printer_slicer.roles import Role

__all__ = ["thin_solid_paths"]

_WIDEST_STRIP = 3.5  # extrusion widths
_ACCEPTED_VOLUME = (0.87, 1.15)  # accepted volume of the lines, as a share of the strip
_MAX_UNCOVERED = 0.02  # share of a strip that may stay uncovered
_HALF_SLIT = 0.05  # mm, half the width of gaps that are ignored
_MAX_POINTS = 300_000  # outline points beside strips; with more, strips are not fitted one by one

_Lines = tuple[Float, Int, Int]  # points (N, 2), how many (M,) each line has, and the strip (M,) it lies in


def thin_solid_paths(
    regions: Regions, pieces: ConnectedAreas, profile: Profile
) -> tuple[Toolpaths, ConnectedAreas]:
    """Fill strips of even width with lines along the perimeters; return the paths and the remaining pieces.

    Strips that fit a whole number of lines of the usual width come first. In other strips the line width is adapted to
    the mean width of the strip.
    """
    plan = regions.plan
    usual = bead.spacing(profile.extrusion_width, plan.height)
    left = np.flatnonzero(pieces.mean_width() < _WIDEST_STRIP * usual[pieces.layer])
    rest = np.ones(pieces.count, np.bool_)
    parts = []
    for lines_along in (_make_usual_lines, _make_fitted_lines):
        strips = pieces.take(left)
        lines, gap = lines_along(regions.inside.of_layers(strips.layer), strips, usual)
        paths, fits = _make_paths(plan, strips, lines, gap)
        parts.append(paths)
        rest[left[fits]] = False
        left = left[~fits]
    return Toolpaths.joined(plan, parts), pieces.take(np.flatnonzero(rest))


def _make_usual_lines(walls: Areas, strips: ConnectedAreas, usual: Float) -> tuple[_Lines, Float]:
    """Return lines along the perimeters at the spacing of the layer, and the spacing (P,) of each strip, mm."""
    beside = (strips.select_nearby_rings(loop) for loop in _inset_loops(walls, usual))
    return _clip_loops(beside, strips), usual[strips.layer]


def _make_fitted_lines(walls: Areas, strips: ConnectedAreas, usual: Float) -> tuple[_Lines, Float]:
    """Return lines at a spacing that divides the mean width of each strip, and that spacing (P,), mm."""
    wide, beside = strips.mean_width(), strips.select_nearby_rings(walls)
    gap = wide / np.maximum(np.rint(wide / usual[strips.layer]), 1)
    if len(beside.xy) > _MAX_POINTS:
        beside = Areas.empty(strips.count)
    return _clip_loops(_inset_loops(beside, gap), strips), gap


def _inset_loops(walls: Areas, gap: Float) -> Iterator[Areas]:
    """Yield insets of 0.5, 1.5, 2.5 ... times `gap`, as many as a strip may have lines."""
    loop, by = walls, gap / 2
    for _ in range(math.ceil(_WIDEST_STRIP)):
        if not loop.n_rings:
            return
        loop, by = offset(loop, -by), gap
        yield loop


def _clip_loops(loops: Iterator[Areas], strips: ConnectedAreas) -> _Lines:
    """Clip loops (P entries each) to the strips; stop at the first loop outside of all strips."""
    found: list[_Lines] = [(np.zeros((0, 2)), np.zeros(0, np.int64), np.zeros(0, np.int64))]
    for loop in loops:
        found.append(outlines_within(loop, strips.areas))
        if not len(found[-1][1]):
            break
    xy, size, strip = (np.concatenate([part[i] for part in found]) for i in range(3))
    return xy, size, strip


def _make_paths(plan: LayerPlan, strips: ConnectedAreas, lines: _Lines, gap: Float) -> tuple[Toolpaths, Bool]:
    """Return lines as paths with the nominal volume of each strip, and which strips (P,) they fill."""
    xy, size, piece = lines
    area, height = strips.areas.area(), plan.height[strips.layer]
    long = polyline_lengths(xy, np.append(0, np.cumsum(size)), closed=False)
    full = np.bincount(piece, long, minlength=strips.count) * gap / np.maximum(area, 1e-9)
    fits = (full >= _ACCEPTED_VOLUME[0]) & (full <= _ACCEPTED_VOLUME[1])
    wide = np.round(bead.width_for_spacing(gap / np.where(fits, full, 1.0), height), 4)
    fits &= wide >= height
    kept = fits[piece]
    xy, size, piece = xy.compress(np.repeat(kept, size), axis=0), size[kept], piece[kept]
    covered = stroke_lines(xy, np.append(0, np.cumsum(size)), piece, wide[piece] / 2, strips.count)
    bare = offset_open(difference(strips.areas.of_layers(fits), covered), _HALF_SLIT)
    fits &= bare.area() < _MAX_UNCOVERED * area
    kept = fits[piece]
    layer = strips.layer[piece[kept]]
    paths = Toolpaths.gathered(
        plan,
        xy=xy.compress(np.repeat(kept, size), axis=0),
        size=size[kept],
        layer=layer,
        role=np.full(len(layer), Role.SOLID_INFILL),
        width=wide[piece[kept]],
        closed=False,
    )
    return paths, fits
