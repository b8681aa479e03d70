"""Programs with planted faults."""

from __future__ import annotations

import numpy as np

from printer_slicer.arrays import Bool
from printer_slicer.model import Program
from printer_slicer.roles import Role
from printer_slicer.values import replace


def without(made: Program, gone: Bool) -> Program:
    """The program with some beads turned into travels; nothing is fed for them."""
    return replace(
        made,
        role=np.where(gone, Role.TRAVEL, made.role),
        filament=np.where(gone, 0.0, made.filament),
        width=np.where(gone, 0.0, made.width),
        height=np.where(gone, 0.0, made.height),
    )
