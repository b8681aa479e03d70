"""Pictures, as SVG or PNG: a layer plan with its error, the beads of one layer, and what is wrong with them."""

from printer_slicer.drawing.canvas import Picture, check_picture, picture_bytes
from printer_slicer.drawing.layer import draw_layer, layer_picture
from printer_slicer.drawing.material import material_picture
from printer_slicer.drawing.plan import draw_plan
from printer_slicer.drawing.sheet import View, sheet_picture
from printer_slicer.drawing.values import draw

__all__ = [
    "Picture",
    "View",
    "check_picture",
    "draw",
    "draw_layer",
    "draw_plan",
    "layer_picture",
    "material_picture",
    "picture_bytes",
    "sheet_picture",
]
