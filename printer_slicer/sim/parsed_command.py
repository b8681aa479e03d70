"""A parsed command: code, words and the text behind the code."""

from __future__ import annotations

import re
from typing import Final

__all__ = ["SIMPLE_MOVE", "Command"]

_NUMBER = r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)"
_SHORT = r"[-+]?(?:[0-9]{1,9}(?:\.[0-9]*)?|\.[0-9]+)"

_LARGEST: Final = 1e9
"""Numbers are clipped to this; a long line of digits would be infinite otherwise."""

SIMPLE_MOVE: Final = re.compile(
    rf"G[01](?: X({_SHORT}))?(?: Y({_SHORT}))?(?: Z({_SHORT}))?(?: E({_SHORT}))?(?: F({_SHORT}))?"
).fullmatch
"""Match a G0 or G1 with words in the usual order, as five groups."""

_CODE: Final = re.compile(r"([A-Z]) *([0-9]+(?:\.[0-9]+)?)")
_SETTING: Final = re.compile(rf"\b([A-Z_]+)=({_NUMBER})")
_WRITTEN: Final = re.compile(r"([A-Z]) *([-+.0-9]*)")
_WHOLE: Final = re.compile(_NUMBER).fullmatch
_WORD: Final = re.compile(rf"([A-Z]) *({_NUMBER})?")


_UPPER: Final = {ord(letter): letter.upper() for letter in "abcdefghijklmnopqrstuvwxyz"}


class Command:
    """A parsed G-code command.

    Args:
        text: the line without line number and checksum.
        any_case: whether to ignore case.

    Attributes:
        text: the line without line number and checksum.
        name: the first word, in upper case if case is ignored: the name of an extended command.
        code: letter and number, such as "G28"; empty without them.
        rest: text behind the code, stripped.
        words: letters behind the code with their numbers as text, "" without a number. There are no exponents: E is
            an axis, so "X10E5" is two words.
    """

    __slots__ = ("_behind", "_read", "code", "name", "rest", "text", "words")

    def __init__(self, text: str, *, any_case: bool = False) -> None:
        read = text.translate(_UPPER) if any_case else text
        match = _CODE.match(read)
        self.text, self._read = text, read
        self.name = read.partition(" ")[0]
        self.code = f"{match[1]}{match[2].lstrip('0') or '0'}" if match else ""  # G01 is G1
        self.rest = text[match.end() :].strip() if match else ""
        self._behind = read[match.end() :] if match else ""
        self.words: dict[str, str] = dict(_WORD.findall(self._behind))

    def value(self, letter: str) -> float | None:
        """Return the number of a letter; None without the letter or without a number."""
        text = self.words.get(letter)
        return min(max(float(text), -_LARGEST), _LARGEST) if text else None

    def values(self, letters: str) -> dict[str, float]:
        """Return the numbers of those letters that have one."""
        return {letter: value for letter in letters if (value := self.value(letter)) is not None}

    def without_number(self, letters: str) -> list[str]:
        """Return the letters without a valid number."""
        found = _WRITTEN.findall(self._behind)
        return [letter for letter, text in found if letter in letters and not _WHOLE(text)]

    def setting(self, name: str) -> float | None:
        """Return the number of NAME=number in an extended command; None without it."""
        return next((float(value) for key, value in _SETTING.findall(self._read) if key == name), None)
