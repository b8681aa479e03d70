"""Macros of a printer's own, by their names: what they hold is in the printer, and nobody outside of it knows.

Files for Klipper mostly begin with one macro that homes and heats (`PRINT_START EXTRUDER=215 BED=55`) and end with one
that switches off and parks (`PRINT_END`). Their case does not matter.
"""

from __future__ import annotations

import re
from typing import Final

__all__ = ["macro_temperatures", "match_end_macro", "match_start_macro"]

_STARTS: Final = re.compile(
    r"(?i)(?!EXCLUDE_|TIMELAPSE_|SET_)(?:_?(?:[A-Z0-9]+_)*(?:START|BEGIN)(?:_[A-Z0-9]+)*|START_?PRINT|PRINT_?START)(?=\s|$)"
)
"""The first word; objects that can be left out begin with a word of the same kind, and nothing is heated there."""

_ENDS: Final = re.compile(r"(?i)(?:\w*_)?(?:END|FINISH|OFF|COOLDOWN|COOL)(?:_\w*)?(?=\s|$)")
_SETTING: Final = re.compile(r"(?i)\b([A-Z_][A-Z_0-9]*)=['\"]?([0-9]+(?:\.[0-9]*)?)")
_HEATERS: Final = frozenset({"BED", "EXTRUDER", "HOTEND", "NOZZLE"})


def match_start_macro(command: str) -> str:
    """The macro that by its name makes the printer ready: homes it and heats; empty if the command is none."""
    found = _STARTS.match(command)
    return found[0] if found else ""


def match_end_macro(command: str) -> str:
    """The macro that by its name ends prints or cools; empty if the command is none."""
    found = _ENDS.match(command)
    return found[0] if found else ""


def macro_temperatures(command: str) -> dict[str, float]:
    """°C of "bed" and "nozzle" that a command such as `START_PRINT BED_TEMP=60 EXTRUDER_TEMP=210` names."""
    asked: dict[str, float] = {}
    for name, number in _SETTING.findall(command.upper()):
        if (name in _HEATERS or "TEMP" in name) and "CHAMBER" not in name:
            asked.setdefault("bed" if "BED" in name else "nozzle", float(number))
    return asked
