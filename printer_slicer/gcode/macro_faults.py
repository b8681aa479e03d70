"""Errors in a printer's macros that do not depend on a print: syntax, unknown names and functions."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from printer_slicer.errors import ProfileError
from printer_slicer.gcode.facts import collect_end_facts, collect_layer_facts, collect_print_facts
from printer_slicer.macros import read_template
from printer_slicer.model import LayerPlan, Program
from printer_slicer.profile import Printer
from printer_slicer.profile.checks import Conflict
from printer_slicer.profile.inspection import make_profile_for_printer
from printer_slicer.profile.planners import PLANNER_SETTINGS

__all__ = ["find_macro_faults"]

_LAYER_MACROS: Final = frozenset({"before_layer_gcode", "layer_gcode", "pause_gcode"})
"""Macros that may use facts about a layer."""


def find_macro_faults(printer: Printer) -> Iterator[Conflict]:
    """Yield the first error of each macro; values are not computed, because they depend on the print."""
    nothing = _build_empty_program()
    profile = make_profile_for_printer(printer)
    known = set(collect_print_facts(nothing, profile))
    # Which planner settings exist depends on the quality.
    of_planners = {name for kind in PLANNER_SETTINGS.values() for name in kind.__struct_fields__}
    known |= {f"{section}planner.{name}" for name in of_planners for section in ("", "quality.")}
    more = dict.fromkeys(_LAYER_MACROS, collect_layer_facts(nothing, 0, 0.0, 0.0)) | {
        "end_gcode": collect_end_facts(nothing, profile)
    }
    for name in printer.__struct_fields__:
        if not name.endswith("_gcode"):
            continue
        key = f"printer.{name}"
        try:
            template = read_template(getattr(printer, name), key)
            template.check(known | set(more.get(name, ())))
        except ProfileError as error:
            yield Conflict(key, str(error.args[0]).removeprefix(f"{key}: "), error.remedy)


def _build_empty_program() -> Program:
    """Return a program of one layer without moves; it has the same placeholders as any other print."""
    none = np.zeros(0)
    return Program(
        plan=LayerPlan.from_tops(np.array([0.2])),
        origin=np.zeros(3),
        xyz=np.zeros((0, 3)),
        filament=none,
        speed=none,
        layer=np.zeros(0, np.int64),
        role=np.zeros(0, np.int64),
        width=none,
        height=none,
    )
