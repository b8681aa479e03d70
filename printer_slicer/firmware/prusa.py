"""Prusa's firmware for MK3 and later: the limits of Marlin 1.1, progress for normal and silent mode.

Sources: Prusa-Firmware's list of commands (M73 P R for the normal mode, Q S for the silent one, M201 to M205, M207,
M208, M601, M602, M900; G90: "E axis is left intact"), its cmdqueue.cpp and `code_value`, BLOCK_BUFFER_SIZE of
Configuration_adv.h; Prusa-Firmware-Buddy's list of commands.
"""

from __future__ import annotations

from typing import Final

from printer_slicer.firmware.firmware import (
    MARLIN_RESEND,
    STRTOD_NUMBERS,
    Dialect,
    Firmware,
    WireDialect,
    format_marlin_limits,
    format_retraction,
)
from printer_slicer.texts import format_number

__all__ = ["PRUSA"]

PRUSA: Final = Firmware(
    title="Prusa's firmware",
    dialect=Dialect(
        limits=format_marlin_limits,
        acceleration=lambda value: f"M204 P{format_number(value)}",
        pause="M601",
        pressure_advance=lambda seconds: f"M900 K{format_number(seconds)}",
        retraction=format_retraction,
        progress=lambda percent, minutes: f"M73 Q{percent} S{minutes} P{percent} R{minutes}",
        labels="m486",
        counting="apart",
        numbers=STRTOD_NUMBERS,
    ),
    wire={
        "prusa": WireDialect(
            title="Prusa MK3",
            m115_pattern=r"Prusa-Firmware(?!-Buddy)",
            resend_request=MARLIN_RESEND,
            unnumbered_lines="refused",
        ),
    },
    planner_blocks=16,
    also_reads=frozenset({"marlin", "marlin_legacy"}),
    has_quick_stop=True,
    resume_command=b"M602",
)
