"""Marlin 1.1: jerk instead of junction deviation, progress without the time left, objects not cancelled by M486.

Source: marlinfw.org, "G-code index" (which version brought what); Marlin 1.1's sources, M204 and M205.
"""

from __future__ import annotations

from typing import Final

from printer_slicer.gcode.dialect import Dialect, jerk_line, marlin_limits, retraction_lines
from printer_slicer.macros import number
from printer_slicer.motion.counting import COUNTING

__all__ = ["MARLIN_LEGACY"]


MARLIN_LEGACY: Final = Dialect(
    limits=lambda printer: marlin_limits(printer, f"{jerk_line('M205', printer)} ; mm/s"),
    acceleration=lambda value: f"M204 P{number(value)}",
    pause="M0",
    pressure_advance=lambda seconds: f"M900 K{number(seconds)}",
    retraction=retraction_lines,
    progress=lambda percent, _minutes: f"M73 P{percent}",
    counting=COUNTING["marlin_legacy"],
)
