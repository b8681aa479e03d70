"""Purposes of extrusion, and the names that slicers give them in comments."""

from __future__ import annotations

import re
from enum import IntEnum
from typing import Final

import numpy as np

from printer_slicer.arrays import Int
from printer_slicer.roles import ROLES

__all__ = ["Purpose", "purpose_of", "purposes_of_roles"]


class Purpose(IntEnum):
    """Purpose of an extrusion, as far as comments name it."""

    UNKNOWN = 0
    OUTER_PERIMETER = 1
    INNER_PERIMETER = 2
    OVERHANG = 3
    SKIN = 4
    BRIDGE = 5
    SPARSE = 6
    GAP = 7
    IRONING = 8
    SUPPORT = 9
    BESIDE = 10

    @property
    def spoken(self) -> str:
        """Name for messages."""
        return self.name.lower().replace("_", " ")


# Role names of slicers, in lower case with spaces; the first entry that a name starts with applies.
# PrusaSlicer and SuperSlicer; OrcaSlicer and Bambu Studio; CuraEngine.
_NAMES: Final = (
    ("external perimeter", Purpose.OUTER_PERIMETER),
    ("outer wall", Purpose.OUTER_PERIMETER),
    ("wall outer", Purpose.OUTER_PERIMETER),
    ("overhang", Purpose.OVERHANG),
    ("perimeter", Purpose.INNER_PERIMETER),
    ("inner wall", Purpose.INNER_PERIMETER),
    ("wall inner", Purpose.INNER_PERIMETER),
    ("internal infill", Purpose.SPARSE),
    ("sparse infill", Purpose.SPARSE),
    ("internal bridge", Purpose.BRIDGE),
    ("bridge", Purpose.BRIDGE),
    ("gap", Purpose.GAP),
    ("thin wall", Purpose.GAP),
    ("ironing", Purpose.IRONING),
    ("solid infill", Purpose.SKIN),
    ("internal solid infill", Purpose.SKIN),
    ("top", Purpose.SKIN),
    ("bottom", Purpose.SKIN),
    ("skin", Purpose.SKIN),
    ("fill", Purpose.SPARSE),
    ("support", Purpose.SUPPORT),
    ("skirt", Purpose.BESIDE),
    ("brim", Purpose.BESIDE),
    ("prime", Purpose.BESIDE),
    ("wipe", Purpose.BESIDE),
    ("custom", Purpose.BESIDE),
)


def purpose_of(name: str) -> Purpose:
    """Return the purpose for a slicer's role name."""
    plain = re.sub(r"[\W_]+", " ", name.lower()).strip()
    return next((purpose for begin, purpose in _NAMES if plain.startswith(begin)), Purpose.UNKNOWN)


_OF_ROLE: Final = np.array([purpose_of(row.type_comment) for row in ROLES], np.int64)


def purposes_of_roles(roles: Int) -> Int:
    """(n,) the `Purpose` of each `Role`."""
    return np.asarray(_OF_ROLE[roles])
