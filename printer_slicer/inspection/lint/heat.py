"""Check the temperatures of a job against the maximum temperatures of the profile.

Source: Marlin's documentation, "M104", "M109", "M140", "M190", "M141", "M149"; Duet3D's G-code dictionary, "G10",
"M568"; Klipper's documents, "G-Codes": SET_HEATER_TEMPERATURE.
"""

from __future__ import annotations

from typing import Final

from printer_slicer.gcode.commands import HeaterName, find_heater
from printer_slicer.gcode.lexer import LintCommand
from printer_slicer.profile import Profile
from printer_slicer.values import Struct

__all__ = ["HeaterRules"]

_TARGET_LETTERS: Final = "SR"

_FAHRENHEIT_ZERO: Final = 32.0
_KELVIN_ZERO: Final = 273.15


class HeaterRules(Struct):
    """Checks the target temperatures of a job.

    Attributes:
        profile: the profile with the maximum temperatures.
        heated: whether the job has set a nozzle temperature.
    """

    profile: Profile
    heated: bool = False
    _unit: str = "C"

    def check_command(self, command: LintCommand) -> str:
        """Return a message if a command sets a temperature that is too high or unreadable; else return ""."""
        if command.code == "M149":
            self._unit = next((letter for letter in "CFK" if letter in command.words), self._unit)
            return ""
        if command.settings or command.code.startswith(("SET_HEATER", "TEMPERATURE_WAIT")):
            return self._check_settings(command)
        heater = find_heater(command.code)
        if command.code == "G10" and "P" in command.words and set(command.words) & set(_TARGET_LETTERS):
            heater = "nozzle"
        if heater is None:
            return ""
        self.heated = self.heated or heater == "nozzle"
        if command.is_ambiguous:
            return f"the temperature of the {heater} cannot be read"
        target = command.find_largest_number(_TARGET_LETTERS)
        return "" if target is None else self._check_target(heater, self._to_celsius(target))

    def _check_settings(self, command: LintCommand) -> str:
        """Return a message on bad temperatures in Klipper commands, such as START_PRINT EXTRUDER_TEMP=210."""
        for name, value in command.settings.items():
            if "TEMP" not in name and name not in {"TARGET", "MINIMUM", "EXTRUDER", "HOTEND", "BED"}:
                continue
            words = f"{name} {command.text}" if name in {"TARGET", "MINIMUM"} else name
            heater: HeaterName = "bed" if "BED" in words else "chamber" if "CHAMBER" in words else "nozzle"
            self.heated = self.heated or heater == "nozzle"
            if command.is_ambiguous:
                return f"the temperature of the {heater} cannot be read"
            if wrong := self._check_target(heater, value):
                return wrong
        return ""

    def _to_celsius(self, value: float) -> float:
        """Convert a temperature from the unit of the job (M149) to °C."""
        if self._unit == "F":
            return (value - _FAHRENHEIT_ZERO) / 1.8
        return value - _KELVIN_ZERO if self._unit == "K" else value

    def _check_target(self, heater: HeaterName, target: float) -> str:
        """Return a message if a target temperature is above the profile's maximum; else return ""."""
        printer = self.profile.printer
        # Profiles have no maximum for the chamber, so the maximum of the bed applies.
        maximum = printer.max_nozzle_temperature if heater == "nozzle" else printer.max_bed_temperature
        return (
            f"{heater} temperature {target:g} °C is above the maximum of {maximum:g} °C"
            if target > maximum
            else ""
        )
