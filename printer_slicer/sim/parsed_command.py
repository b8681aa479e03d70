"""A parsed G-code command: code, words, and the text behind the code."""

from __future__ import annotations

import re
from typing import Final

__all__ = ["SIMPLE_MOVE", "Command"]

_NUMBER = r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)"
_SHORT = r"[-+]?(?:[0-9]{1,9}(?:\.[0-9]*)?|\.[0-9]+)"

_MAX_NUMBER: Final = 1e9
"""Numbers are clipped to this limit; otherwise a long sequence of digits would become infinity."""

SIMPLE_MOVE: Final = re.compile(
    rf"G[01](?: X({_SHORT}))?(?: Y({_SHORT}))?(?: Z({_SHORT}))?(?: E({_SHORT}))?(?: F({_SHORT}))?"
).fullmatch
"""Matches a G0 or G1 with words in the usual order; its five groups are X, Y, Z, E and F."""

_CODE: Final = re.compile(r"([A-Z]) *([0-9]+(?:\.[0-9]+)?)")
_SETTING: Final = re.compile(rf"\b([A-Z_]+)=({_NUMBER})")
_LETTER_AND_TEXT: Final = re.compile(r"([A-Z]) *([-+.0-9]*)")
_match_number: Final = re.compile(_NUMBER).fullmatch
_WORD: Final = re.compile(rf"([A-Z]) *({_NUMBER})?")


_UPPER_CASE: Final = {ord(letter): letter.upper() for letter in "abcdefghijklmnopqrstuvwxyz"}


class Command:
    """A parsed G-code command.

    Args:
        text: the line without line number and checksum.
        any_case: whether lower-case letters mean the same as upper-case ones.

    Attributes:
        text: the line without line number and checksum.
        name: first word, which names an extended command; in upper case if case is ignored.
        code: letter and number, such as "G28"; empty without them.
        rest: text behind the code, stripped.
        words: number of each letter behind the code, as text; empty without a number. E is an axis and never starts
            an exponent, so "X10E5" is two words.
    """

    __slots__ = ("_behind", "_read", "code", "name", "rest", "text", "words")

    def __init__(self, text: str, *, any_case: bool = False) -> None:
        read = text.translate(_UPPER_CASE) if any_case else text
        match = _CODE.match(read)
        self.text, self._read = text, read
        self.name = read.partition(" ")[0]
        self.code = f"{match[1]}{match[2].lstrip('0') or '0'}" if match else ""  # G01 is G1
        self.rest = text[match.end() :].strip() if match else ""
        self._behind = read[match.end() :] if match else ""
        self.words: dict[str, str] = dict(_WORD.findall(self._behind))

    def value(self, letter: str) -> float | None:
        """Return the number behind a letter; None if the letter or its number is missing."""
        text = self.words.get(letter)
        return min(max(float(text), -_MAX_NUMBER), _MAX_NUMBER) if text else None

    def values(self, letters: str) -> dict[str, float]:
        """Return the number behind each of these letters; letters without a number are left out."""
        return {letter: value for letter in letters if (value := self.value(letter)) is not None}

    def letters_without_number(self, letters: str) -> list[str]:
        """Return which of these letters have no valid number behind them."""
        found = _LETTER_AND_TEXT.findall(self._behind)
        return [letter for letter, text in found if letter in letters and not _match_number(text)]

    def setting(self, name: str) -> float | None:
        """Return the number behind NAME= in an extended command; None if this name has no number."""
        return next((float(value) for key, value in _SETTING.findall(self._read) if key == name), None)
