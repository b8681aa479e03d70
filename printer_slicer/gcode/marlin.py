"""Marlin 2."""

from __future__ import annotations

from typing import Final

from printer_slicer.gcode.dialect import Dialect, bed_line, fan_line, nozzle_line
from printer_slicer.macros import number
from printer_slicer.profile import Printer

__all__ = ["MARLIN"]


def _limits(printer: Printer) -> list[str]:
    """M201, M203, M204 and M205 as Marlin 2 documents them."""
    axes = ("x", "y", "z", "e")
    acceleration = " ".join(f"{a.upper()}{number(getattr(printer, f'max_acceleration_{a}'))}" for a in axes)
    speed = " ".join(f"{a.upper()}{number(getattr(printer, f'max_speed_{a}'))}" for a in axes)
    if printer.corner == "jerk":
        xy, z, e = number(printer.jerk_xy), number(printer.jerk_z), number(printer.jerk_e)
        corner = f"M205 X{xy} Y{xy} Z{z} E{e} ; mm/s"
    else:
        corner = f"M205 J{number(printer.junction_deviation)} ; mm"
    print_, retract = number(printer.acceleration), number(printer.retract_acceleration)
    return [
        f"M201 {acceleration} ; mm/s^2",
        f"M203 {speed} ; mm/s",
        f"M204 P{print_} R{retract} T{number(printer.travel_acceleration)} ; mm/s^2",
        corner,
    ]


MARLIN: Final = Dialect(limits=_limits, fan=fan_line, nozzle=nozzle_line, bed=bed_line, pause="M0")
