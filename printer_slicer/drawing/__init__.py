"""Draw layer plans, layers, coverage and dry runs as SVG or PNG."""

from printer_slicer.drawing.canvas import Picture, check_picture, picture_bytes
from printer_slicer.drawing.coverage import coverage_picture
from printer_slicer.drawing.gcode_layer import View, gcode_layer_picture
from printer_slicer.drawing.layer import draw_layer, layer_picture
from printer_slicer.drawing.plan import draw_plan
from printer_slicer.drawing.values import draw

__all__ = [
    "Picture",
    "View",
    "check_picture",
    "coverage_picture",
    "draw",
    "draw_layer",
    "draw_plan",
    "gcode_layer_picture",
    "layer_picture",
    "picture_bytes",
]
