"""Arrange parts on few plates: where each part stands, and how it is rotated about z.

outlines -> footprints on a raster (`footprints`) -> places (`packing`) -> exact check (`spacing`) -> `Arrangement`
"""

from printer_slicer.arranging.arrange import arrange_outlines
from printer_slicer.arranging.arrangement import Arrangement, FreeArea

__all__ = ["Arrangement", "FreeArea", "arrange_outlines"]
