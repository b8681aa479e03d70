"""The values that flow: Mesh -> LayerPlan -> Sections -> Walls, Regions -> Toolpaths -> Travels -> Program.

All are frozen and hold read-only arrays. Letters in shapes: F facets, L layers, R rings, M paths, N points, K moves.
Lengths are mm, times s, speeds mm/s, temperatures °C.
"""

from printer_slicer.geometry import Areas, Bool, Float, Int
from printer_slicer.model.items import Item, Labels
from printer_slicer.model.layers import Contours, Gap, LayerPlan, Regions, Sections
from printer_slicer.model.part import Faults, Mesh, Repair, Repairs
from printer_slicer.model.paths import (
    Acceleration,
    Event,
    Fan,
    Heat,
    PressureAdvance,
    Program,
    ToolChange,
    Toolpaths,
    reordered,
)
from printer_slicer.model.roles import ROLES, Phase, Role, RoleRow, is_perimeter, roles_with
from printer_slicer.model.travels import Travels, leaves
from printer_slicer.model.walls import Walls

__all__ = [
    "ROLES",
    "Acceleration",
    "Areas",
    "Bool",
    "Contours",
    "Event",
    "Fan",
    "Faults",
    "Float",
    "Gap",
    "Heat",
    "Int",
    "Item",
    "Labels",
    "LayerPlan",
    "Mesh",
    "Phase",
    "PressureAdvance",
    "Program",
    "Regions",
    "Repair",
    "Repairs",
    "Role",
    "RoleRow",
    "Sections",
    "ToolChange",
    "Toolpaths",
    "Travels",
    "Walls",
    "is_perimeter",
    "leaves",
    "reordered",
    "roles_with",
]
