"""Why beads are laid."""

from __future__ import annotations

from enum import IntEnum

import numpy as np

from printer_slicer.geometry import Bool, Int

__all__ = ["Role", "is_perimeter"]


class Role(IntEnum):
    """Why a bead is laid. The order is the order in which the parts of one island are printed."""

    TRAVEL = 0
    SKIRT = 1
    BRIM = 2
    RAFT = 3
    INNER_PERIMETER = 4
    OUTER_PERIMETER = 5
    OVERHANG_PERIMETER = 6  # a bead of a perimeter that is carried by less than half
    BRIDGE = 7
    BOTTOM_SKIN = 8
    SPARSE = 9
    INTERNAL_BRIDGE = 10
    SOLID = 11
    TOP_SKIN = 12
    IRONING = 13


def is_perimeter(role: Int) -> Bool:
    """(n,) whether roles (n,) of paths are those of perimeters; OVERHANG_PERIMETER is one of single beads only."""
    return np.asarray((role == Role.OUTER_PERIMETER) | (role == Role.INNER_PERIMETER))
