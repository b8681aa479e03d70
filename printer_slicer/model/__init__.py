"""The data model: Mesh -> LayerPlan -> Sections -> Walls, Regions -> Toolpaths -> Travels -> Program.

All classes are frozen and have read-only arrays. Letters in shapes: F facets, L layers, R rings, M paths, N points,
K moves. Units are mm, s, mm/s and °C.
"""

from printer_slicer.geometry import Areas
from printer_slicer.model.layers import (
    ContourDeviations,
    ContourRule,
    Contours,
    Gap,
    LayerPlan,
    ObjectStack,
    Regions,
    Sections,
)
from printer_slicer.model.overhangs import Overhangs
from printer_slicer.model.part import Mesh, MeshFaults, Repair, Repairs
from printer_slicer.model.paths import (
    Acceleration,
    Event,
    Fan,
    Heat,
    PressureAdvance,
    Program,
    ToolChange,
    Toolpaths,
    reorder_ragged,
)
from printer_slicer.model.plate_objects import Labels, PlateObject
from printer_slicer.model.section_stacks import fill_layers, stack_sections
from printer_slicer.model.supports import SupportPlan, Supports, UnsupportedPlace
from printer_slicer.model.travels import Travels, find_travel_ends
from printer_slicer.model.volumes import Volumes, VolumeSections
from printer_slicer.model.walls import Walls

__all__ = [
    "Acceleration",
    "Areas",
    "ContourDeviations",
    "ContourRule",
    "Contours",
    "Event",
    "Fan",
    "Gap",
    "Heat",
    "Labels",
    "LayerPlan",
    "Mesh",
    "MeshFaults",
    "ObjectStack",
    "Overhangs",
    "PlateObject",
    "PressureAdvance",
    "Program",
    "Regions",
    "Repair",
    "Repairs",
    "Sections",
    "SupportPlan",
    "Supports",
    "ToolChange",
    "Toolpaths",
    "Travels",
    "UnsupportedPlace",
    "VolumeSections",
    "Volumes",
    "Walls",
    "fill_layers",
    "find_travel_ends",
    "reorder_ragged",
    "stack_sections",
]
