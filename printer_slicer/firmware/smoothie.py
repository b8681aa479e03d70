"""Smoothieware: one acceleration (M204 S), junction deviation with M205 X, separate limits of the extruder.

Sources: smoothieware.org, "Supported G-codes", and the comments in the reply to M503; its sources: GcodeDispatch.cpp,
`Gcode::get_value`, Endstops.cpp (M206 in mm even after G20, applied at the next homing), planner_queue_size.
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
    format_retraction,
)
from printer_slicer.texts import format_number

if TYPE_CHECKING:
    from printer_slicer.profile import Printer

__all__ = ["SMOOTHIE"]


def _format_limits(printer: Printer) -> list[str]:
    """Format the motion limits, except accelerations of single axes, which Smoothieware's configuration sets."""
    speeds = " ".join(
        f"{axis.upper()}{format_number(getattr(printer, f'max_speed_{axis}'))}" for axis in "xyz"
    )
    return [
        f"M203 {speeds} ; mm/s",
        f"M203 E{format_number(printer.max_speed_e)} ; mm/s",
        f"M204 S{format_number(printer.acceleration)} ; mm/s^2",
        f"M204 E{format_number(printer.retract_acceleration)} ; mm/s^2",
        f"M205 X{format_number(printer.junction_deviation)} ; mm",
    ]


SMOOTHIE: Final = Firmware(
    title="Smoothieware",
    dialect=Dialect(
        limits=_format_limits,
        acceleration=lambda value: f"M204 S{format_number(value)}",
        pause="M600",
        retraction=format_retraction,
        home_offset="when homed",
        machine_coordinates=True,
        numbers=STRTOD_NUMBERS,
        commands={
            "M204": SetsAccelerations({("S",): ("printing", "travel"), ("E",): ("retract",)}),
            "M205": SetsLimits("M205", {"X": "J"}),
        },
    ),
    wire={
        "smoothie": WireDialect(
            title="Smoothie",
            m115_pattern=r"Smoothie",
            resend_request=("rs N7",),
            max_line_bytes=120,
            queue_size=1,
        )
    },
    planner_blocks=32,
    has_single_acceleration=True,
    prusaslicer_name="smoothie",
)
