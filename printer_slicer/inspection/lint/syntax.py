"""Find words that a firmware cannot read: they have no valid number, or are in lower case.

The table of firmwares in `firmware` says how each one reads such words. Messages, file names, words of several letters
and commands for the host (`@pause`) may be in lower case everywhere.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Final

from printer_slicer.firmware import FIRMWARES, FLAVOURS
from printer_slicer.gcode.commands import TABLE, Effect, find_codes_as_text, takes_text
from printer_slicer.gcode.lexer import LintCommand, parse, split_code, split_line_number

__all__ = ["describe_lower_case_fault", "describe_number_faults", "is_known_to_a_firmware"]

_KNOWN_COMMANDS: Final = re.compile(
    r"G(?:0?[0-6]|1[0-2]|1[7-9]|2[0-9]|3[0-8]|42|5[3-9]|6[01]|76|80|9[0-24]|425)\b"
    r"|M(?:\d|1\d|2[0-9]|3[0-46-8]|4[238]|7[2-8]|8[0-6]|92|9[38]|1[0-6]\d|19[0-3]|2\d\d|30[0-9]|3[567]\d|38[0-2]|4[0-3]\d"
    r"|47[12]|48[0-9]|49[0-9]|5[0-9]\d|6[0-7]\d|7[01]\d|8[01]\d|85\d|86\d|87\d|88\d|89\d|9\d\d|100\d)\b|T\d|@"
)
"""Commands that at least one firmware knows, the simulated or a real one."""

_ALL_LETTERS: Final = "ABCDEFHIJKLPQRSTUVWXYZ"
_NUMBER_LETTERS: Final[Mapping[str, str]] = {
    **dict.fromkeys(find_codes_as_text(Effect.MOVES) | {"G5"}, _ALL_LETTERS),
    "G4": "PS",
    "G92": "XYZE",
    **dict.fromkeys((code.decode() for code, row in TABLE.items() if row.heater), "SR"),
    **dict.fromkeys(("M106", "M200", "M204", "M220", "M221"), "DEPRST"),
    **dict.fromkeys(("M201", "M202", "M203", "M205", "M207", "M208", "M566", "M572", "M900"), _ALL_LETTERS),
}
"""Letters that require a number, by command."""

_FLAGS: Final = frozenset({("M220", "R")})
"""Letters that are valid without a number: Prusa's M220 R restores the saved ratio."""

_WORD: Final = re.compile(r"([A-Z]) *([-+]?(?:NAN|INF(?:INITY)?)(?![A-Z])|[-+.0-9]*)")
_VALID_NUMBER: Final = re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)")
_EXPRESSION: Final = re.compile(r"\{[^}]*\}")


def is_known_to_a_firmware(command: str) -> bool:
    """Return whether at least one firmware without named commands knows a command."""
    return _KNOWN_COMMANDS.match(command) is not None


def describe_number_faults(command: LintCommand, flavour: str) -> Iterator[str]:
    """Describe each word of a command that has no valid number, and how the firmware reads the word.

    Args:
        command: the parsed command.
        flavour: a key of `FLAVOURS`.
    """
    letters = _NUMBER_LETTERS.get(command.code)
    if letters is None:
        return
    firmware, reads = FIRMWARES[flavour].title, FLAVOURS[flavour].numbers
    for letter, number in _WORD.findall(_EXPRESSION.sub("0", command.rest)):
        if letter not in letters or _VALID_NUMBER.fullmatch(number) or (command.code, letter) in _FLAGS:
            continue
        if not number:
            yield f"{letter} has no number: {firmware} {reads.bare}"
        elif number.lstrip("+-").isalpha():
            yield f"{letter} is {number.lower()}: {firmware} {reads.not_a_number}"
        else:
            yield f"{letter}{number} is not a valid number: {firmware} {reads.malformed}"


_QUOTED_TEXT: Final = re.compile(r'"[^"]*"?|\([^)]*\)?|\{[^}]*\}?')
_LOWER_WORD: Final = re.compile(r"(?<![A-Za-z_])[a-z](?![A-Za-z_])")


def describe_lower_case_fault(line: bytes, flavour: str) -> str:
    """Return a message if the firmware cannot read lower-case words of a line; else return "".

    Args:
        line: one command, without comment.
        flavour: flavour of the firmware, a key of `FLAVOURS`.
    """
    if FLAVOURS[flavour].any_case or line == line.upper():
        return ""
    head, rest = split_code(split_line_number(line.strip())[1])
    if not head:
        return ""
    arguments = rest.decode("latin-1")
    is_free_text = takes_text(parse(head)[0].decode())
    if head.isupper() and (is_free_text or not _LOWER_WORD.search(_QUOTED_TEXT.sub(" ", arguments))):
        return ""
    capitals = head.decode().upper() + (arguments if is_free_text else _convert_to_upper_case(arguments))
    return f"is in lower case, which {FIRMWARES[flavour].title} does not read: write {capitals}"


def _convert_to_upper_case(words: str) -> str:
    """Return the words of a command in upper case; leave quoted texts and comments unchanged."""
    texts = iter(_QUOTED_TEXT.findall(words))
    return "".join(part.upper() + next(texts, "") for part in _QUOTED_TEXT.split(words))
