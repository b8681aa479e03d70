"""What is wrong with a printer's macros whatever is printed: what cannot be read, and names that nothing has."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from printer_slicer.errors import ProfileError
from printer_slicer.gcode.facts import layer_facts, print_facts
from printer_slicer.macros import read_template
from printer_slicer.model import LayerPlan, Program
from printer_slicer.profile import Printer
from printer_slicer.profile.checks import Conflict
from printer_slicer.profile.inspection import alone
from printer_slicer.profile.planners import PLANNER_SETTINGS

__all__ = ["macro_faults"]

_IN_LAYERS: Final = frozenset({"before_layer_gcode", "layer_gcode", "pause_gcode"})
"""Macros that may speak of a layer."""


def macro_faults(printer: Printer) -> Iterator[Conflict]:
    """The first fault of each macro; values, which hang on part, material and quality, are not asked for."""
    nothing = _no_moves()
    known = set(print_facts(nothing, alone(printer)))
    # Every quality has other settings of its planner.
    of_planners = {name for kind in PLANNER_SETTINGS.values() for name in kind.__struct_fields__}
    known |= {f"{section}planner.{name}" for name in of_planners for section in ("", "quality.")}
    in_layer = known | set(layer_facts(nothing, 0, 0.0, 0.0))
    for name in printer.__struct_fields__:
        if not name.endswith("_gcode"):
            continue
        key = f"printer.{name}"
        try:
            template = read_template(getattr(printer, name), key)
            template.check(in_layer if name in _IN_LAYERS else known)
        except ProfileError as error:
            yield Conflict(key, str(error.args[0]).removeprefix(f"{key}: "), error.remedy)


def _no_moves() -> Program:
    """A program of one layer in which nothing is printed: facts of it have the names of all facts."""
    none = np.zeros(0)
    return Program(
        plan=LayerPlan.from_tops(np.array([0.2])),
        origin=np.zeros(3),
        xyz=np.zeros((0, 3)),
        filament=none,
        speed=none,
        layer=none,
        role=none,
        width=none,
        height=none,
    )
