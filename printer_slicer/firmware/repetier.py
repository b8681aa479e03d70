"""Repetier-Firmware: M201 sets printing acceleration, M202 travel acceleration, M207 jerk; M203 to M206 differ too.

Retraction lengths and maximum speeds are stored in its EEPROM, which M206 writes. M233 (pressure advance) uses units of
its own.

Sources: the list of commands in Repetier-Firmware's sources (Repetier.ino, version 1), gcode.cpp (`GCode::parseAscii`
accepts upper and lower case, `parseFloatValue`), PRINTLINE_CACHE_SIZE of Configuration.h; its documentation of G-codes;
Repetier-Server's manual on `@pause`, which the host obeys.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from printer_slicer.firmware.firmware import (
    STRTOD_NUMBERS,
    Dialect,
    Firmware,
    SetsAccelerations,
    SetsLimits,
    WireDialect,
)
from printer_slicer.texts import format_number

if TYPE_CHECKING:
    from printer_slicer.profile import Printer

__all__ = ["REPETIER"]


def _format_limits(printer: Printer) -> list[str]:
    """Format the motion limits, except maximum speeds, which the firmware stores in its EEPROM."""
    lines = []
    for code, asked in (("M201", printer.acceleration), ("M202", printer.travel_acceleration)):
        x, y = min(asked, printer.max_acceleration_x), min(asked, printer.max_acceleration_y)
        lines.append(f"{code} X{format_number(x)} Y{format_number(y)} ; mm/s^2")
    jerks = (
        f"X{format_number(printer.jerk_xy)} Z{format_number(printer.jerk_z)} E{format_number(printer.jerk_e)}"
    )
    return [*lines, f"M207 {jerks} ; mm/s"]


REPETIER: Final = Firmware(
    title="Repetier",
    dialect=Dialect(
        limits=_format_limits,
        acceleration=lambda value: f"M201 X{format_number(value)} Y{format_number(value)}",
        pause="@pause",
        counting="either",
        home_offset="never",
        any_case=True,
        numbers=STRTOD_NUMBERS,
        commands={
            "M201": SetsAccelerations({("X", "Y"): ("printing",)}),
            "M202": SetsAccelerations({("X", "Y"): ("travel",)}),
            "M203": None,
            "M204": None,
            "M205": None,
            "M207": SetsLimits("M205", {"X": "XY", "Z": "Z", "E": "E"}),
            "M208": None,
        },
    ),
    wire={
        "repetier": WireDialect(
            title="Repetier",
            m115_pattern=r"Repetier",
            resend_request=("Error:expected line 7 got 9", "", "Resend:7", "ok"),
            unnumbered_lines="refused",
            ok_when_read=True,
            queue_size=2,
        ),
    },
    planner_blocks=16,
    prusaslicer_name="repetier",
)
