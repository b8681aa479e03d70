"""Split lines of G-code into line number, checksum, comment, code and words, ignoring case.

Three functions share the same patterns. `parse` returns the last number of each letter, as firmware reads a command.
`parse_extended_command` reads extended commands, such as Klipper's. `read_commands` returns all numbers of each letter
and every command that some firmware may find in the line. This module does not load numpy, so the host can use it.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import lru_cache
from typing import Final

from printer_slicer.gcode.commands import takes_text
from printer_slicer.values import Struct, field

__all__ = [
    "LintCommand",
    "find_letters",
    "is_macro",
    "parse",
    "parse_extended_command",
    "read_commands",
    "split_code",
    "split_line_number",
    "strip",
]

_NUMBER: Final = r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)"
_ANY_WORD: Final = rf"([A-Z])\s*({_NUMBER})?"
_ANY_NAME: Final = r"@?[A-Z_][A-Z_0-9]+"
_ANY_SETTING: Final = rf"\b([A-Z_][A-Z_0-9]*)\s*=\s*['\"]?({_NUMBER})"

_CODE: Final = re.compile(rb"\s*([GMT])\s*(\d+)")
_VALUE: Final = re.compile(rf"([A-Z])\s*({_NUMBER})".encode())
_LETTER: Final = re.compile(rf"([A-Z])\s*(?:{_NUMBER})?".encode())
_NAME: Final = re.compile(_ANY_NAME.encode())
_SETTING: Final = re.compile(_ANY_SETTING.encode())
_LINE_NUMBER: Final = re.compile(rb"[Nn](\d+)\s*")
_CHECKSUM: Final = re.compile(rb"\s*\*\d{1,5}$")
_SETS_ONLY: Final = re.compile(rb"SET_|EXCLUDE_OBJECT|RESPOND\b|SAVE_GCODE_STATE|TURN_OFF_HEATERS|@|;|$")
_NUMBER_LIMIT: Final = 1e9
"""Numbers from this one on are ignored: no machine is that large."""

_SUSPECTED_CODE: Final = re.compile(r"([GMTD])\s*(-?[0-9]+)(?:\.[0-9]+)?")
_NEXT_COMMAND: Final = re.compile(r"[GM] *[0-9]+")
_WORD: Final = re.compile(_ANY_WORD)
_TEXT_NAME: Final = re.compile(_ANY_NAME)
_TEXT_SETTING: Final = re.compile(_ANY_SETTING)
_QUOTED: Final = re.compile(r'"[^"]*"?')
_BRACKETED: Final = re.compile(r"\([^)]*\)?")
_EXPONENT: Final = re.compile(r"[0-9]E[-+]?[0-9]|0X[0-9A-F]")


def strip(line: bytes) -> bytes:
    """Return the command of a line without comment, surrounding blanks, line number and checksum.

    The result is empty if the line has no command, and for M110, which would change the host's line numbers.
    """
    if b";" in line:
        line = line[: line.index(b";")]
    line = line.strip()
    first = line[:1]
    if first in (b"N", b"n"):
        line = split_line_number(line)[1]
        first = line[:1]
    if first in (b"M", b"m") and parse(line)[0] == b"M110":
        return b""
    return line


def split_line_number(line: bytes) -> tuple[int | None, bytes]:
    """Split a line without comment into its number (None if it has none) and its command without checksum."""
    found = _LINE_NUMBER.match(line)
    if found is None:
        return None, line
    return int(found[1]), _CHECKSUM.sub(b"", line[found.end() :], count=1)


def parse(command: bytes) -> tuple[bytes, dict[bytes, float]]:
    """Return the code of a command (`G1`, `M104`, `T0`; empty if there is none) and the numbers of its words.

    Args:
        command: without line number, checksum and comment.
    """
    if not command.isupper():
        command = command.upper()
    found = _CODE.match(command)
    if not found:
        return b"", {}
    values = {letter: float(value) for letter, value in _VALUE.findall(command, found.end())}
    if values and max(map(abs, values.values())) >= _NUMBER_LIMIT:
        values = {letter: value for letter, value in values.items() if abs(value) < _NUMBER_LIMIT}
    return b"%s%d" % (found[1], int(found[2])), values


def find_letters(command: bytes) -> frozenset[bytes]:
    """Return the letters after the code of a command, such as the axes of `G28 X Y`, with or without numbers."""
    command = command.upper()
    found = _CODE.match(command)
    return frozenset(_LETTER.findall(command, found.end())) if found else frozenset()


def split_code(line: bytes) -> tuple[bytes, bytes]:
    """Split a line after its code, such as `b"g01"` and `b" x1"`; both parts are empty if it has no code."""
    found = _CODE.match(line.upper())
    return (line[: found.end()], line[found.end() :]) if found else (b"", b"")


def parse_extended_command(command: bytes) -> tuple[bytes, dict[bytes, float]]:
    """Return the name of an extended command, such as SET_PIN, in upper case, and its parameters NAME=number."""
    command = command.upper()
    found = _NAME.match(command)
    if not found:
        return b"", {}
    return found[0], {name: float(number) for name, number in _SETTING.findall(command)}


def is_macro(command: bytes) -> bool:
    """Return whether a command is a macro of the printer, with unknown effects."""
    command = command.upper()
    return not _CODE.match(command) and _SETS_ONLY.match(command) is None


class LintCommand(Struct, frozen=True):
    """One command of a line, with all words that some firmware may read in it.

    Attributes:
        code: letter and number, `M104`; name of an extended command, `SET_PIN`; "" for anything else.
        text: the line of the command, in upper case.
        words: letter -> all its numbers; an empty list for a letter alone.
        settings: parameters NAME=number of an extended command.
        further: whether another command precedes this one in the line.
        rest: text after the code up to the next command, without quoted and bracketed texts.
    """

    code: str
    text: str
    words: dict[str, list[float]] = field(default_factory=dict)
    settings: dict[str, float] = field(default_factory=dict)
    further: bool = False
    rest: str = ""

    def find_largest_number(self, letters: str) -> float | None:
        """Return the largest number of the words with these letters; None if they have no numbers."""
        values = [value for letter in letters for value in self.words.get(letter, ())]
        return max(values, default=None)

    @property
    def is_ambiguous(self) -> bool:
        """Whether firmwares may read the numbers of the command differently: expressions, exponents, hexadecimals."""
        return _has_ambiguous_numbers(self.text)


@lru_cache(maxsize=8)
def _has_ambiguous_numbers(text: str) -> bool:
    """Return whether firmwares may read the numbers of a line differently; cached for lines with several commands."""
    return "{" in text or _EXPONENT.search(text) is not None


def read_commands(line: bytes) -> Iterator[LintCommand]:
    """Yield the commands that firmware may find in a line.

    Finds more than `parse`: some firmwares execute a second command in the same line, and firmwares differ in which
    number of a repeated letter they use.
    """
    text = split_line_number(line.strip())[1].decode("latin-1").upper()
    match = _SUSPECTED_CODE.match(text)
    if match is None:
        named = _TEXT_NAME.match(text)
        settings = {name: float(number) for name, number in _TEXT_SETTING.findall(text)}
        yield LintCommand(named[0] if named else "", text, settings=settings)
        return
    code = f"{match[1]}{int(match[2])}"
    rest = _BRACKETED.sub(" ", _QUOTED.sub(" ", text[match.end() :]))
    if takes_text(code):
        yield LintCommand(code, text, _collect_words(rest))
        return
    found = list(_NEXT_COMMAND.finditer(rest))
    own = rest[: found[0].start()] if found else rest
    yield LintCommand(code, text, _collect_words(own), rest=own)
    ends = [*(one.start() for one in found), len(rest)][1:]
    for one, end in zip(found, ends, strict=True):
        name = one.group().replace(" ", "")
        own = rest[one.end() : end]
        yield LintCommand(f"{name[0]}{int(name[1:])}", text, _collect_words(own), further=True, rest=own)


def _collect_words(text: str) -> dict[str, list[float]]:
    """Return all numbers of each letter in a text; an empty list for a letter without numbers."""
    words: dict[str, list[float]] = {}
    for letter, number in _WORD.findall(text):
        values = words.setdefault(letter, [])
        if number:
            values.append(float(number))
    return words
