"""Lay rows of top solid infill along the contour lines of the surface that they follow.

Such rows are level, so the nozzle need not climb along them, and on a shallow slope they are long.
"""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

from printer_slicer.arrays import Float, Int, consecutive, next_in_ring
from printer_slicer.contouring.surface_heights import FacetBins, LayerPoints, find_facet_bins
from printer_slicer.geometry import split_connected
from printer_slicer.model import ContourRule, Mesh, Regions
from printer_slicer.values import replace

__all__ = ["direct_top_rows"]

_SPACING: Final = 0.5  # mm between points along outlines
_MIN_SLOPE: Final = 0.01  # tangent; less is level
_MIN_FOLLOWED: Final = 0.25  # of the outline of an area; the rest may be under the next layer
_MIN_AGREEMENT: Final = 0.8  # of the slopes around an area; 1: all of it slopes in one direction


def direct_top_rows(regions: Regions, mesh: Mesh) -> Regions:
    """Return regions whose contoured top solid infill has rows along the contour lines of the surface.

    Areas that slope in several directions, or are partly level, keep the usual direction.

    Args:
        regions: of the part; their plan has the rule of contouring.
        mesh: the part, standing on z = 0.
    """
    areas, rule = regions.top_solid_infill, regions.plan.contour_rule
    bins = find_facet_bins(mesh, regions.plan, rule) if rule and areas.n_rings else None
    if rule is None or bins is None:
        return regions
    pieces = split_connected(areas)
    step = areas.xy[next_in_ring(areas.ring_start)] - areas.xy
    count = np.maximum(np.ceil(np.hypot(*step.T) / _SPACING), 1).astype(np.int64)
    count[~bins.tops.is_contoured[areas.ring_layer[areas.point_ring]]] = 0
    corner = np.repeat(np.arange(len(count)), count)
    share = consecutive(np.zeros_like(count), count) / count[corner]
    ring = areas.point_ring[corner]
    slope = _find_slopes(areas.xy[corner] + share[:, None] * step[corner], areas.ring_layer[ring], bins, rule)
    # Twice the angle is the same for both directions of a row.
    wave = np.where(np.abs(slope) > _MIN_SLOPE, np.exp(2j * np.angle(slope)), 0.0)
    piece, n = pieces.of_ring[ring], pieces.count + 1  # the last one is for rings without a piece
    total = np.bincount(piece, wave.real, n) + 1j * np.bincount(piece, wave.imag, n)
    followed = np.bincount(piece, ~np.isnan(slope), n)
    agrees = np.abs(total) >= _MIN_AGREEMENT * np.maximum(followed, 1)
    agrees &= followed >= _MIN_FOLLOWED * np.bincount(piece, minlength=n)
    angle = np.where(agrees, np.angle(total) / 2 + np.pi / 2, np.nan)
    return replace(regions, top_angle=angle[pieces.of_ring])


def _find_slopes(xy: Float, layer: Int, bins: FacetBins, rule: ContourRule) -> npt.NDArray[np.complex128]:
    """Return the slopes in x and y (n,) of the surfaces at points (n, 2) of layers (n,); nan where there are none."""
    plan = bins.tops.plan
    limits = plan.bottom + rule.min_height / 2, plan.top, rule.find_max_slopes(plan.height)
    facet = bins.find_facets(LayerPoints(xy, layer, *(one[layer] for one in limits)))
    slope = bins.plane[facet, 1] + 1j * bins.plane[facet, 2]
    return np.where(facet >= 0, slope, np.nan)
