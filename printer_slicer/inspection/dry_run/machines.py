"""The machine and the firmware that a printer's profile describes."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from printer_slicer.motion.rules import limits_of
from printer_slicer.profile import Printer
from printer_slicer.sim.firmwares import MARLIN_2_1, SIMULATED_FIRMWARES, SimulatedFirmware
from printer_slicer.sim.heater import HeaterSpec
from printer_slicer.sim.machine import Machine

__all__ = ["machine_of", "simulated_firmware_for"]

_PERSON: Final = 60.0  # s until somebody answers a file that waits for a person
_OVER: Final = (
    10.0  # mm that machines reach over the highest part, which firmware that ends a print may not know
)
_PROBED: Final = 16  # points that a machine with a probe touches


def machine_of(printer: Printer, extruders: int | None = None, *, one_hotend: bool = False) -> Machine:
    """Return the machine of a printer profile; values that profiles lack are those of a common printer.

    Args:
        printer: the profile.
        extruders: how many it has; None: the tool of the profile and those below it.
        one_hotend: they share one, as with a changer of filaments.
    """
    (left, front), (right, back) = printer.corners
    over = 0.0 if printer.firmware.halts_out_of_bounds else _OVER
    return Machine(
        limits=limits_of(printer),
        box_min=(left - printer.reach, front - printer.reach, 0.0),
        box_max=(right + printer.reach, back + printer.reach, printer.bed_z + over),
        home=(left, front, 0.0),
        person_seconds=_PERSON,
        probe_points=_PROBED if printer.probe else 0,
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
    """Return the simulated firmware for a printer: it answers as Marlin, with the commands of its dialect."""
    extended = printer.firmware.dialect.extended_commands
    any_case = any(one.any_case for one in SIMULATED_FIRMWARES.values() if one.dialect == printer.flavour)
    return replace(MARLIN_2_1, dialect=printer.flavour, ignores_extended=extended, any_case=any_case)
