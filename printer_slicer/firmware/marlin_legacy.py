"""Marlin 1.1: jerk instead of junction deviation, progress without remaining time, relative E after G91.

Sources: marlinfw.org, "G-code index" (which version added which command); Marlin 1.1's sources: M204 and M205,
Marlin_main.cpp (M82 and G91), BLOCK_BUFFER_SIZE of Configuration_adv.h.
"""

from __future__ import annotations

from typing import Final

from printer_slicer.firmware.firmware import (
    MARLIN_RESEND,
    Dialect,
    Firmware,
    WireDialect,
    format_marlin_limits,
    format_retraction,
)
from printer_slicer.texts import format_number

__all__ = ["MARLIN_LEGACY"]

MARLIN_LEGACY: Final = Firmware(
    title="Marlin",
    dialect=Dialect(
        limits=format_marlin_limits,
        acceleration=lambda value: f"M204 P{format_number(value)}",
        pause="M0",
        pressure_advance=lambda seconds: f"M900 K{format_number(seconds)}",
        retraction=format_retraction,
        progress=lambda percent, _minutes: f"M73 P{percent}",
        counting="either",
    ),
    wire={
        "marlin_1": WireDialect(
            title="Marlin 1.1", m115_pattern=r"Marlin V?1\.", resend_request=MARLIN_RESEND
        )
    },
    planner_blocks=16,
    has_quick_stop=True,
    prusaslicer_name="marlin",
)
