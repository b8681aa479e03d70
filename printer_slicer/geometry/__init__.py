"""Areas and lines of the whole stack: offset, boolean, simplify, hatch.

Each function takes ragged arrays for all layers and gives ragged arrays back; whatever depends on a layer is
an array with one entry per layer. Two engines do the polygon work: `clipper` (Clipper2, the default) and
`planar` (shapely, its twin, selected with the environment variable PRINTER_SLICER_GEOMETRY=planar). The tests
run both.
"""

from printer_slicer.geometry.areas import Areas, Bool, Float, Int, Lines, frozen_array
from printer_slicer.geometry.engine import (
    difference,
    intersection,
    normalize,
    offset,
    offset_open,
    simplify,
    stroked,
    union,
    window_intersection,
)
from printer_slicer.geometry.hatching import chain_rows, hatch
from printer_slicer.geometry.inside import crossed, rings_around
from printer_slicer.geometry.polygons import Polygons

__all__ = [
    "Areas",
    "Bool",
    "Float",
    "Int",
    "Lines",
    "Polygons",
    "chain_rows",
    "crossed",
    "difference",
    "frozen_array",
    "hatch",
    "intersection",
    "normalize",
    "offset",
    "offset_open",
    "rings_around",
    "simplify",
    "stroked",
    "union",
    "window_intersection",
]
