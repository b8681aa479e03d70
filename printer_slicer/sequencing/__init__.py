"""Print objects one after the other: in which order the print head touches none of them, and the moves between them.

stages of each object -> `ObjectExtent` (where the nozzle goes, and what is printed) -> order -> one program
"""

from printer_slicer.sequencing.extents import ObjectExtent, measure_extent
from printer_slicer.sequencing.joining import join_plans, join_programs
from printer_slicer.sequencing.obstacles import list_obstacles
from printer_slicer.sequencing.order import find_print_order

__all__ = [
    "ObjectExtent",
    "find_print_order",
    "join_plans",
    "join_programs",
    "list_obstacles",
    "measure_extent",
]
