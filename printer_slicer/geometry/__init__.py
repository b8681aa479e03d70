"""Areas and lines of the whole stack: offset, boolean, simplify, hatch.

Each function takes ragged arrays for all layers and gives ragged arrays back; whatever depends on a layer is
an array with one entry per layer. Two engines do the polygon work: `clipper` (Clipper2, the default) and
`planar` (shapely, its twin, selected with the environment variable PRINTER_SLICER_GEOMETRY=planar). The tests
run both.
"""

from printer_slicer.geometry.anchoring import anchor
from printer_slicer.geometry.areas import Areas, Lines
from printer_slicer.geometry.clipping import clip_lines
from printer_slicer.geometry.depth import depths
from printer_slicer.geometry.engine import (
    difference,
    intersection,
    normalize,
    offset,
    offset_open,
    outlines_within,
    simplify,
    stroked,
    union,
    window_intersection,
    window_intersections,
)
from printer_slicer.geometry.hatching import chain_rows, hatch, row_ends
from printer_slicer.geometry.hull import convex_hull
from printer_slicer.geometry.inside import crossed, crossings, rings_around
from printer_slicer.geometry.outlines import clip_outlines
from printer_slicer.geometry.pieces import Pieces, pieces_of
from printer_slicer.geometry.polygons import Polygons
from printer_slicer.geometry.polylines import Polylines
from printer_slicer.geometry.staircases import staircases
from printer_slicer.geometry.sweeping import swept

__all__ = [
    "Areas",
    "Lines",
    "Pieces",
    "Polygons",
    "Polylines",
    "anchor",
    "chain_rows",
    "clip_lines",
    "clip_outlines",
    "convex_hull",
    "crossed",
    "crossings",
    "depths",
    "difference",
    "hatch",
    "intersection",
    "normalize",
    "offset",
    "offset_open",
    "outlines_within",
    "pieces_of",
    "rings_around",
    "row_ends",
    "simplify",
    "staircases",
    "stroked",
    "swept",
    "union",
    "window_intersection",
    "window_intersections",
]
