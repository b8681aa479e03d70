"""Recognize macros of the printer by their names, because their commands are not in the G-code file.

Files for Klipper mostly begin with a macro that homes and heats (`PRINT_START EXTRUDER=215 BED=55`) and end with one
that switches off the heaters and parks (`PRINT_END`). Case does not matter.
"""

from __future__ import annotations

import re
from typing import Final

__all__ = ["match_end_macro", "match_start_macro", "read_macro_temperatures"]

_STARTS: Final = re.compile(
    r"(?i)(?!EXCLUDE_|TIMELAPSE_|SET_)(?:_?(?:[A-Z0-9]+_)*(?:START|BEGIN)(?:_[A-Z0-9]+)*|START_?PRINT|PRINT_?START)(?=\s|$)"
)
"""First word of a start macro; EXCLUDE_OBJECT_START and similar commands are excluded, because they do not heat."""

_ENDS: Final = re.compile(r"(?i)(?:\w*_)?(?:END|FINISH|OFF|COOLDOWN|COOL)(?:_\w*)?(?=\s|$)")
_SETTING: Final = re.compile(r"(?i)\b([A-Z_][A-Z_0-9]*)=['\"]?([0-9]+(?:\.[0-9]*)?)")
_HEATERS: Final = frozenset({"BED", "EXTRUDER", "HOTEND", "NOZZLE"})


def match_start_macro(command: str) -> str:
    """Return the name of the macro if a command runs a start macro, which homes and heats; otherwise empty."""
    found = _STARTS.match(command)
    return found[0] if found else ""


def match_end_macro(command: str) -> str:
    """Return the name of the macro if a command runs one that ends a print or cools down; otherwise empty."""
    found = _ENDS.match(command)
    return found[0] if found else ""


def read_macro_temperatures(command: str) -> dict[str, float]:
    """Read "bed" and "nozzle" temperatures, °C, from a command like `START_PRINT BED_TEMP=60 EXTRUDER_TEMP=210`."""
    temperatures: dict[str, float] = {}
    for name, number in _SETTING.findall(command.upper()):
        if (name in _HEATERS or "TEMP" in name) and "CHAMBER" not in name:
            temperatures.setdefault("bed" if "BED" in name else "nozzle", float(number))
    return temperatures
