"""Repetier-Firmware: accelerations by M201 (printing) and M202 (travelling), jerk by M207; M203 to M206 are others.

Source: the list of commands in Repetier-Firmware's sources (Repetier.ino, version 1), and Repetier-Server's manual on
`@pause`, which the host obeys. Letters of either case: `GCode::parseAscii`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from printer_slicer.gcode.dialect import Dialect
from printer_slicer.gcode.reading import ReadingState, limit, passed_over, set_accelerations
from printer_slicer.macros import number
from printer_slicer.motion.counting import COUNTING
from printer_slicer.profile import Printer

__all__ = ["REPETIER"]


def _limits(printer: Printer) -> list[str]:
    """The greatest speeds are part of its EEPROM."""
    lines = []
    for code, asked in (("M201", printer.acceleration), ("M202", printer.travel_acceleration)):
        x, y = min(asked, printer.max_acceleration_x), min(asked, printer.max_acceleration_y)
        lines.append(f"{code} X{number(x)} Y{number(y)} ; mm/s^2")
    jerks = f"X{number(printer.jerk_xy)} Z{number(printer.jerk_z)} E{number(printer.jerk_e)}"
    return [*lines, f"M207 {jerks} ; mm/s"]


def _jerks(state: ReadingState, words: Mapping[str, float], index: int) -> None:
    """M207: X counts for Y too."""
    both = {"Y": words["X"]} if "X" in words else {}
    limit("M205")(state, {**words, **both}, index)


REPETIER: Final = Dialect(
    limits=_limits,
    acceleration=lambda value: f"M201 X{number(value)} Y{number(value)}",
    pause="@pause",
    reads={
        "M201": set_accelerations("printing", letters="XY"),
        "M202": set_accelerations("travel", letters="XY"),
        "M203": passed_over,
        "M204": passed_over,
        "M205": passed_over,
        "M206": passed_over,
        "M207": _jerks,
        "M208": passed_over,
    },
    counting=COUNTING["repetier"],
    any_case=True,
)
