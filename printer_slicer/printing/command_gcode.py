"""Wishes that are one command each, in the words of the firmware."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final

from printer_slicer.errors import UsageError
from printer_slicer.firmware import Firmware
from printer_slicer.printing import commands
from printer_slicer.stream.events import Identified

__all__ = ["GCODE_COMMANDS", "gcode_for"]


def _baby_step(command: commands.BabyStep, firmware: Firmware, who: Identified | None) -> bytes:
    if who is not None and ("BABYSTEPPING", False) in who.capabilities:
        raise UsageError("this firmware has no baby-steps", remedy="build it with BABYSTEPPING")
    return firmware.baby_step_command(command.mm)


GCODE_COMMANDS: Final[Mapping[type, Callable[[Any, Firmware, Identified | None], bytes]]] = {
    commands.Speed: lambda command, *_: b"M220 S%d" % round(command.percent),
    commands.Flow: lambda command, *_: b"M221 S%d" % round(command.percent),
    commands.SetTemperature: lambda command, *_: (
        {"nozzle": b"M104 S%g", "bed": b"M140 S%g"}[command.heater] % command.celsius
    ),
    commands.SetFan: lambda command, *_: b"M106 S%d" % round(command.percent * 255 / 100),
    commands.Say: lambda command, *_: command.gcode.encode("utf-8", "replace"),
    commands.BabyStep: _baby_step,
}
"""Kind of wish to command: the wish, the firmware, and what it says that it can do."""


def gcode_for(command: commands.PrintCommand, firmware: Firmware, who: Identified | None) -> bytes:
    """The command that grants a wish of one of these kinds.

    Raises:
        UsageError: the firmware cannot.
    """
    return GCODE_COMMANDS[type(command)](command, firmware, who)
