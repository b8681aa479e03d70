"""Find words without a valid number, and describe how each firmware reads them.

Sources: Marlin's `GCodeParser::parse` and `valid_float` (2.1 and 1.1.9); Klipper's `gcode.py` and `gcode_move.py`;
RepRapFirmware's `StringParser.cpp` (`CheckNumberFound`); Smoothieware's `Gcode::get_value`; Prusa-Firmware's
`code_value` and Repetier's `parseFloatValue`, which are C's `strtod`.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Final, NamedTuple

from printer_slicer.gcode.commands import TABLE, Effect, names_that
from printer_slicer.gcode.lexer import LintCommand

__all__ = ["firmware_name", "number_faults"]

_ALL: Final = "ABCDEFHIJKLPQRSTUVWXYZ"
_LETTERS: Final[Mapping[str, str]] = {
    **dict.fromkeys(names_that(Effect.MOVES) | {"G5"}, _ALL),
    "G4": "PS",
    "G92": "XYZE",
    **dict.fromkeys((code.decode() for code, row in TABLE.items() if row.heater), "SR"),
    **dict.fromkeys(("M106", "M200", "M204", "M220", "M221"), "DEPRST"),
    **dict.fromkeys(("M201", "M202", "M203", "M205", "M207", "M208", "M566", "M572", "M900"), _ALL),
}
"""Letters that require a number, by command."""

_FLAGS: Final = frozenset({("M220", "B"), ("M220", "R"), ("M109", "F"), ("M104", "F")})
"""Letters that need no number: Prusa's M220 B and R save and restore the ratio."""

_WORD: Final = re.compile(r"([A-Z]) *([-+]?(?:NAN|INF(?:INITY)?)(?![A-Z])|[-+.0-9]*)")
_GOOD: Final = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)")
_EXPRESSION: Final = re.compile(r"\{[^}]*\}")


class _Reading(NamedTuple):
    """How a firmware reads `X`, `Xnan` and `X1.2.3`."""

    bare: str
    not_a_number: str
    malformed: str


_IGNORED: Final = "ignores the word"
_REJECTED: Final = "rejects the whole line"
_UP_TO: Final = "reads only the valid part at its start"
_MARLIN: Final = _Reading(_IGNORED, _IGNORED, _UP_TO)
_STRTOD: Final = _Reading("reads it as 0", "reads it as NaN or infinity and loses its position", _UP_TO)

_READINGS: Final[Mapping[str, tuple[str, _Reading]]] = {
    "marlin": ("Marlin", _MARLIN),
    "marlin_legacy": ("Marlin", _MARLIN),
    "prusa": ("Prusa's firmware", _STRTOD),
    "repetier": ("Repetier", _STRTOD),
    "smoothie": ("Smoothieware", _STRTOD),
    "klipper": ("Klipper", _Reading(_REJECTED, _IGNORED, _REJECTED)),
    "reprapfirmware": ("RepRapFirmware", _Reading(_REJECTED, _REJECTED, _UP_TO)),
}
"""Flavour -> name of the firmware, and how it reads such words."""


def firmware_name(flavour: str) -> str:
    """The name of the firmware that reads a flavour of G-code."""
    return _READINGS[flavour][0]


def number_faults(command: LintCommand, flavour: str) -> Iterator[str]:
    """Yield a description of each word of a command without a valid number, and how the firmware reads it.

    Args:
        command: the parsed command.
        flavour: a key of `FLAVOURS`.
    """
    letters = _LETTERS.get(command.code)
    if letters is None:
        return
    firmware, reads = _READINGS[flavour]
    for letter, number in _WORD.findall(_EXPRESSION.sub("0", command.rest)):
        if letter not in letters or _GOOD.fullmatch(number) or (command.code, letter) in _FLAGS:
            continue
        if not number:
            yield f"{letter} has no number: {firmware} {reads.bare}"
        elif number.lstrip("+-").isalpha():
            yield f"{letter} is {number.lower()}: {firmware} {reads.not_a_number}"
        else:
            yield f"{letter}{number} is not a valid number: {firmware} {reads.malformed}"
