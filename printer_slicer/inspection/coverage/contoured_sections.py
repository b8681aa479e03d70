"""Extend the sections of a part to what contoured extrusions fill: the surface below the middle of a layer.

A slicer that plans for contoured tops extends its layers on slopes up to an angle. So slopes are divided into classes,
and a class counts if contoured extrusions cover most of its surface among them. Where there are none, layers are level:
a slicer may not extend them there, so that they keep a tolerance.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import Final

import numpy as np

from printer_slicer.arrays import Float, Int
from printer_slicer.geometry import Areas, close_gaps, difference, intersection, normalize, offset, union
from printer_slicer.geometry.slab_projection import project_slabs
from printer_slicer.inspection.coverage.extrusions import weighted_median
from printer_slicer.inspection.coverage.stack import Stack
from printer_slicer.inspection.coverage.zones import footprint
from printer_slicer.model import Mesh
from printer_slicer.surface.contoured_tops import select_shallow_facets

__all__ = ["add_contoured_slopes", "find_least_height"]

_CLASS: Final = 0.1  # layer heights per extrusion width, the step between classes of slopes
_N_CLASSES: Final = 14
_MAX_GRADIENT: Final = 0.75  # mm per mm; steeper slopes are not extended
_MIN_COVERED: Final = 0.5  # share of the surface of a class
_MIN_QUANTILE: Final = 0.02  # of the length of contoured extrusions
_MIN_HEIGHTS: Final = 0.02, 0.2  # mm, smallest and largest least height of an extrusion
_LOWEST_EDGE: Final = 0.02  # mm above the bottom of a layer
_MAX_GAP: Final = 0.02  # mm between a section and its extension, from rounding
_SAME_HEIGHT: Final = 1e-3  # mm
_REACH: Final = (
    1.5  # extrusion widths between contoured extrusions, half of the widest gap that is still among them
)
_MARGIN: Final = 0.15  # extrusion widths beside contoured extrusions, as far as sections are extended


def find_least_height(stack: Stack) -> float:
    """Return the height, mm, of the lowest contoured extrusions, without single even lower ones."""
    some = stack.beads.take(stack.beads.is_contoured)
    if not some.n_beads:
        return _MIN_HEIGHTS[0]
    order = np.argsort(some.height)
    reached = np.cumsum(some.length[order])
    found = some.height[order][np.searchsorted(reached, _MIN_QUANTILE * reached[-1])]
    return float(np.clip(found, *_MIN_HEIGHTS))


def add_contoured_slopes(parts: Sequence[Mesh], stack: Stack, sections: Areas) -> Areas:
    """Add to each section the surface below its middle, if the file covers it with contoured extrusions.

    Args:
        parts: at their position; those of the groups of the stack.
        stack: layers of the file.
        sections: sections in the middle of these layers.
    """
    contoured = stack.beads.is_contoured & (stack.layer >= 0)
    if not contoured.any():
        return sections
    printed = footprint(stack, contoured)
    has_contours = np.zeros(stack.n_layers, np.bool_)
    has_contours[stack.layer[contoured]] = True
    beads = stack.beads.take(contoured)
    size = weighted_median(beads.width, beads.length), find_least_height(stack)
    reach, margin = _REACH * size[0], _MARGIN * size[0]
    around = offset(offset(printed, reach), margin - reach)
    shallow = [select_shallow_facets(part.triangles, _MAX_GRADIENT)[:2] for part in parts]
    facets = [(part.triangles[facet], slope) for part, (facet, slope) in zip(parts, shallow, strict=True)]
    for one, is_edge in product(range(_N_CLASSES), (False, True)):
        slope = _project_class(facets, stack, one, size, is_edge=is_edge).of_layers(has_contours)
        slope = difference(slope, sections)
        slope = intersection(slope, around)
        area = float(slope.area().sum())
        if area > 0 and intersection(slope, printed).area().sum() > _MIN_COVERED * area:
            sections = close_gaps(union(sections, slope), _MAX_GAP / 2)
    return sections


def _project_class(
    facets: Sequence[tuple[Float, Float]],
    stack: Stack,
    number: int,
    size: tuple[float, float],
    *,
    is_edge: bool,
) -> Areas:
    """Return the surface of a class of slopes in the lower half of each layer, from half the least height on.

    Args:
        facets: shallow facets (n, 3, 3) that face up, and their slopes (n,) as tangents, of each group of the stack.
        stack: layers of the file.
        number: of the class, from 0.
        size: width and least height of contoured extrusions, mm.
        is_edge: return the surface below that instead, down to `_find_edge_height`.
    """
    width, least = size
    found = [Areas.empty(stack.n_layers)]
    for own in stack.layers_of_groups():
        triangles, gradient = facets[int(stack.group[own[0]])]
        for layers in _layers_by_height(stack, own):
            height = float(stack.height[layers[0]])
            steepness = gradient * width / height / _CLASS
            chosen = (steepness >= number) & (steepness < number + 1)
            if not chosen.any():
                continue
            low, high = least / 2, max(height / 2, least / 2)
            if is_edge:
                low, high = _find_edge_height(least, width, number * _CLASS * height / width), low
            bottom = stack.bottom[layers]
            slabs = normalize(project_slabs(triangles[chosen], bottom + low, bottom + high))
            found.append(slabs.on_layers(layers, stack.n_layers))
    return Areas.merged(found)


def _find_edge_height(least: float, width: float, gradient: float) -> float:
    """Return the height of the surface above the bottom of a layer where its section may end on a slope, mm.

    Usually that is half of the least height of extrusions. On steep slopes no extrusion is that low, because the lowest
    centre line is half a width from the edge. So the surface at the edge is lower than the lowest height in the file.
    """
    return min(least / 2, max(least - width / 2 * gradient, _LOWEST_EDGE))


def _layers_by_height(stack: Stack, own: Int) -> list[Int]:
    """Return the layers of a group that have the same height, except for the first, which is never contoured."""
    rest = own[1:]
    height = np.round(stack.height[rest] / _SAME_HEIGHT)
    return [rest[height == one] for one in np.unique(height)]
