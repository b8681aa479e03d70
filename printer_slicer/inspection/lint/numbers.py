"""Find words without a valid number, and say how the firmware reads them.

Which firmware does what with them is in its row of `firmware`, with the source.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Final

from printer_slicer.firmware import FIRMWARES, FLAVOURS
from printer_slicer.gcode.commands import TABLE, Effect, names_that
from printer_slicer.gcode.lexer import LintCommand

__all__ = ["number_faults"]

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


def number_faults(command: LintCommand, flavour: str) -> Iterator[str]:
    """Yield a description of each word of a command without a valid number, and how the firmware reads it.

    Args:
        command: the parsed command.
        flavour: a key of `FLAVOURS`.
    """
    letters = _LETTERS.get(command.code)
    if letters is None:
        return
    firmware, reads = FIRMWARES[flavour].title, FLAVOURS[flavour].numbers
    for letter, number in _WORD.findall(_EXPRESSION.sub("0", command.rest)):
        if letter not in letters or _GOOD.fullmatch(number) or (command.code, letter) in _FLAGS:
            continue
        if not number:
            yield f"{letter} has no number: {firmware} {reads.bare}"
        elif number.lstrip("+-").isalpha():
            yield f"{letter} is {number.lower()}: {firmware} {reads.not_a_number}"
        else:
            yield f"{letter}{number} is not a valid number: {firmware} {reads.malformed}"
