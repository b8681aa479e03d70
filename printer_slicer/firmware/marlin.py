"""Marlin 2.

Sources: marlinfw.org, "G-code index": M73, M110, M201, M203, M204, M205, M207, M208, M290, M410, M900; its sources:
BLOCK_BUFFER_SIZE of Configuration_adv.h, queue.cpp, `GCodeParser::parse` and `valid_float`, gcode.h (M82).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from printer_slicer.firmware.firmware import (
    MARLIN_RESEND,
    Dialect,
    Firmware,
    WireDialect,
    format_marlin_limits,
    format_retraction,
)
from printer_slicer.texts import format_number

if TYPE_CHECKING:
    from printer_slicer.profile import Printer

__all__ = ["MARLIN"]


def _format_limits(printer: Printer) -> list[str]:
    """Format the motion limits, with jerk or junction deviation as in the profile."""
    jerk = printer.corner == "jerk"
    return format_marlin_limits(
        printer, "" if jerk else f"M205 J{format_number(printer.junction_deviation)} ; mm"
    )


MARLIN: Final = Firmware(
    title="Marlin",
    dialect=Dialect(
        limits=_format_limits,
        acceleration=lambda value: f"M204 P{format_number(value)}",
        pause="M0",
        pressure_advance=lambda seconds: f"M900 K{format_number(seconds)}",
        retraction=format_retraction,
        progress=lambda percent, minutes: f"M73 P{percent} R{minutes}",
    ),
    wire={
        "marlin_2_1_3": WireDialect(
            title="Marlin 2.1.3 and later",
            m115_pattern=r"Marlin (?:bugfix-)?2\.(?:1\.(?:[3-9]|[12]\d)|[2-9])",
            resend_request=MARLIN_RESEND,
            reports_last_line=True,
        ),
        "marlin": WireDialect(title="Marlin 2", m115_pattern=r"", resend_request=MARLIN_RESEND),
    },
    planner_blocks=16,
    also_reads=frozenset({"marlin_legacy"}),
    has_quick_stop=True,
    prusaslicer_name="marlin2",
)
