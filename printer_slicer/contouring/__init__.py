"""Contoured tops: within a layer, the nozzle follows shallow upper surfaces of the part in z.

A flat layer differs from a sloped surface by a quarter of its height on average. The underside of the nozzle is flat,
so a contoured extrusion is level across its width, and exact along it: it differs by a quarter of width · tan(slope),
whatever the layer height is. So only shallow surfaces are followed, see `ContourRule`.

    Mesh, LayerPlan     -> `find_tops`            -> Tops: the shallow upward facets, by layer
    Tops                -> `find_reached_areas`   -> by which `slicing` widens sections: what low extrusions reach
    Mesh, LayerPlan     -> `find_facet_bins`      -> FacetBins: the same facets, by layer and place
    Regions, Mesh       -> `direct_top_rows`      -> Regions whose contoured tops have rows along contour lines
    Toolpaths, bins     -> `find_contoured_paths` -> `ordering` prints these walls from the outside in, without scarfs
    Toolpaths, bins     -> `contour`              -> Toolpaths with `z_offset` and `flow_ratio`
    Toolpaths, bins     -> `measure_deviations`   -> ContourDeviations: how far they are from the surface

Sources: H. Song, N. Ray, D. Sokolov, S. Lefebvre 2017, "Anti-aliasing for fused filament deposition", for heights that
vary along a path within its layer. The rule of slopes, the fades and the order are derived in docs/contoured-tops.md.
"""

from __future__ import annotations

from printer_slicer.contouring.deviations import measure_deviations
from printer_slicer.contouring.paths import contour, find_contoured_paths
from printer_slicer.contouring.row_directions import direct_top_rows
from printer_slicer.contouring.rules import (
    add_contour_rule,
    find_inexact_layers,
    join_contours,
    level_layers,
    make_contour_rule,
)
from printer_slicer.contouring.surface_heights import FacetBins, find_facet_bins
from printer_slicer.contouring.tops import Tops, find_tops
from printer_slicer.contouring.widening import ReachedAreas, find_reached_areas

__all__ = [
    "FacetBins",
    "ReachedAreas",
    "Tops",
    "add_contour_rule",
    "contour",
    "direct_top_rows",
    "find_contoured_paths",
    "find_facet_bins",
    "find_inexact_layers",
    "find_reached_areas",
    "find_tops",
    "join_contours",
    "level_layers",
    "make_contour_rule",
    "measure_deviations",
]
