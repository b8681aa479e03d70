"""Draw layer plans, layers, coverage and dry runs as SVG or PNG."""

from printer_slicer.drawing.canvas import Picture, check_picture_path, encode_picture
from printer_slicer.drawing.coverage import draw_coverage
from printer_slicer.drawing.gcode_layer import View, draw_gcode_layer
from printer_slicer.drawing.gcode_layers_3d import draw_gcode_layers_3d
from printer_slicer.drawing.layer import draw_layer, draw_program_layer
from printer_slicer.drawing.plan import draw_plan
from printer_slicer.drawing.values import draw

__all__ = [
    "Picture",
    "View",
    "check_picture_path",
    "draw",
    "draw_coverage",
    "draw_gcode_layer",
    "draw_gcode_layers_3d",
    "draw_layer",
    "draw_plan",
    "draw_program_layer",
    "encode_picture",
]
