"""Prusa's own firmware, MK3 and later: the limits of Marlin 1.1, progress for both of its modes.

Source: Prusa-Firmware's list of commands (M73 P R for the normal mode, Q S for the silent one, M201 to M205,
M207, M208, M601, M900); Prusa-Firmware-Buddy's list of commands.
"""

from __future__ import annotations

from typing import Final

from printer_slicer.gcode.dialect import Dialect, jerk_line, marlin_limits, retraction_lines
from printer_slicer.macros import number
from printer_slicer.motion.counting import COUNTING

__all__ = ["PRUSA"]


PRUSA: Final = Dialect(
    limits=lambda printer: marlin_limits(printer, f"{jerk_line('M205', printer)} ; mm/s"),
    acceleration=lambda value: f"M204 P{number(value)}",
    pause="M601",
    pressure_advance=lambda seconds: f"M900 K{number(seconds)}",
    retraction=retraction_lines,
    progress=lambda percent, minutes: f"M73 Q{percent} S{minutes} P{percent} R{minutes}",
    labels="m486",
    counting=COUNTING["prusa"],
)
