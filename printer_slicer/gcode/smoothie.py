"""Smoothieware: one acceleration (M204 S), junction deviation by M205 X, limits of the extruder apart.

Source: smoothieware.org, "Supported G-codes", and the comments in what M503 answers.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from printer_slicer.gcode.dialect import Dialect, retraction_lines
from printer_slicer.gcode.reading import (
    ReadingState,
    limit,
    move_in_machine_coordinates,
    offset_next_homing,
    set_accelerations,
)
from printer_slicer.macros import number
from printer_slicer.profile import Printer

__all__ = ["SMOOTHIE"]


def _limits(printer: Printer) -> list[str]:
    """The accelerations of single axes are part of its configuration."""
    speeds = " ".join(f"{axis.upper()}{number(getattr(printer, f'max_speed_{axis}'))}" for axis in "xyz")
    return [
        f"M203 {speeds} ; mm/s",
        f"M203 E{number(printer.max_speed_e)} ; mm/s",
        f"M204 S{number(printer.acceleration)} ; mm/s^2",
        f"M204 E{number(printer.retract_acceleration)} ; mm/s^2",
        f"M205 X{number(printer.junction_deviation)} ; mm",
    ]


def _accelerations(state: ReadingState, words: Mapping[str, float], index: int) -> None:
    """M204: S for all moves, E for those of the extruder alone."""
    set_accelerations("printing", "travel", letters="S")(state, words, index)
    set_accelerations("retract", letters="E")(state, words, index)


SMOOTHIE: Final = Dialect(
    limits=_limits,
    acceleration=lambda value: f"M204 S{number(value)}",
    pause="M600",
    retraction=retraction_lines,
    reads={
        "G53": move_in_machine_coordinates,
        "M204": _accelerations,
        "M205": limit("M205", {"X": "J"}),
        "M206": offset_next_homing,
    },
)
