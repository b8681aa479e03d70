"""RepRapFirmware of Duet boards: speeds and jerks in mm/min, pressure advance with M572.

Sources: Duet3D's G-code dictionary: "Line numbers and checksums", G10, G53, M24, M73, M201, M203, M204, M207, M226,
M290, M566, M568, M572, M595 (a ring of 40 moves on the Duet 2; later boards have more); `StringParser.cpp` (letters of
either case, CheckNumberFound).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from printer_slicer.firmware.firmware import (
    Dialect,
    Firmware,
    NumberReading,
    SetsLimits,
    WireDialect,
    format_axis_limits,
    format_jerk,
)
from printer_slicer.texts import format_number

if TYPE_CHECKING:
    from printer_slicer.profile import Printer

__all__ = ["REPRAPFIRMWARE"]

_ADVICE: Final = (
    "RepRapFirmware silently drops damaged lines. Lines are sent one at a time; if an acknowledgement is missing, the"
    " position is queried"
)
_REJECTS: Final = "rejects the whole line"
_MINUTE: Final = 60.0


def _format_limits(printer: Printer) -> list[str]:
    """Format the motion limits; the E of M201 applies to moves of the extruder alone."""
    print_, travel = format_number(printer.acceleration), format_number(printer.travel_acceleration)
    return [
        f"{format_axis_limits('M201', printer, 'max_acceleration')} ; mm/s^2",
        f"{format_axis_limits('M203', printer, 'max_speed', _MINUTE)} ; mm/min",
        f"M204 P{print_} T{travel} ; mm/s^2",
        f"{format_jerk('M566', printer, _MINUTE)} ; mm/min",
    ]


def _format_retraction(printer: Printer) -> list[str]:
    """Format M207, which sets up retraction and deretraction; F and T are in mm/min."""
    back, forward = format_number(printer.retract_speed * 60), format_number(printer.deretract_speed * 60)
    return [
        f"M207 S{format_number(printer.retract_length)} R{format_number(printer.deretract_extra)} F{back} T{forward} Z0"
    ]


REPRAPFIRMWARE: Final = Firmware(
    title="RepRapFirmware",
    dialect=Dialect(
        limits=_format_limits,
        acceleration=lambda value: f"M204 P{format_number(value)}",
        pause="M226",
        pressure_advance=lambda seconds: f"M572 D0 S{format_number(seconds)}",
        retraction=_format_retraction,
        progress=lambda percent, minutes: f"M73 P{percent} R{minutes}",
        labels="m486_quoted",
        m486="m486_quoted",
        counting="apart",
        machine_coordinates=True,
        tool_temperatures=True,
        any_case=True,
        numbers=NumberReading(_REJECTS, _REJECTS, "reads only the valid part at its start"),
        commands={
            "M203": SetsLimits("M203", scale=1 / _MINUTE),
            "M566": SetsLimits("M205", scale=1 / _MINUTE),
        },
    ),
    wire={
        "reprapfirmware": WireDialect(
            title="RepRapFirmware",
            m115_pattern=r"RepRapFirmware",
            resend_request=("rs 7",),
            checksum="crc16",
            checks_line_numbers=False,
            max_line_bytes=160,
            queue_size=1,
            max_lines_in_flight=1,
            advice=_ADVICE,
        ),
    },
    planner_blocks=40,
    halts_out_of_bounds=True,
    resume_command=b"M24",
    baby_step_command=lambda mm: b"M290 S%.3f" % mm,
    prusaslicer_name="reprapfirmware",
)
