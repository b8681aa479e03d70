"""Klipper."""

from __future__ import annotations

from typing import Final

from printer_slicer.gcode.dialect import Dialect, bed_line, fan_line, nozzle_line
from printer_slicer.macros import number
from printer_slicer.profile import Printer

__all__ = ["KLIPPER"]


def _limits(printer: Printer) -> list[str]:
    """SET_VELOCITY_LIMIT; the limits of z and extruder are part of Klipper's own configuration."""
    return [
        " ".join(
            [
                "SET_VELOCITY_LIMIT",
                f"ACCEL={number(printer.acceleration)}",
                f"SQUARE_CORNER_VELOCITY={number(printer.square_corner_velocity)}",
                f"MINIMUM_CRUISE_RATIO={number(printer.minimum_cruise_ratio)}",
            ]
        )
    ]


KLIPPER: Final = Dialect(limits=_limits, fan=fan_line, nozzle=nozzle_line, bed=bed_line, pause="PAUSE")
