"""Klipper.

Sources: Klipper's documents, "G-Codes": SET_VELOCITY_LIMIT, SET_PRESSURE_ADVANCE, SET_RETRACTION
([firmware_retraction]), M73 ([display_status]), PAUSE and RESUME ([pause_resume]), SET_GCODE_OFFSET,
SET_KINEMATIC_POSITION ([force_move]), EXCLUDE_OBJECT; "Kinematics"; gcode.py (it converts lines to
upper case) and gcode_move.py. It has no M206.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from printer_slicer.firmware.firmware import (
    Dialect,
    Firmware,
    NumberReading,
    SetsAccelerations,
    SetsRetraction,
    WireDialect,
)
from printer_slicer.texts import format_number

if TYPE_CHECKING:
    from printer_slicer.profile import Printer

__all__ = ["KLIPPER"]

_ADVICE: Final = (
    "Klipper ignores line numbers and checksums, so it executes damaged lines. If you can, upload the file to Klipper"
    " and print it from there"
)
_REJECTS: Final = "rejects the whole line"


def _format_limits(printer: Printer) -> list[str]:
    """Format the motion limits, except those of z and the extruder, which Klipper's own configuration sets."""
    acceleration, corner = format_number(printer.acceleration), format_number(printer.square_corner_velocity)
    return [
        f"SET_VELOCITY_LIMIT ACCEL={acceleration} SQUARE_CORNER_VELOCITY={corner}",
        f"SET_VELOCITY_LIMIT MINIMUM_CRUISE_RATIO={format_number(printer.minimum_cruise_ratio)}",
    ]


def _format_retraction(printer: Printer) -> list[str]:
    """Format the settings of G10 and G11, in mm and mm/s."""
    length, back = format_number(printer.retract_length), format_number(printer.retract_speed)
    extra = format_number(printer.deretract_extra)
    return [
        f"SET_RETRACTION RETRACT_LENGTH={length} RETRACT_SPEED={back}",
        f"SET_RETRACTION UNRETRACT_EXTRA_LENGTH={extra} UNRETRACT_SPEED={format_number(printer.deretract_speed)}",
    ]


KLIPPER: Final = Firmware(
    title="Klipper",
    dialect=Dialect(
        limits=_format_limits,
        acceleration=lambda value: f"SET_VELOCITY_LIMIT ACCEL={format_number(value)}",
        pause="PAUSE",
        pressure_advance=lambda seconds: f"SET_PRESSURE_ADVANCE ADVANCE={format_number(seconds)}",
        retraction=_format_retraction,
        progress=lambda percent, _minutes: f"M73 P{percent}",
        labels="exclude_object",
        counting="either",
        home_offset="never",
        extended_commands=True,
        any_case=True,
        numbers=NumberReading(_REJECTS, "ignores the word", _REJECTS),
        commands={
            "SET_RETRACTION": SetsRetraction(
                ("RETRACT_LENGTH", "RETRACT_SPEED", "UNRETRACT_SPEED", "UNRETRACT_EXTRA_LENGTH")
            ),
            "SET_VELOCITY_LIMIT": SetsAccelerations({("ACCEL",): ("printing", "travel", "retract")}),
        },
    ),
    wire={
        "klipper": WireDialect(
            title="Klipper",
            m115_pattern=r"Klipper",
            resend_request=(),
            checks_line_numbers=False,
            max_line_bytes=200,
            queue_size=20,
            max_lines_in_flight=1,
            advice=_ADVICE,
        ),
    },
    # Klipper limits its look-ahead by time, not by the number of moves; it never plans this many moves.
    planner_blocks=1000,
    has_single_acceleration=True,
    halts_out_of_bounds=True,
    allows_unhomed_moves=False,
    resume_command=b"RESUME",
    baby_step_command=lambda mm: b"SET_GCODE_OFFSET Z_ADJUST=%.3f MOVE=1" % mm,
    set_z_command=lambda mm: b"SET_KINEMATIC_POSITION Z=%s" % format_number(mm).encode(),
    cancel_object_command=lambda name: b"EXCLUDE_OBJECT NAME=%s" % name.encode(),
    prusaslicer_name="klipper",
)
