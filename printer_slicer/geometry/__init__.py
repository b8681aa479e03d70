"""Areas and lines of the whole stack: offset, boolean, simplify, hatch.

Each function takes and returns ragged arrays for all layers. A value that depends on the layer is an array with
one entry per layer. Two engines do the polygon work: `clipper` (Clipper2, the default) and `planar` (shapely,
selected with the environment variable PRINTER_SLICER_GEOMETRY=planar). The tests run both.
"""

from printer_slicer.geometry.anchoring import anchor
from printer_slicer.geometry.areas import Areas, Lines
from printer_slicer.geometry.clipping import clip_lines
from printer_slicer.geometry.connected_areas import ConnectedAreas, split_connected
from printer_slicer.geometry.depth import depths
from printer_slicer.geometry.engine import (
    close_gaps,
    difference,
    fits_circle,
    intersection,
    normalize,
    offset,
    offset_open,
    outlines_within,
    simplify,
    stroke_lines,
    union,
    window_intersection,
    window_intersections,
)
from printer_slicer.geometry.hatching import HatchGrids, chain_rows, hatch, hatch_evenly, row_ends
from printer_slicer.geometry.hull import convex_hull
from printer_slicer.geometry.outlines import clip_outlines
from printer_slicer.geometry.polygons import Polygons
from printer_slicer.geometry.polylines import Polylines
from printer_slicer.geometry.ring_queries import (
    contain_points,
    crosses_rings,
    crossings,
    find_enclosing_rings,
)
from printer_slicer.geometry.staircases import unite_row_rectangles
from printer_slicer.geometry.sweeping import sweep_areas

__all__ = [
    "Areas",
    "ConnectedAreas",
    "HatchGrids",
    "Lines",
    "Polygons",
    "Polylines",
    "anchor",
    "chain_rows",
    "clip_lines",
    "clip_outlines",
    "close_gaps",
    "contain_points",
    "convex_hull",
    "crosses_rings",
    "crossings",
    "depths",
    "difference",
    "find_enclosing_rings",
    "fits_circle",
    "hatch",
    "hatch_evenly",
    "intersection",
    "normalize",
    "offset",
    "offset_open",
    "outlines_within",
    "row_ends",
    "simplify",
    "split_connected",
    "stroke_lines",
    "sweep_areas",
    "union",
    "unite_row_rectangles",
    "window_intersection",
    "window_intersections",
]
