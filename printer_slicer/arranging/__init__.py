"""Arrange parts on as few plates as possible: where each part goes, and how it is turned about z.

outlines -> footprints on a raster (`footprints`) -> places (`packing`) -> exact check (`spacing`) -> `Arrangement`
"""

from printer_slicer.arranging.arrange import arrange_outlines
from printer_slicer.arranging.arrangement import Arrangement, PlateRoom

__all__ = ["Arrangement", "PlateRoom", "arrange_outlines"]
