"""Make the simulated machine and firmware that a printer profile describes."""

from __future__ import annotations

from typing import Final

from printer_slicer.motion.rules import limits_of
from printer_slicer.profile import Printer
from printer_slicer.sim.firmwares import MARLIN_2_1, SIMULATED_FIRMWARES, SimulatedFirmware
from printer_slicer.sim.heater import HeaterSpec
from printer_slicer.sim.machine import Machine
from printer_slicer.values import replace

__all__ = ["machine_of", "simulated_firmware_for"]

_USER_DELAY: Final = 60.0  # s; time in which the simulated user answers when a file waits
# mm above the printable height that the nozzle can reach, for a lift at the end
_MARGIN_ABOVE: Final = 10.0
_PROBE_POINTS: Final = 16  # points that a bed probe touches


def machine_of(printer: Printer, extruders: int | None = None, *, one_hotend: bool = False) -> Machine:
    """Return the simulated machine for a printer profile; values that profiles lack are typical values.

    Args:
        printer: the profile.
        extruders: number of extruders; None: enough for the tool of the profile.
        one_hotend: whether the extruders share one hotend, as with a filament changer.
    """
    (left, front), (right, back) = printer.corners
    over = 0.0 if printer.firmware.halts_out_of_bounds else _MARGIN_ABOVE
    return Machine(
        limits=limits_of(printer),
        box_min=(left - printer.reach, front - printer.reach, 0.0),
        box_max=(right + printer.reach, back + printer.reach, printer.bed_z + over),
        home=(left, front, 0.0),
        person_seconds=_USER_DELAY,
        probe_points=_PROBE_POINTS if printer.probe else 0,
        extruders=printer.tool + 1 if extruders is None else extruders,
        one_hotend=one_hotend,
        hotend=HeaterSpec(
            power=40.0, heat_capacity=12.0, loss=0.1, fan_loss=0.03, highest=printer.max_nozzle_temperature
        ),
        bed=HeaterSpec(
            power=max(220.0, 0.006 * printer.bed_x * printer.bed_y),
            heat_capacity=0.0155 * printer.bed_x * printer.bed_y,
            loss=1.6 * printer.bed_x * printer.bed_y / 220**2,
            fan_loss=0.2,
            highest=printer.max_bed_temperature,
        ),
    )


def simulated_firmware_for(printer: Printer) -> SimulatedFirmware:
    """Return a simulated firmware that replies like Marlin and understands the printer's dialect."""
    extended = printer.firmware.dialect.extended_commands
    any_case = any(one.any_case for one in SIMULATED_FIRMWARES.values() if one.dialect == printer.flavour)
    return replace(MARLIN_2_1, dialect=printer.flavour, ignores_extended=extended, any_case=any_case)
