"""Klipper.

Source: Klipper's documents, "G-Codes": SET_VELOCITY_LIMIT, SET_PRESSURE_ADVANCE, SET_RETRACTION
([firmware_retraction]), M73 ([display_status]), PAUSE ([pause_resume]). It turns a line into
capitals before it reads it (`gcode.py`).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from printer_slicer.gcode.dialect import Dialect
from printer_slicer.gcode.reading import ReadingState, passed_over, set_accelerations
from printer_slicer.macros import number
from printer_slicer.motion.counting import COUNTING
from printer_slicer.profile import Printer

__all__ = ["KLIPPER"]


def _limits(printer: Printer) -> list[str]:
    """The limits of z and extruder are part of Klipper's own configuration."""
    acceleration, corner = number(printer.acceleration), number(printer.square_corner_velocity)
    return [
        f"SET_VELOCITY_LIMIT ACCEL={acceleration} SQUARE_CORNER_VELOCITY={corner}",
        f"SET_VELOCITY_LIMIT MINIMUM_CRUISE_RATIO={number(printer.minimum_cruise_ratio)}",
    ]


def _retraction(printer: Printer) -> list[str]:
    """Mm and mm/s."""
    length, back = number(printer.retract_length), number(printer.retract_speed)
    extra = number(printer.deretract_extra)
    return [
        f"SET_RETRACTION RETRACT_LENGTH={length} RETRACT_SPEED={back}",
        f"SET_RETRACTION UNRETRACT_EXTRA_LENGTH={extra} UNRETRACT_SPEED={number(printer.deretract_speed)}",
    ]


def _set_retraction(state: ReadingState, words: Mapping[str, float], _index: int) -> None:
    """SET_RETRACTION."""
    names = ("RETRACT_LENGTH", "RETRACT_SPEED", "UNRETRACT_SPEED", "UNRETRACT_EXTRA_LENGTH")
    old = state.retraction
    length, back, forward, extra = (words.get(name, value) for name, value in zip(names, old, strict=True))
    state.retraction = length, back, forward, extra


def _set_velocity_limit(state: ReadingState, words: Mapping[str, float], index: int) -> None:
    """SET_VELOCITY_LIMIT: of it only the acceleration, which is that of all moves."""
    accelerate = set_accelerations("printing", "travel", "retract", letters="S")
    accelerate(state, {"S": words.get("ACCEL", 0.0)}, index)


KLIPPER: Final = Dialect(
    limits=_limits,
    acceleration=lambda value: f"SET_VELOCITY_LIMIT ACCEL={number(value)}",
    pause="PAUSE",
    pressure_advance=lambda seconds: f"SET_PRESSURE_ADVANCE ADVANCE={number(seconds)}",
    retraction=_retraction,
    progress=lambda percent, _minutes: f"M73 P{percent}",
    labels="exclude_object",
    reads={
        "M206": passed_over,
        "SET_RETRACTION": _set_retraction,
        "SET_VELOCITY_LIMIT": _set_velocity_limit,
    },
    counting=COUNTING["klipper"],
    any_case=True,
)
