"""How far the tops of printed extrusions are from the shallow surfaces that contoured extrusions follow."""

from __future__ import annotations

from typing import Final

import numpy as np

from printer_slicer.arrays import Float, Int
from printer_slicer.contouring.fine_points import FinePoints, split_by_length
from printer_slicer.contouring.paths import find_paths_near
from printer_slicer.contouring.surface_heights import FacetBins, LayerPoints, is_open_above
from printer_slicer.geometry.vectors import measure_distances_from_triangles
from printer_slicer.model import ContourDeviations, ContourRule, Sections, Toolpaths
from printer_slicer.roles import roles_with

__all__ = ["measure_deviations"]

_SPACING: Final = 0.2  # mm along extrusions


def measure_deviations(
    paths: Toolpaths, bins: FacetBins, sections: Sections, rule: ContourRule
) -> ContourDeviations:
    """Measure the distance of the tops of extrusions from the surfaces that the rule follows.

    It is the distance from the facet straight below or above, so nothing between the two is farther from the surface.
    It is measured every 0.2 mm along the centre and both sides of all extrusions of the part: lowered ones, and those
    that had to stay level. Where the surface is lower than half of `min_height` in the layer, the layer is empty.

    Args:
        paths: in printing order, contoured.
        bins: the surfaces.
        sections: of all printed layers.
        rule: of contouring.
    """
    plan = paths.plan
    found = ContourDeviations(plan.top, np.zeros(plan.n_layers), np.zeros((plan.n_layers, 3)))
    chosen = np.flatnonzero(bins.tops.is_contoured[paths.layer] & roles_with(is_part=True)[paths.role])
    chosen = np.flatnonzero(find_paths_near(paths, chosen, bins))
    for batch in split_by_length(paths, chosen, _SPACING):
        _measure_paths(paths.take(batch), bins, sections, rule, found)
    return found


def _measure_paths(
    paths: Toolpaths, bins: FacetBins, sections: Sections, rule: ContourRule, found: ContourDeviations
) -> None:
    """Measure some paths, and store the largest deviation of each layer."""
    fine = FinePoints.of(paths, _SPACING)
    layer = paths.layer[fine.owner]
    near = np.flatnonzero(bins.are_near_followed(fine.xy, layer))
    following = paths.following[fine.corner]
    offset = paths.z_offset[fine.corner]
    offset = offset + fine.share * (paths.z_offset[following] - offset)
    z, side, layer = (paths.z_top[fine.owner] + offset)[near], fine.find_sides(paths)[near], layer[near]
    plan, tops = sections.plan, bins.tops
    limits = (
        plan.bottom + rule.min_height / 2,
        plan.top,
        rule.find_max_slopes(plan.height),
    )
    for xy in (fine.xy[near] - side, fine.xy[near], fine.xy[near] + side):
        points = LayerPoints(xy, layer, *(one[layer] for one in limits))
        facet = bins.find_facets(points)
        covered = np.flatnonzero(facet >= 0)
        covered = covered[is_open_above(points.take(covered), sections)]
        place, facet = np.column_stack([xy[covered], z[covered]]), facet[covered]
        _store_largest(found, layer[covered], place, bins.measure_heights(place, facet), tops.corners[facet])


def _store_largest(found: ContourDeviations, layer: Int, place: Float, surface: Float, facet: Float) -> None:
    """Store the largest distances of tops of extrusions from the facets below or above them in each layer.

    Args:
        found: gets them.
        layer: (n,) of each top.
        place: (n, 3) of the tops, mm.
        surface: (n,) z of the facets there, mm.
        facet: (n, 3, 3) their corners, mm.
    """
    larger = np.flatnonzero(np.abs(place[:, 2] - surface) > found.deviation[layer])
    layer, place, surface = layer[larger], place[larger], surface[larger]
    deviation = measure_distances_from_triangles(place, facet[larger])
    np.maximum.at(found.deviation, layer, deviation)
    worst = np.flatnonzero(deviation == found.deviation[layer])
    found.place[layer[worst]] = np.column_stack([place[worst, :2], surface[worst]])
