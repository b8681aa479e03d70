"""Format those print commands that consist of one line of G-code."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final

from printer_slicer.errors import UsageError
from printer_slicer.firmware import Firmware
from printer_slicer.gcode.commands import Effect, find_codes
from printer_slicer.gcode.lexer import parse, strip
from printer_slicer.printing import commands
from printer_slicer.stream.events import Identified

__all__ = ["GCODE_COMMANDS", "changes_position", "format_command"]

_POSITION_EFFECTS: Final = (
    Effect.MOVES
    | Effect.MOVES_UNSEEN
    | Effect.HOMES
    | Effect.SETS_POSITION
    | Effect.SETS_HOME_OFFSET
    | Effect.MOVES_ORIGIN
    | Effect.MODE
    | Effect.UNITS
    | Effect.RETRACTS
)
_MOTORS_OFF: Final = frozenset({b"M18", b"M84"})  # the printer forgets its position
_MACRO: Final = b"M98"  # macros do what their authors want, as those of Klipper do, which no table lists
_POSITION_CODES: Final = (find_codes(_POSITION_EFFECTS) | _MOTORS_OFF) - {_MACRO}


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


def changes_position(gcode: str) -> bool:
    """Return whether a line moves the printer or changes how it reads positions, such as G28, G91, G92, T1 or M84."""
    word, values = parse(strip(gcode.encode("utf-8", "replace")))
    if word == b"G10" and b"P" in values:  # sets temperatures or offsets of a tool
        return False
    return word in _POSITION_CODES or word[:1] == b"T"
