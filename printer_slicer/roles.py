"""Roles of extrusions and their properties, one row for each role.

A new role needs a new member of `Role` and its row; nothing else lists roles or depends on their numbers.
"""

from __future__ import annotations

from enum import Enum, IntEnum
from typing import Final

import numpy as np

from printer_slicer.arrays import Bool, SmallInt
from printer_slicer.deprecation import RenamedMembers
from printer_slicer.values import Struct

__all__ = ["ROLES", "Phase", "Role", "RoleRow", "is_perimeter", "roles_with"]


class Role(IntEnum, metaclass=RenamedMembers):
    """Role of an extrusion; the number is the index of its row in `ROLES`."""

    __former_names__ = {  # noqa: RUF012 - names with double underscores are not members
        "INNER_PERIMETER": "PERIMETER",
        "OUTER_PERIMETER": "EXTERNAL_PERIMETER",
        "BOTTOM_SKIN": "BOTTOM_SOLID_INFILL",
        "SPARSE": "INTERNAL_INFILL",
        "SOLID": "SOLID_INFILL",
        "TOP_SKIN": "TOP_SOLID_INFILL",
    }

    TRAVEL = 0
    SKIRT = 1
    BRIM = 2
    RAFT = 3
    SUPPORT = 4
    SUPPORT_INTERFACE = 5
    PERIMETER = 6
    EXTERNAL_PERIMETER = 7
    OVERHANG_PERIMETER = 8
    BRIDGE = 9
    BOTTOM_SOLID_INFILL = 10
    INTERNAL_INFILL = 11
    INTERNAL_BRIDGE = 12
    SOLID_INFILL = 13
    TOP_SOLID_INFILL = 14
    IRONING = 15


class Phase(Enum):
    """Phase in which a role is printed within its island; `ordering` defines their order."""

    BASE = "before the part"
    PERIMETERS = "perimeters"
    BRIDGES = "bridges"
    INFILL = "infill"
    TOP = "top solid infill"
    IRONING = "ironing"


class RoleRow(Struct, frozen=True):
    """Properties of a role.

    Attributes:
        type_comment: name in `;TYPE:` comments, as viewers of PrusaSlicer and OrcaSlicer know it.
        phase: phase in which it is printed within its island.
        speed: setting in `Profile.speeds` that applies above the first layer.
        acceleration: setting in `Profile.accelerations`.
        slowed_in: number of the pass, from 0, in which it is first slowed down on layers that print too fast to cool.
        colour: colour in pictures.
        is_part: whether it belongs to the part.
        is_infill: whether it fills the area inside the perimeters; bridges do not count.
        is_bridge: whether its lines hang between two ends.
        is_top: whether it is visible from above.
        is_around: whether it surrounds or lies beside all objects, and so belongs to no island; for a raft this holds
            only for closed paths.
        is_support: whether it carries what hangs.
    """

    type_comment: str
    phase: Phase
    speed: str
    acceleration: str
    slowed_in: int
    colour: str
    is_part: bool = True
    is_infill: bool = False
    is_bridge: bool = False
    is_top: bool = False
    is_around: bool = False
    is_support: bool = False


_ROWS: Final = {
    Role.TRAVEL: RoleRow("", Phase.BASE, "travel", "default", 0, "#000000", is_part=False),
    Role.SKIRT: RoleRow(
        "Skirt/Brim", Phase.BASE, "external_perimeter", "default", 1, "#999999", is_part=False, is_around=True
    ),
    Role.BRIM: RoleRow(
        "Skirt/Brim", Phase.BASE, "first_layer", "default", 1, "#666666", is_part=False, is_around=True
    ),
    Role.RAFT: RoleRow(
        "Support material", Phase.BASE, "raft", "default", 0, "#b0a080", is_part=False, is_around=True
    ),
    Role.SUPPORT: RoleRow(
        "Support material",
        Phase.BASE,
        "support",
        "default",
        0,
        "#cc79a7",
        is_part=False,
        is_around=True,
        is_support=True,
    ),
    Role.SUPPORT_INTERFACE: RoleRow(
        "Support material interface",
        Phase.BASE,
        "support_interface",
        "default",
        1,
        "#8a4a70",
        is_part=False,
        is_around=True,
        is_support=True,
    ),
    Role.PERIMETER: RoleRow("Perimeter", Phase.PERIMETERS, "perimeter", "perimeter", 0, "#f0d000"),
    Role.EXTERNAL_PERIMETER: RoleRow(
        "External perimeter", Phase.PERIMETERS, "external_perimeter", "external_perimeter", 1, "#d55e00"
    ),
    # Moves of a perimeter with less than half of their width supported; whole paths never have this role.
    Role.OVERHANG_PERIMETER: RoleRow(
        "Overhang perimeter", Phase.PERIMETERS, "external_perimeter", "overhang", 2, "#7a1f1f"
    ),
    Role.BRIDGE: RoleRow("Bridge infill", Phase.BRIDGES, "bridge", "bridge", 2, "#56b4e9", is_bridge=True),
    Role.BOTTOM_SOLID_INFILL: RoleRow(
        "Solid infill", Phase.INFILL, "solid_infill", "solid_infill", 0, "#0072b2", is_infill=True
    ),
    Role.INTERNAL_INFILL: RoleRow(
        "Internal infill", Phase.INFILL, "internal_infill", "internal_infill", 0, "#009e73", is_infill=True
    ),
    Role.INTERNAL_BRIDGE: RoleRow(
        "Bridge infill", Phase.INFILL, "internal_bridge", "bridge", 2, "#56b4e9", is_bridge=True
    ),
    Role.SOLID_INFILL: RoleRow(
        "Solid infill", Phase.INFILL, "solid_infill", "solid_infill", 0, "#0072b2", is_infill=True
    ),
    Role.TOP_SOLID_INFILL: RoleRow(
        "Top solid infill",
        Phase.TOP,
        "top_solid_infill",
        "top_solid_infill",
        1,
        "#222222",
        is_infill=True,
        is_top=True,
    ),
    Role.IRONING: RoleRow(
        "Ironing", Phase.IRONING, "ironing", "top_solid_infill", 1, "#e0e0e0", is_infill=True, is_top=True
    ),
}

ROLES: Final = tuple(_ROWS[role] for role in Role)
"""The row of each role, by its number."""


def roles_with(  # noqa: PLR0913 - one argument per property
    *,
    is_part: bool | None = None,
    is_infill: bool | None = None,
    is_bridge: bool | None = None,
    is_top: bool | None = None,
    is_around: bool | None = None,
    is_support: bool | None = None,
    phase: Phase | None = None,
) -> Bool:
    """Return a mask (roles,) of the roles that have the given properties; index it with role numbers (n,)."""
    asked = {
        "is_part": is_part,
        "is_infill": is_infill,
        "is_bridge": is_bridge,
        "is_top": is_top,
        "is_around": is_around,
        "is_support": is_support,
        "phase": phase,
    }
    wanted = {name: value for name, value in asked.items() if value is not None}
    return np.array([all(getattr(row, name) == value for name, value in wanted.items()) for row in ROLES])


def is_perimeter(role: SmallInt) -> Bool:
    """Return whether each role (n,) of a path is a perimeter; only moves, not paths, have OVERHANG_PERIMETER."""
    return np.asarray((role == Role.EXTERNAL_PERIMETER) | (role == Role.PERIMETER))
