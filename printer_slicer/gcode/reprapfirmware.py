"""RepRapFirmware of Duet boards: speeds and jerks in mm/min, pressure advance by M572.

Source: Duet3D's G-code dictionary: M73, M201, M203, M204, M207, M226, M566, M572.
Letters of either case: `StringParser.cpp`.
"""

from __future__ import annotations

from typing import Final

from printer_slicer.gcode.dialect import Dialect, axes_line, jerk_line
from printer_slicer.gcode.reading import limit, move_in_machine_coordinates
from printer_slicer.macros import number
from printer_slicer.motion.counting import COUNTING
from printer_slicer.profile import Printer

__all__ = ["REPRAPFIRMWARE"]

_MINUTE: Final = 60.0


def _limits(printer: Printer) -> list[str]:
    """Moves of the extruder alone go by M201 E."""
    print_, travel = number(printer.acceleration), number(printer.travel_acceleration)
    return [
        f"{axes_line('M201', printer, 'max_acceleration')} ; mm/s^2",
        f"{axes_line('M203', printer, 'max_speed', _MINUTE)} ; mm/min",
        f"M204 P{print_} T{travel} ; mm/s^2",
        f"{jerk_line('M566', printer, _MINUTE)} ; mm/min",
    ]


def _retraction(printer: Printer) -> list[str]:
    """M207 holds both ways; F and T in mm/min."""
    back, forward = number(printer.retract_speed * 60), number(printer.deretract_speed * 60)
    return [
        f"M207 S{number(printer.retract_length)} R{number(printer.deretract_extra)} F{back} T{forward} Z0"
    ]


REPRAPFIRMWARE: Final = Dialect(
    limits=_limits,
    acceleration=lambda value: f"M204 P{number(value)}",
    pause="M226",
    pressure_advance=lambda seconds: f"M572 D0 S{number(seconds)}",
    retraction=_retraction,
    progress=lambda percent, minutes: f"M73 P{percent} R{minutes}",
    labels="m486_quoted",
    m486="m486_quoted",
    reads={
        "G53": move_in_machine_coordinates,
        "M203": limit("M203", scale=1 / _MINUTE),
        "M566": limit("M205", scale=1 / _MINUTE),
    },
    counting=COUNTING["reprapfirmware"],
    any_case=True,
)
