"""Find words that a firmware cannot read: without a valid number, or in lower case if it needs upper case.

The row of each firmware in `firmware` says what it does with them. Messages, file names, words of several letters and
commands for the host (`@pause`) may be in lower case everywhere.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Final

from printer_slicer.firmware import FIRMWARES, FLAVOURS
from printer_slicer.gcode.commands import TABLE, Effect, names_that, takes_text
from printer_slicer.gcode.lexer import LintCommand, parse, split_code, split_line_number

__all__ = ["lower_case_fault", "number_faults"]

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

_FLAGS: Final = frozenset({("M220", "R")})
"""Letters that are valid without a number: Prusa's M220 R restores the saved ratio."""

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


_TEXT: Final = re.compile(r'"[^"]*"?|\([^)]*\)?|\{[^}]*\}?')
_LOWER_WORD: Final = re.compile(r"(?<![A-Za-z_])[a-z](?![A-Za-z_])")


def lower_case_fault(line: bytes, flavour: str) -> str:
    """Return what is wrong with lower-case letters of a line, and how to write it; empty if nothing is.

    Args:
        line: one command, without comment.
        flavour: of the firmware, a key of `FLAVOURS`.
    """
    if FLAVOURS[flavour].any_case or line == line.upper():
        return ""
    head, rest = split_code(split_line_number(line.strip())[1])
    if not head:
        return ""
    behind = rest.decode("latin-1")
    free = takes_text(parse(head)[0].decode())
    if head.isupper() and (free or not _LOWER_WORD.search(_TEXT.sub(" ", behind))):
        return ""
    capitals = head.decode().upper() + (behind if free else _in_capitals(behind))
    return f"is in lower case, which {FIRMWARES[flavour].title} does not read: write {capitals}"


def _in_capitals(words: str) -> str:
    """Return the words of a command in upper case, with its quoted texts unchanged."""
    texts = iter(_TEXT.findall(words))
    return "".join(part.upper() + next(texts, "") for part in _TEXT.split(words))
