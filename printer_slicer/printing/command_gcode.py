"""G-code of the commands that consist of one G-code line."""

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
        raise UsageError(
            "this firmware does not support baby-steps", remedy="Build the firmware with BABYSTEPPING"
        )
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
"""Function that builds the G-code of each kind of command, from the command, the firmware and its capabilities."""


def gcode_for(command: commands.PrintCommand, firmware: Firmware, who: Identified | None) -> bytes:
    """Return the G-code of a command of one of these kinds.

    Raises:
        UsageError: the firmware does not support it.
    """
    return GCODE_COMMANDS[type(command)](command, firmware, who)
