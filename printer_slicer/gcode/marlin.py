"""Marlin 2.

Source: marlinfw.org, "G-code index": M73, M201, M203, M204, M205, M207, M208, M900.
"""

from __future__ import annotations

from typing import Final

from printer_slicer.gcode.dialect import Dialect, jerk_line, marlin_limits, retraction_lines
from printer_slicer.macros import number
from printer_slicer.profile import Printer

__all__ = ["MARLIN"]


def _limits(printer: Printer) -> list[str]:
    """Corners as the profile has them."""
    if printer.corner == "jerk":
        return marlin_limits(printer, f"{jerk_line('M205', printer)} ; mm/s")
    return marlin_limits(printer, f"M205 J{number(printer.junction_deviation)} ; mm")


MARLIN: Final = Dialect(
    limits=_limits,
    acceleration=lambda value: f"M204 P{number(value)}",
    pause="M0",
    pressure_advance=lambda seconds: f"M900 K{number(seconds)}",
    retraction=retraction_lines,
    progress=lambda percent, minutes: f"M73 P{percent} R{minutes}",
)
