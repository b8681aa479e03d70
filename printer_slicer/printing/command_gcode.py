"""Format those print commands that consist of one line of G-code."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final

from printer_slicer.errors import UsageError
from printer_slicer.firmware import Firmware
from printer_slicer.printing import commands
from printer_slicer.stream.events import Identified

__all__ = ["GCODE_COMMANDS", "format_command"]


def _format_baby_step(command: commands.BabyStep, firmware: Firmware, identified: Identified | None) -> bytes:
    """Return the G-code of a baby step; raise an error if the firmware supports no baby steps."""
    if identified is not None and ("BABYSTEPPING", False) in identified.capabilities:
        raise UsageError(
            "the firmware does not support baby-steps", remedy="Build the firmware with BABYSTEPPING enabled"
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
    commands.BabyStep: _format_baby_step,
}
"""For each kind of command, the function that formats its G-code for a firmware with reported capabilities."""


def format_command(
    command: commands.PrintCommand, firmware: Firmware, identified: Identified | None
) -> bytes:
    """Return the G-code of a print command whose kind is in `GCODE_COMMANDS`.

    Raises:
        UsageError: the firmware does not support the command.
    """
    return GCODE_COMMANDS[type(command)](command, firmware, identified)
