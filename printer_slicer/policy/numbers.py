"""Words whose number is missing or is no number, and what each firmware makes of them.

Sources: Marlin's `GCodeParser::parse` and `valid_float` (2.1 and 1.1.9); Klipper's `gcode.py` and `gcode_move.py`;
RepRapFirmware's `StringParser.cpp` (`CheckNumberFound`); Smoothieware's `Gcode::get_value`; Prusa-Firmware's
`code_value` and Repetier's `parseFloatValue`, which are C's `strtod`.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Final, NamedTuple

from printer_slicer.policy.words import Command

__all__ = ["number_faults"]

_MOVES: Final = frozenset({"G0", "G1", "G2", "G3", "G5"})
_ALL: Final = "ABCDEFHIJKLPQRSTUVWXYZ"
_LETTERS: Final[Mapping[str, str]] = {
    **dict.fromkeys(_MOVES, _ALL),
    "G4": "PS",
    "G92": "XYZE",
    **dict.fromkeys(("M104", "M109", "M140", "M190", "M141", "M191"), "SR"),
    **dict.fromkeys(("M106", "M200", "M204", "M220", "M221"), "DEPRST"),
    **dict.fromkeys(("M201", "M202", "M203", "M205", "M207", "M208", "M566", "M572", "M900"), _ALL),
}
"""Letters that are nothing without a number, by command."""

_FLAGS: Final = frozenset({("M220", "B"), ("M220", "R"), ("M109", "F"), ("M104", "F")})
"""Letters that stand alone on purpose: Prusa's M220 B and R keep and restore the ratio."""

_WORD: Final = re.compile(r"([A-Z]) *([-+]?(?:NAN|INF(?:INITY)?)(?![A-Z])|[-+.0-9]*)")
_GOOD: Final = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)")
_EXPRESSION: Final = re.compile(r"\{[^}]*\}")


class _Reading(NamedTuple):
    """What a firmware makes of `X`, of `Xnan`, and of `X1.2.3`."""

    bare: str
    not_a_number: str
    malformed: str


_PASSED_OVER: Final = "passes over the word"
_REFUSED: Final = "refuses the whole line"
_UP_TO: Final = "reads it up to where it stops being a number"
_MARLIN: Final = _Reading(_PASSED_OVER, _PASSED_OVER, _UP_TO)
_STRTOD: Final = _Reading("reads it as 0", "takes it as it stands, and then knows no position", _UP_TO)

_READINGS: Final[Mapping[str, tuple[str, _Reading]]] = {
    "marlin": ("Marlin", _MARLIN),
    "marlin_legacy": ("Marlin", _MARLIN),
    "prusa": ("Prusa's firmware", _STRTOD),
    "repetier": ("Repetier", _STRTOD),
    "smoothie": ("Smoothieware", _STRTOD),
    "klipper": ("Klipper", _Reading(_REFUSED, _PASSED_OVER, _REFUSED)),
    "reprapfirmware": ("RepRapFirmware", _Reading(_REFUSED, _REFUSED, _UP_TO)),
}
"""Flavour -> name of the firmware, and how it reads."""


def number_faults(command: Command, flavour: str) -> Iterator[str]:
    """What is wrong with the numbers of a command, and what the firmware makes of it.

    Args:
        command: taken apart.
        flavour: of the firmware, a key of `FLAVOURS`.
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
            yield f"{letter}{number} is no number: {firmware} {reads.malformed}"
